"""Runs of many steps: norm of Euler parameters, angles, memory, and the study of their drift."""

import numpy as np
import pytest

import clearjoint as cj
from clearjoint.extend import within_two_turns
from studies.cost import long_runs


def test_angles_lose_double_turns_and_nothing_else():
    inside = np.linspace(-6.28, 6.28, 101)
    assert (within_two_turns(inside) == inside).all()
    for turns in (2, -4, 1000):
        angle = 0.75 + 2.0 * np.pi * turns
        assert float(within_two_turns(angle)) == pytest.approx(0.75, abs=1e-12)


def spinning_pendulum():
    scene, _ = long_runs.pendulum()
    body = cj.body_state((0.5, 0.0, 0.0), velocity=(0.0, 50.0, 0.0), spin=(0.0, 0.0, 100.0))
    return scene, cj.State({"rod": body})


def test_a_thousand_turns_of_a_pendulum_are_as_good_as_the_first():
    """With a tolerance relative to all revolutions the energy error would be three times larger."""
    case = long_runs.Case("spinning", spinning_pendulum, 1e-6)
    outcome = long_runs.run(case, 1000.0, 1_000_000)
    assert outcome.time == 1000.0
    assert outcome.residuals is not None and outcome.residuals.max() < 1e-14
    early, late = (np.abs(outcome.energy[at]) for at in (144, 1440))
    assert late < 0.45 and late == pytest.approx(10.0 * early, rel=0.1)


@pytest.mark.slow
def test_quick_runs_do_not_drift(tmp_path):
    cases, span = long_runs.QUICK
    ideal, top = (long_runs.run(case, span, long_runs.MAX_STEPS) for case in cases)
    assert ideal.time == top.time == span
    assert ideal.residuals is not None and ideal.residuals.max() < 1e-14
    assert top.norm < 1e-3 and abs(ideal.mechanical[-1]) < 1e-2
    long_runs.figure([ideal, top]).savefig(tmp_path / "figure.png")
    head, *rows = long_runs.table([ideal, top])
    assert [len(row) for row in rows] == [len(head)] * 2


@pytest.mark.slow
def test_a_late_start_changes_little():
    (found,) = long_runs.late_starts((1e-6,))
    assert found.position < 1e-9 and found.entry_speed < 1e-6 and found.onset < 1e-9
