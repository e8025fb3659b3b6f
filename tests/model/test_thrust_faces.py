"""Friction of the thrust faces at the ends of a bearing: forces, and a shaft that runs down."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import clearjoint as cj
from clearjoint import GROUND
from tests.support import many_states

AXIS = np.array([2.0, -1.0, 2.0]) / 3.0
COEFFICIENT, FULL_SPEED, RADIUS, STIFFNESS, PLAY = 0.15, 0.05, 12e-3, 1e8, 0.2e-3
MASS, INERTIA, GRAVITY = 2.0, 4e-4, 9.81


def shaft_on_face(axis=AXIS):
    """A shaft whose weight presses it on the lower shoulder of a bearing."""
    friction = cj.frictions.LinearCoulomb(COEFFICIENT, FULL_SPEED)
    joint = cj.ClearanceJoint(
        *(GROUND, "shaft"),
        bearing_axis=axis,
        journal_axis=axis,
        bearing_radius=10e-3,
        clearance=0.1e-3,
        journal_length=20e-3,
        law=cj.laws.Hertz(1e9),
        axial=cj.EndPlay(PLAY, cj.laws.Hertz(STIFFNESS), friction, RADIUS),
    )
    shaft = cj.Body(MASS, (3e-4, 3e-4, INERTIA))
    return cj.Scene({"shaft": shaft}, {"pin": joint}, gravity=-GRAVITY * axis)


ACROSS = np.array([1.0, 2.0, 0.0]) / np.sqrt(5.0)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("speed", "spin"), [(0.3, 0.0), (0.0, 40.0), (0.0, -40.0), (0.4, 70.0), (0.01, 1.0)]
)
def test_friction_opposes_sliding_and_rotation_at_the_mean_radius(side, speed, spin):
    """With mu N v/s and mu N r^2 w/s at the slip speed s above the full speed, and s/v_d of that
    below it."""
    scene, depth = shaft_on_face(), 1e-5
    centre, velocity = side * (0.5 * PLAY + depth) * AXIS, speed * ACROSS
    turn = Rotation.from_rotvec(0.7 * AXIS)
    parts = centre, turn.as_quat(scalar_first=True), velocity, turn.inv().apply(spin * AXIS)
    state = cj.State({"shaft": cj.BodyState(*(part[None] for part in parts))})
    (found,) = many_states.loads(scene, state, scene.gravity)["shaft"]
    push, slip = STIFFNESS * depth**1.5, np.hypot(speed, RADIUS * spin)
    expected = COEFFICIENT * push / max(slip, FULL_SPEED)
    sliding = -expected * velocity
    np.testing.assert_allclose(found[:3], -side * push * AXIS + sliding, rtol=1e-9, atol=1e-12)
    arm = 0.5 * 20e-3 * side * AXIS
    turning = np.cross(arm, sliding) - expected * RADIUS**2 * spin * AXIS
    np.testing.assert_allclose(found[3:], turning, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"radius": 0.01}, "`radius` must be given if and only if `friction` is, but is 0.01"),
        ({"friction": cj.frictions.Ambrosio(0.1)}, "`radius` must be given .*, but is None"),
        ({"friction": cj.frictions.Dahl(0.1), "radius": 0.01}, "`friction` must be an AbstractFr"),
        ({"friction": cj.frictions.Ambrosio(0.1), "radius": -0.01}, "`radius` must be positive"),
    ],
)
def test_other_faces_are_refused(given, message):
    with pytest.raises(ValueError, match=message):
        cj.EndPlay(PLAY, cj.laws.Hertz(STIFFNESS), **given)


def test_rigid_faces_with_friction_are_refused():
    state = cj.State({"shaft": cj.body_state((0.0, 0.0, 0.0))})
    with pytest.raises(ValueError, match="moment of friction at 'lower shoulder', but is"):
        cj.simulate_nonsmooth(shaft_on_face(), state, 0.01, step=1e-3, restitution=0.5)
