"""The study of gradients: its quick tables."""

import numpy as np
import pytest

from studies.gradients import accuracy, friction, joints, lanes, memory


@pytest.mark.slow
def test_gradients_by_few_numbers_are_as_accurate_as_forward_mode():
    rows = accuracy.measure(quick=True)
    assert [row.parameters for row in rows] == [1, 10]
    for row in rows:
        assert row.reverse_error < max(1e-6, 5.0 * row.forward_error) and row.along < 1e-5
    assert len(accuracy.table(rows)) == 3


@pytest.mark.slow
def test_quick_friction_law(tmp_path):
    fit = friction.measure(quick=True)
    (points,) = fit.windows
    assert fit.last.misfit < 0.05 * points[0].misfit
    friction.figure(fit).savefig(tmp_path / "friction.png")
    rows = dict(friction.table(fit))
    assert rows["weights"] == "321" and rows["iterations"] == "1"
    # Where the record holds no slip, the law keeps the spread of the prior.
    slow, held, fast = friction.deviations(fit.last, np.array([1e-3, 0.04, 2.0]))
    assert held < 0.2 * fast and slow > 0.0


@pytest.mark.slow
def test_gradients_of_a_chain_with_backlash():
    rows = dict(joints.table(quick=True))
    assert rows["joints; parameters"] == "1; 4"
    assert float(rows["difference from forward mode"]) < 1e-6
    assert float(rows["error along a direction"]) < 1e-6


@pytest.mark.slow
def test_a_batch_of_gradients_has_the_bits_of_single_calls():
    (row,) = lanes.measure(quick=True)
    assert row.runs == 3 and row.same_bits
    assert lanes.table([row])[1][0] == "rod, p = 1"


@pytest.mark.slow
def test_tables_of_long_runs_and_first_gradients(monkeypatch):
    monkeypatch.setattr(memory, "STEPS", (20,))
    (_, (steps, _, _)) = memory.long_run(quick=True)
    assert int(steps) >= 20
    monkeypatch.setattr(memory, "lines_of_process", lambda *_: (["1.5"], False))
    assert memory.firsts(quick=True)[1] == ("double pendulum", "1.5 s")
