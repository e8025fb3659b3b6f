"""Levels of LLVM's optimisation: results do not depend on them, but saved programs do."""

import inspect
from collections.abc import Iterator

import jax
import llvmlite.binding as llvm
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._native import Native, NativeFunction, machine_code, over_rows
from clearjoint._native.llvm_text import LONGEST_BLOCK
from clearjoint._native.machine_code import FOR_FEW_RUNS, FOR_LOOPS, _key
from clearjoint._simulation.results import observe
from clearjoint._simulation.run import host_run, simulate
from studies.benchmark.backlash_chain import chain
from studies.benchmark.chain import ideal_chain
from studies.benchmark.first_calls import four_bar

SCENES = [
    pytest.param(lambda: ideal_chain(1), id="rod"),
    pytest.param(
        lambda: cj.mechanisms.double_pendulum(0.5e-3, 0.9), id="pendulum", marks=pytest.mark.slow
    ),
    pytest.param(four_bar, id="four-bar", marks=pytest.mark.slow),
    pytest.param(lambda: chain(2), id="backlash", marks=pytest.mark.slow),
]


@pytest.fixture
def levels_of_users(monkeypatch) -> Iterator[None]:
    """LLVM's levels, which fast tests replace by level 0; programs are neither saved nor read."""
    for owner, name in (
        (llvm, "create_pipeline_tuning_options"),
        (llvm.Target, "create_target_machine"),
    ):
        monkeypatch.setattr(owner, name, inspect.unwrap(getattr(owner, name)))
    monkeypatch.setattr(machine_code, "_store", lambda: None)
    machine_code._target_machine.cache_clear()
    yield
    machine_code._target_machine.cache_clear()


@pytest.mark.usefixtures("levels_of_users")
@pytest.mark.parametrize("make", SCENES)
def test_bits_of_a_run_do_not_depend_on_the_level(make, monkeypatch):
    scene, state = make()
    found, codes = {}, set()
    for few_runs in (False, True):
        programs = Native(host_run.segment, few_runs=few_runs)
        monkeypatch.setattr(host_run, "segment_compiled", programs)
        begun = Native(host_run.begin, few_runs=few_runs)
        monkeypatch.setattr(simulate, "begin_compiled", begun)
        solution = cj.simulate(scene, state, 0.02, save=cj.Saving(impacts=True), progress=False)
        assert programs.native.count() == begun.native.count() == 1
        ((program, _),) = programs.native._programs.values()
        codes.add(program.code._object_file)
        arrays = jax.tree.leaves((solution.final, solution.time, solution.attempts))
        bits = b"".join(np.ascontiguousarray(one).tobytes() for one in arrays)
        assert solution.impacts is not None
        found[few_runs] = bits, solution.impacts.to_dataframe().to_csv()
    assert found[False] == found[True] and len(codes) == 2


def product_and_sum(x):
    return x * x + 1.0


def test_programs_of_both_levels_are_saved_apart(tmp_path, monkeypatch):
    before = jax.config.jax_compilation_cache_dir  # pyright: ignore
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    try:
        for few_runs in (False, True, False, True):
            # Each is made as in another process.
            assert NativeFunction(product_and_sum, few_runs)(np.asarray(3.0)) == 10.0
    finally:
        jax.config.update("jax_compilation_cache_dir", before)
    assert len([file for file in (tmp_path / "native").rglob("*") if file.is_file()]) == 2
    # Code that was changed while it was imported, as by a debugger, has no digest.
    monkeypatch.setattr(machine_code, "source_digest", str)
    keys = {_key(host_run.begin, (np.zeros(3),), level) for level in (FOR_FEW_RUNS, FOR_LOOPS)}
    assert len(keys) == 2


def test_only_the_first_rows_are_computed():
    def shifted(number, row):
        return {"sum": number + row.sum(), "row": row * number, "low": number < 2.0}

    def all_rows(count, numbers, rows):
        return over_rows(shifted, count, numbers, rows)

    random = np.random.default_rng(0)
    numbers, rows = np.arange(600.0), random.uniform(size=(600, 3))
    function = NativeFunction(all_rows)
    for count in (0, 1, 7, 600):
        found = function(np.asarray(count), numbers, rows)
        expected = shifted(numbers[:, None], rows)["row"]
        np.testing.assert_array_equal(found["row"][:count], expected[:count])
        np.testing.assert_array_equal(found["low"], (numbers < 2.0) & (numbers < count))
        assert not found["sum"][count:].any()


@pytest.mark.slow
def test_observations_of_few_and_many_states_have_equal_bits(monkeypatch):
    scene, state = cj.mechanisms.double_pendulum(0.5e-3, 0.9)
    times = np.linspace(0.0, 0.02, 700)
    solution = cj.simulate(scene, state, 0.02, save=cj.Saving(times), progress=False)
    bits = []
    for few in (0, 1000):
        monkeypatch.setattr(observe, "FEW", few)
        leaves = jax.tree.leaves(cj.observe(scene, solution))
        bits.append(b"".join(np.ascontiguousarray(leaf).tobytes() for leaf in leaves))
    assert bits[0] == bits[1]


def test_straight_code_is_written_in_short_blocks():
    """LLVM's time without optimisation grew with the square of a block's length."""

    def powers(x: jax.Array) -> jax.Array:
        for k in range(1000):
            x = x * x + float(k)
        return x

    function = NativeFunction(powers, few_runs=True)
    function(np.asarray(0.5))
    (program, _), *_ = function._programs.values()
    blocks = program.code.text.split("br label")
    assert max(block.count("\n") for block in blocks) < 2 * LONGEST_BLOCK
