"""Trajectories and impact tables against an event-exact solver in extended precision."""

from pathlib import Path

import diffrax
import numpy as np
import pytest

import clearjoint as cj
from tests.support.reference import CASES, Case

COLUMNS = {
    "onset": "t_on",
    "separation": "t_off",
    "duration": "duration",
    "entry_speed": "v_minus",
    "exit_speed": "v_plus",
    "peak_force": "F_peak",
    "peak_time": "t_F_peak",
    "largest_penetration": "delta_max",
}


EXACT = cj.Settings(solver=diffrax.Dopri8(), rtol=1e-10)


def _run(
    case: Case, folder: Path, settings: cj.Settings, impacts: bool = False
) -> tuple[cj.results.Solution, dict[str, np.ndarray]]:
    """A run that is saved at the times of the reference, and this."""
    reference = case.trajectory(folder)
    scene, state = cj.mechanisms.double_pendulum(case.clearance, case.restitution)
    save = cj.Saving(np.minimum(reference["t"], case.safe), impacts=impacts)
    return cj.simulate(scene, state, case.safe, settings, save), reference


def _position_errors(solution: cj.results.Solution, reference: dict[str, np.ndarray]) -> np.ndarray:
    errors = [
        np.abs(solution.states.bodies[body].position[:, k] - reference[f"r{number}{axis}"])
        for body, number in (("arm 2", 2), ("arm 3", 3))
        for k, axis in enumerate("xyz")
    ]
    return np.max(errors, axis=0)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_trajectories_and_impacts(case, reference_folder):
    """At rtol 1e-10: positions to 1e-6 m; impacts to 1e-6 in the first half, 5e-3 to the end."""
    solution, reference = _run(case, reference_folder, EXACT, impacts=True)
    assert _position_errors(solution, reference).max() < 1e-6
    for base in "VW":
        expected = case.impacts(reference_folder, base)
        expected["duration"] = expected["t_off"] - expected["t_on"]
        expected["v_plus"] *= -1.0
        found = solution.impacts.of("shoulder", base)
        count = len(expected["t_on"])
        assert len(found) >= count
        early = expected["t_off"] <= 0.5 * case.safe
        for name, column in COLUMNS.items():
            errors = np.abs(getattr(found, name)[:count] / expected[column] - 1.0)
            assert errors[early].max() < 1e-6, (base, name)
            assert errors.max() < 5e-3, (base, name)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("solver", "order", "exponents"),
    [
        (diffrax.Heun(), 2, (4, 5, 6, 7)),
        (diffrax.Bosh3(), 3, (4, 5, 6, 7, 8)),
        (diffrax.Tsit5(), 5, (4, 5, 6, 7, 8, 9)),
    ],
    ids=["Heun", "Bosh3", "Tsit5"],
)
def test_error_falls_at_the_order_of_the_solver_across_impacts(
    solver, order, exponents, reference_folder
):
    """Four impacts of each base lie before 0.07 s. Error against steps at the solver's order, and
    proportional to the tolerance."""
    tolerances = 10.0 ** -np.array(exponents)
    errors, steps = [], []
    for rtol in tolerances:
        settings = cj.Settings(solver=solver, rtol=rtol)
        solution, reference = _run(Case(5e-4, 0.9, 0.07), reference_folder, settings)
        errors.append(_position_errors(solution, reference).max())
        steps.append(int(solution.accepted))
    by_steps = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    by_tolerance = np.polyfit(np.log(tolerances), np.log(errors), 1)[0]
    assert by_steps > order - 0.35
    assert by_tolerance > 0.8


@pytest.mark.parametrize(
    ("preset", "error"), [("preview", 2e-7), ("accurate", 8e-12), ("reference", 1e-13)]
)
def test_presets_are_as_exact_as_they_say(preset, error, reference_folder):
    """Eleven contacts lie before 0.1 s. What `clearjoint.presets` says, with room of two."""
    case, settings = Case(5e-4, 0.9, 0.1), getattr(cj.presets, preset)
    found = _run(case, reference_folder, settings, impacts=preset == "reference")
    assert error / 100 < _position_errors(*found).max() < error


def test_forces_and_reactions_match_the_reference(reference_folder):
    solution, reference = _run(Case(5e-4, 0.9, 0.1), reference_folder, EXACT, impacts=True)
    scene, _ = cj.mechanisms.double_pendulum()
    observed = cj.observe(scene, solution)
    reaction = np.stack([reference[name] for name in ("Rx", "Ry", "Rz")], axis=1)
    assert np.abs(observed.reactions["elbow"]["arm 3"].force - reaction).max() < 0.05
    assert observed.drift["elbow"].max() < 1e-15 and observed.drift_rate["elbow"].max() < 1e-14
    for base in "VW":
        contact = observed.contacts["shoulder"][base]
        assert np.abs(contact.normal_force - reference[f"F{base}"]).max() < 0.1
        assert np.abs(contact.eccentricity - reference[f"e{base}"]).max() < 1e-9
        assert np.abs(contact.penetration_rate - reference[f"dd{base}"]).max() < 1e-6
    linear = observed.accelerations["arm 3"].linear[:, 1]
    assert np.abs(linear - reference["a3y"]).max() < 0.01
    for name, column in (("kinetic", "T"), ("gravity", "Ug"), ("contacts", "Uel")):
        start = observed.energies[name][0]
        assert np.abs(observed.energies[name] - start - reference[column]).max() < 1e-6
