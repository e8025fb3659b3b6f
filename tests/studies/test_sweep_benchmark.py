"""The benchmark of sweeps and of how cost grows: programs are counted, and timed side by side."""

import json
from contextlib import redirect_stdout
from importlib.util import find_spec
from io import StringIO

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from studies.benchmark import __main__ as benchmark
from studies.benchmark import scaling, sweep
from studies.benchmark.chain import chain
from studies.benchmark.workers import Worker
from studies.common.operations import jaxpr_operations


def records_of(folder, *arguments):
    """What a command prints, as lines, and the records it writes."""
    file = folder / "found.json"
    with redirect_stdout(StringIO()) as output:
        benchmark.main([*arguments, "--quick", "--json", str(file)])
    return output.getvalue().split("\n"), json.loads(file.read_text())["rows"]


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    return records_of(tmp_path_factory.mktemp("sweep"), "sweep", "--devices", "2")


@pytest.mark.slow
def test_sweep_measures_all_programs(swept):
    printed, rows = swept
    programs = [(row["program"].split(",")[0], row["cores"]) for row in rows[:-1]]
    others = [("Exudyn", 2)] * bool(find_spec("exudyn")) + [("SciPy", 2)]
    assert programs == [("sweep", 1), ("sweep", 2), ("loop over simulate", 1), *others]
    assert any("times as fast on 2 cores as on one" in line for line in printed)


@pytest.mark.slow
def test_sweep_counts_what_single_runs_count(swept):
    one, two, loop = (row["runs"][0] for row in swept[1][:3])
    assert one["steps"] == two["steps"]
    assert abs(loop["steps"] - one["steps"]) < 0.05 * one["steps"]
    assert one["right_hand_sides"] == 6 * one["steps"] + sweep.QUICK_LANES
    assert one["turns"] >= one["steps"]


def test_operations_are_counted():
    def polynomial(x, y):
        return jnp.where(x > y, jnp.sin(x) * y + 1.0, jax.jit(jnp.sqrt)(x) - y)

    assert jaxpr_operations(jax.make_jaxpr(polynomial)(1.0, 2.0).jaxpr) == 5


@pytest.mark.slow
def test_scaling_measures_lanes_and_chains(tmp_path):
    _, rows = records_of(tmp_path, "scaling")
    lanes, rods = rows[: len(scaling.QUICK_LANES)], rows[len(scaling.QUICK_LANES) :]
    assert [row["lanes"] for row in lanes] == list(scaling.QUICK_LANES)
    assert all(row["peak memory, MB"] > 50.0 and row["ms a lane"] > 0.0 for row in lanes)
    assert [row["rods"] for row in rods] == list(scaling.QUICK_RODS)
    assert all(row["µs a right-hand side"] > 0.0 for row in rods)


def test_chain_falls_freely_until_it_touches():
    scene, state = chain(1)
    end = cj.simulate(scene, state, 5e-3, progress=False).final
    fallen = [float(end.bodies[name].position[1]) for name in scene.bodies]
    np.testing.assert_allclose(fallen, -0.5 * 9.81 * 5e-3**2, rtol=1e-9)


def test_worker_answers_and_says_when_it_cannot():
    with Worker(1) as worker:
        assert worker.ask("math:gcd") == 0
        with pytest.raises(RuntimeError, match="math:nothing"):
            worker.ask("math:nothing")
    with pytest.raises(ValueError, match="100000 cores are wanted"):
        Worker(100_000)
