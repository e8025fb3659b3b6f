"""The benchmark: its rows in the quick setting, and the agreement of its C++ with clearjoint."""

import json
from importlib.util import find_spec
from math import isfinite

import numpy as np
import pytest

from studies.benchmark import __main__ as benchmark
from studies.benchmark import backlash_chain, derivatives, sweeps, table, yardstick
from studies.benchmark.table import BEGIN, END, Plan, Row, row


@pytest.fixture(autouse=True)
def programs_as_they_are(monkeypatch):
    """Or those of all tests before would be optimised."""
    monkeypatch.setattr(table, "optimise_programs", lambda: None)


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    program = yardstick.build(tmp_path_factory.mktemp("yardstick"))
    if program is None:
        pytest.skip("the system has no C++ compiler")
    return Plan(True, 1, program)


@pytest.mark.slow
@pytest.mark.parametrize("kind", yardstick.WIDTHS)
def test_yardstick_moves_as_clearjoint(plan, kind):
    plan.yardstick.agreement(kind).check()


def test_another_motion_is_no_agreement():
    with pytest.raises(RuntimeError, match="does not move"):
        yardstick.Agreement(1e-12, 1e-12, 1e-6).check()


@pytest.mark.slow
def test_eight_lanes_take_the_steps_of_one(plan):
    clearances = (sweeps.LEAST, sweeps.MOST, 11)
    one, eight = (plan.yardstick.run(kind, 0.03, 1e-6, clearances) for kind in yardstick.WIDTHS)
    assert one.attempts.tolist() == eight.attempts.tolist()
    np.testing.assert_allclose(eight.positions, one.positions, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(eight.onsets, one.onsets, rtol=1e-11)


@pytest.mark.slow
def test_run_has_its_impact_where_free_fall_ends(plan):
    found = plan.yardstick.run(yardstick.SCALAR, 0.02, 1e-8)
    fall = np.sqrt(2.0 * yardstick.CLEARANCE / 9.81)
    assert found.onsets[0] == pytest.approx(fall, rel=1e-9)
    assert found.speeds[0] == pytest.approx(9.81 * fall, rel=1e-9)


def test_no_compiler_is_said(tmp_path, monkeypatch, capsys):
    monkeypatch.delenv("CXX", raising=False)
    monkeypatch.setattr(yardstick.shutil, "which", lambda name: None)
    assert yardstick.build(tmp_path) is None
    monkeypatch.setenv("CXX", "false")
    assert yardstick.build(tmp_path) is None
    printed = capsys.readouterr().out
    assert "No C++ compiler" in printed and "failed: rows with C++ have no ratio" in printed


@pytest.mark.slow
@pytest.mark.parametrize("group", benchmark.GROUPS)
def test_every_group_has_rows_with_times_and_ratios(group, plan):
    """The time of a step is a difference, which noise may make negative in one short round."""
    rows = benchmark.GROUPS[group](plan)
    assert rows and all(isfinite(one.seconds) for one in rows)
    if group != "first-calls" and (group != "backlash" or find_spec("mujoco")):
        assert any(one.ratio is not None and isfinite(one.ratio) for one in rows)


@pytest.mark.slow
def test_derivatives_by_all_parameters_begin_with_those_that_are_known():
    assert len(derivatives.PARAMETERS) == derivatives.COUNTS[-1]
    found = derivatives.derivatives(3, derivatives.TOLERANCES[0], derivatives.SPAN)
    known = derivatives.REFERENCE[derivatives.SPAN]
    np.testing.assert_allclose(found.derivatives["height"][0], known, rtol=1e-5)


@pytest.mark.slow
def test_chains_of_both_programs_are_alike():
    here = backlash_chain.ClearjointChain(1)
    angles, _ = here.run(1e-9)
    alone = backlash_chain.SPEED * backlash_chain.SPAN  # of a rotor that meets nothing
    assert 0.0 < angles[0] < alone
    if find_spec("mujoco"):
        there, _ = backlash_chain.MujocoChain(1).run(1e-6)
        np.testing.assert_allclose(there, angles, atol=1e-5)
        # The contacts of three joints load each other.
        there, _ = backlash_chain.MujocoChain(3).run(1e-6)
        angles, _ = backlash_chain.ClearjointChain(3).run(1e-9)
        np.testing.assert_allclose(there, angles, atol=2e-5)


def test_calls_take_turns_after_a_first_one_each():
    order = []

    def call(name):
        return lambda k: order.append((name, k)) or table.Sample(1.0 + k)

    found = table.interleaved({"a": call("a"), "b": call("b")}, 2)
    assert order == [("a", 0), ("b", 0), ("a", 0), ("b", 0), ("a", 1), ("b", 1)]
    assert [sample.seconds for sample in found["b"]] == [1.0, 2.0]


def test_row_has_median_and_range_of_the_ratios_of_its_rounds():
    found = row("run", np.array([2.0, 3.0, 8.0]), np.array([1.0, 2.0, 2.0]), "C++", 2.5)
    assert (found.ratio, found.spread, found.aim) == (2.0, (1.5, 4.0), 2.5)
    assert found.cells() == ("run", "3 s", "2 s, C++", "2 (1.5 … 4)", "2.5")
    alone = row("call", np.array([2e-3]), aim=1e-3)
    assert alone.cells() == ("call", "2 ms", "", "", "1 ms")
    assert [table.shown(t) for t in (0.9999, 1.25e-5, 3e-10)] == ["1 s", "12.5 µs", "0.3 ns"]


def test_table_stands_between_the_markers_of_a_file(tmp_path):
    file = tmp_path / "README.md"
    file.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    for _ in range(2):
        table.replace_table(file, "| new |")
    assert file.read_text() == f"before\n{BEGIN}\n\n| new |\n\n{END}\nafter\n"
    file.write_text("no markers")
    with pytest.raises(ValueError, match="must have the lines"):
        table.replace_table(file, "| new |")


def test_readme_has_the_markers():
    text = (benchmark.HERE / "README.md").read_text(encoding="utf-8")
    assert text.index(BEGIN) < text.index(END)


def test_command_writes_table_records_and_picture(tmp_path, monkeypatch, capsys):
    rows = [Row("run", 2.0, "C++", 1.0, 2.0, (1.9, 2.1), 1.5)]
    monkeypatch.setattr(benchmark, "build", lambda folder: None)
    monkeypatch.setitem(benchmark.GROUPS, "runs", lambda plan: rows)
    benchmark.main(["runs", "--quick", "--output", str(tmp_path)])
    assert "| run | 2 s | 1 s, C++ | 2 (1.9 … 2.1) | 1.5 |" in capsys.readouterr().out
    assert "| run |" in (tmp_path / "benchmark.md").read_text(encoding="utf-8")
    assert json.loads((tmp_path / "benchmark.json").read_text())["rows"][0]["ratio"] == 2.0
    assert (tmp_path / "benchmark.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nothing"], "NAME must be of runs, sweeps"),
        (["--rounds", "0"], "--rounds must be at least 1"),
        (["--write", "--quick"], "--write needs a full run"),
    ],
)
def test_wrong_command_lines_say_what_is_wrong(words, message, capsys):
    with pytest.raises(SystemExit):
        benchmark.parse(words)
    assert message in capsys.readouterr().err
