"""The study of extremes: its quick setting, its invariants, and refused numbers."""

import equinox as eqx
import numpy as np
import pytest

import clearjoint as cj
from studies.extremes import findings as extremes
from studies.extremes.cases import BASE, damping_factor, delivered, thrown
from studies.extremes.entries import REFUSED, RIGHT, WRONG, judged
from studies.extremes.families import FAMILIES
from studies.extremes.figure import drawn_map
from studies.extremes.invariants import contact_energy, kinetic_energy, poses
from studies.extremes.report import case_table
from studies.extremes.runs import Lane
from studies.extremes.single_runs import four_bar


@pytest.fixture(scope="module")
def findings():
    return extremes.find(quick=True, scenes=24, seed=7)


@pytest.mark.slow
def test_nothing_is_wrong(findings):
    assert findings.wrong() == 0
    (random,) = findings.batches
    assert sum(lane.successful for lane in random.lanes) >= 12
    assert all(np.isfinite(value) for lane in random.lanes for value in lane.violations.values())


@pytest.mark.slow
def test_every_case_is_right_somewhere(findings):
    assert len(findings.rows) == 8
    for row in findings.rows:
        assert row.count(RIGHT) >= 5, row.name
        assert row.worst <= row.bound


@pytest.mark.slow
@pytest.mark.parametrize("name", ["deep start", "tilted journal"])
def test_a_journal_in_the_wall_has_left_its_bearing(findings, name):
    (row,) = [row for row in findings.rows if row.name == name]
    reasons = [entry.reason for entry in row.entries if entry.verdict == REFUSED]
    assert reasons == ["left_bearing", "left_bearing"]


@pytest.mark.slow
def test_impossible_numbers_are_refused_with_a_remedy(findings):
    for refusal in findings.refused:
        assert refusal.message.startswith("Argument `"), refusal.attempt
        assert ": " in refusal.message, refusal.attempt


@pytest.mark.slow
def test_report_and_map(findings, tmp_path):
    text = extremes.report(findings)
    assert "Wrong in all: 0." in text
    assert text.count("\n| ") > 30
    drawn_map(findings.rows, findings.batches).savefig(tmp_path / "map.png")


@pytest.mark.slow
def test_two_thousand_random_scenes():
    findings = extremes.find(quick=False, scenes=300, seed=extremes.SEED)
    assert sum(len(one.lanes) for one in findings.batches) >= 2000
    assert findings.wrong() == 0, case_table(findings.rows)


@pytest.mark.parametrize("violation", [1.1, np.nan])
def test_success_with_a_violated_invariant_is_wrong(violation):
    assert Lane("successful", 1, {}, {"energy": violation}).wrong
    assert not Lane("max_steps_reached", 1, {}, {"energy": violation}).wrong
    assert judged(1.0, "successful", violation, 1.0).verdict == WRONG


def test_restitution_identity_agrees_with_its_series():
    """e = 1 - 2 chi/3 for weak damping; 0.9132 for a requested 0.9 by quadrature."""
    assert float(delivered(1e-6)) == pytest.approx(1.0 - 2e-6 / 3.0, abs=1e-9)
    assert float(delivered(damping_factor(0.9))) == pytest.approx(0.9132, abs=5e-5)


def test_energies_of_a_known_state():
    """Both bases have a penetration of 1e-4 m and a speed of 0.1 m/s."""
    draw = BASE | {"eccentricity": 1.0 + 1e-4 / BASE["clearance"]}
    trial = FAMILIES["thrown journal"].trial(draw)
    at = poses(trial.state)
    assert float(kinetic_energy(trial.scene, at)) == pytest.approx(0.5 * 0.1**2)
    stored = 2 * BASE["stiffness"] * 1e-4**2.5 / 2.5
    assert float(contact_energy(trial.scene, at)) == pytest.approx(stored, rel=1e-9)


@pytest.mark.parametrize("skew, refused", [(1e-9, False), (1e-7, True), (9e-7, True)])
def test_constraints_that_nearly_depend_on_others_are_told(skew, refused):
    report = cj.constraint_report(*four_bar(0.7, skew))
    assert bool(report.uncertain) == refused
    assert len(report.redundant) == (2 if refused else 3)


def test_a_start_with_nothing_to_go_by_is_refused():
    trial = thrown(BASE)
    body = trial.state.bodies["journal"]
    flat = eqx.tree_at(lambda b: b.orientation, body, np.zeros(4))
    for state in (
        cj.State({"journal": flat}),
        cj.State({"journal": body}, entry_speeds={"pin": {"V": np.nan, "W": 0.0}}),
        cj.State({"journal": body}, work={"supplied": np.inf}),
    ):
        with pytest.raises(ValueError, match=r"Argument `state\."):
            cj.simulate(trial.scene, state, 1e-3)
