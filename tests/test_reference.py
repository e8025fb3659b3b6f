"""Trajectories and impact tables against an event-exact solver in extended precision."""

import diffrax
import numpy as np
import pytest
from reference import CASES, Case

import clearjoint as cj

COLUMNS = {
    "onset": "t_on", "entry_speed": "v_minus", "peak_force": "F_peak", "duration": "duration",
}


def _run(case: Case, times: np.ndarray, rtol: float, solver=None) -> cj.Solution:
    scene, state = cj.double_pendulum(case.clearance, case.restitution)
    return cj.simulate(
        scene, state, case.safe, save_at=np.minimum(times, case.safe), rtol=rtol,
        record_impacts=True, solver=solver,
    )


def _position_errors(solution: cj.Solution, reference: dict[str, np.ndarray]) -> np.ndarray:
    errors = [
        np.abs(solution.states.bodies[body].position[:, k] - reference[f"r{number}{axis}"])
        for body, number in (("arm 2", 2), ("arm 3", 3))
        for k, axis in enumerate("xyz")
    ]
    return np.max(errors, axis=0)


@pytest.mark.parametrize("case", CASES, ids=str)
@pytest.mark.parametrize("solver", [diffrax.Tsit5(), diffrax.Dopri8()], ids=["Tsit5", "Dopri8"])
def test_trajectories_and_impacts(case, solver, reference_folder):
    reference = case.trajectory(reference_folder)
    solution = _run(case, reference["t"], 1e-10, solver)
    assert _position_errors(solution, reference).max() < 1e-6
    for base in "VW":
        expected = case.impacts(reference_folder, base)
        expected["duration"] = expected["t_off"] - expected["t_on"]
        found = solution.impacts.of("shoulder", base)
        count = len(expected["t_on"])
        assert len(found) >= count
        early = expected["t_off"] <= 0.5 * case.safe
        for name, column in COLUMNS.items():
            errors = np.abs(getattr(found, name)[:count] / expected[column] - 1.0)
            print(case, base, name, errors[early].max(), errors.max())
            assert errors[early].max() < EARLY[type(solver)], (base, name)
            assert errors.max() < LATE.get(case.clearance, 5e-3), (base, name)
