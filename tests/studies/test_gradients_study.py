"""The study of gradients: its quick tables."""

import pytest

from studies.gradients import accuracy, memory


@pytest.mark.slow
def test_gradients_by_few_numbers_are_as_accurate_as_forward_mode():
    rows = accuracy.measure(quick=True)
    assert [row.parameters for row in rows] == [1, 10]
    for row in rows:
        assert row.reverse_error < max(1e-6, 5.0 * row.forward_error) and row.along < 1e-5
    assert len(accuracy.table(rows)) == 3


@pytest.mark.slow
def test_quick_friction_law(tmp_path):
    from studies.gradients import friction

    fit = friction.measure(quick=True)
    assert fit.misfits[-1] < fit.misfits[0]
    friction.figure(fit).savefig(tmp_path / "friction.png")
    assert friction.table(fit)[0] == ("weights", "321")


@pytest.mark.slow
def test_tables_of_long_runs_and_first_gradients(monkeypatch):
    monkeypatch.setattr(memory, "STEPS", (20,))
    (_, (steps, _, _)) = memory.long_run(quick=True)
    assert int(steps) >= 20
    monkeypatch.setattr(memory, "lines_of_process", lambda *_: (["1.5"], False))
    assert memory.firsts(quick=True)[1] == ("double pendulum", "1.5 s")
