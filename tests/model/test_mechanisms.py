"""Ideal mechanisms against published and independently computed values."""

import diffrax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import clearjoint as cj
from clearjoint.mechanisms import bricard, double_four_bar

FINE = cj.Settings(solver=diffrax.Dopri8(), rtol=1e-10, stabilisation=cj.Projection())


def end_point(body: cj.BodyState, local: tuple[float, float, float]) -> np.ndarray:
    turn = Rotation.from_quat(body.orientation, scalar_first=True)
    return body.position + turn.apply(local)


@pytest.mark.slow
def test_double_four_bar():
    """Benchmark A02 through its singular positions: tip of the first rod at 10 s."""
    scene, state = double_four_bar()
    solution = cj.simulate(scene, state, 10.0, FINE, save=cj.Saving([10.0]))
    assert len(solution.redundant_constraints) == 6
    tip = end_point(solution.states.bodies["rod 1"], (0.5, 0.0, 0.0))[0]
    np.testing.assert_allclose(tip[:2], (0.328458111536, 0.944518538180), atol=1e-6)
    observed = cj.observe(scene, solution)
    assert not observed.reactions_unique
    assert max(drift.max() for drift in observed.drift.values()) < 1e-8


@pytest.mark.slow
def test_bricard():
    """Benchmark A04: one redundant constraint. Values from an independent least-squares KKT code,
    agreeing to 1e-10 at two tolerances, and to 8 digits with Exudyn at 1 s."""
    scene, state = bricard()
    report = cj.constraint_report(scene, state)
    assert len(report.redundant) == 1
    assert report.degrees_of_freedom() == 1
    solution = cj.simulate(scene, state, 2.0, FINE, save=cj.Saving([0.5, 1.0, 2.0]))
    corner = end_point(solution.states.bodies["rod 2"], (0.0, -0.5, 0.0))
    expected = [
        (0.7747178080, -0.9798150477, -0.1999061590),
        (0.2744813193, -0.8867079387, -0.4623300027),
        (-0.7781353730, -0.9803526834, -0.1972526706),
    ]
    np.testing.assert_allclose(corner, expected, rtol=0.0, atol=1e-7)


def test_reactions_of_redundant_constraints_have_least_norm():
    """A door on two hinges: weight shared equally along the common axis, twice the same row."""
    hinges = {
        f"hinge {k}": cj.RevoluteJoint("ground", "door", (0, 0, z), (0, 0, z), (0, 0, 1), (0, 0, 1))
        for k, z in enumerate((-0.5, 0.5))
    }
    door = cj.Body(2.0, (1.0, 1.0, 1.0))
    scene = cj.Scene({"door": door}, hinges, gravity=(0.0, 0.0, -9.81))
    state = cj.State({"door": cj.body_state((0.0, 0.0, 0.0))})
    solution = cj.simulate(scene, state, 1e-3, save=cj.Saving([1e-3]))
    observed = cj.observe(scene, solution)
    assert len(solution.redundant_constraints) == 5
    for hinge in ("hinge 0", "hinge 1"):
        force = observed.reactions[hinge]["door"].force[0]
        np.testing.assert_allclose(force, (0.0, 0.0, 9.81), rtol=1e-6, atol=1e-9)
