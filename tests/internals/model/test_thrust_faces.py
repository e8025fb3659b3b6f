"""Force and moment of friction at a thrust face."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from clearjoint._dynamics.contact_forces import contact_forces, contact_wrenches
from clearjoint.extend import unpack
from clearjoint.testing import moving
from tests.model.test_thrust_faces import (
    AXIS,
    COEFFICIENT,
    FULL_SPEED,
    PLAY,
    RADIUS,
    STIFFNESS,
    shaft_on_face,
)
from tests.support.motions import AT_REST

ACROSS = np.array([1.0, 2.0, 0.0]) / np.sqrt(5.0)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("speed", "spin"), [(0.3, 0.0), (0.0, 40.0), (0.0, -40.0), (0.4, 70.0), (0.01, 1.0)]
)
def test_friction_opposes_sliding_and_rotation_at_the_mean_radius(side, speed, spin):
    """With mu N v/s and mu N r^2 w/s at the slip speed s above the full speed, and s/v_d of that
    below it; and the bearing with the opposite."""
    scene, depth = unpack(shaft_on_face(house="house")), 1e-5
    centre, velocity = side * (0.5 * PLAY + depth) * AXIS, speed * ACROSS
    turn = Rotation.from_rotvec(0.7 * AXIS)
    about = turn.inv().apply(spin * AXIS)
    shaft = moving(centre, turn.as_quat(scalar_first=True), velocity, about)
    motions = {"house": AT_REST, "shaft": shaft}
    name = "upper shoulder" if side > 0.0 else "lower shoulder"
    one = contact_forces(scene, motions, {})["pin"][name]
    push, slip = STIFFNESS * depth**1.5, np.hypot(speed, RADIUS * spin)
    expected = COEFFICIENT * push / max(slip, FULL_SPEED)
    total = {name: np.zeros(6) for name in motions}
    given = one.contact, one.normal_force, one.friction, motions, one.friction_moment
    for body, wrench in contact_wrenches(scene.joints["pin"], *given):
        total[body] += [*wrench.force, *motions[body].direction(wrench.moment)]
    force, torque = np.split(total["shaft"], 2)
    sliding = -expected * velocity
    np.testing.assert_allclose(force, -side * push * AXIS + sliding, rtol=1e-9, atol=1e-12)
    arm = 0.5 * 20e-3 * side * AXIS
    turning = np.cross(arm, sliding) - expected * RADIUS**2 * spin * AXIS
    np.testing.assert_allclose(torque, turning, rtol=1e-9, atol=1e-12)
    back = np.concatenate([-force, -torque - np.cross(centre, force)])
    np.testing.assert_allclose(total["house"], back, rtol=1e-9, atol=1e-12)
