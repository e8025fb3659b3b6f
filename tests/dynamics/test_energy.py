"""The energy ledger closes over four seconds, and constraints do not drift."""

import numpy as np
import pytest

import clearjoint as cj
from tests.support.observations import observation_of


@pytest.mark.slow
@pytest.mark.parametrize("restitution", [0.1, 0.5, 0.9, 1.0])
def test_ledger_closes(restitution):
    scene, state = cj.mechanisms.double_pendulum(restitution=restitution)
    settings = cj.Settings(rtol=1e-8, stabilisation=cj.Projection(), ledger=True)
    solution = cj.simulate(scene, state, 4.0, settings, cj.Saving(steps=True))
    observed = cj.observe(scene, solution, solution.steps)
    exchanged = np.ptp(observed.energies["gravity"])
    assert exchanged > 50.0
    assert np.abs(observed.ledger_residual()).max() < 1e-6 * exchanged
    dissipated = observed.energies["normal damping"][-1]
    if restitution == 1.0:
        change = np.abs(observed.energies["mechanical"] - observed.energies["mechanical"][0])
        assert change.max() < 1e-6 * exchanged
    else:
        assert dissipated > 1.0
    assert observed.drift["elbow"].max() < 1e-8


def test_an_observation_at_no_times_has_no_residual():
    none = np.zeros(0)
    observed = observation_of(none, energies={"mechanical": none})
    assert observed.ledger_residual().shape == (0,)


@pytest.mark.slow
def test_friction_dissipates_and_is_booked():
    """For a body sliding on the bearing's wall, the ledger closes with friction."""
    scene, state = cj.mechanisms.double_pendulum(friction=cj.frictions.RegularisedCoulomb(0.1))
    settings, save = cj.Settings(rtol=1e-8, ledger=True), cj.Saving(np.linspace(0, 0.5, 50))
    solution = cj.simulate(scene, state, 0.5, settings, save)
    observed = cj.observe(scene, solution)
    exchanged = np.ptp(observed.energies["gravity"])
    assert observed.energies["friction"][-1] > 1e-3 * exchanged
    assert (np.diff(observed.energies["friction"]) >= -1e-12).all()
    assert np.abs(observed.ledger_residual()).max() < 1e-6 * exchanged
