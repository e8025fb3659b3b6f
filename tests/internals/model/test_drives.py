"""Which jumps of a driver are seen between two times."""

import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._dynamics.breakpoints import drivers_are_smooth
from tests.support.shaft import ON_SHAFT, ORIGIN, SHAFT, Z, shaft, turned
from tests.support.slow import slow

FORMULATION = cj.extend.Formulation(cj.AbsoluteCoordinates())


def is_smooth(scene):
    """Whether the scene's driver is smooth from 0.04 to 0.06 s."""
    system = cj.extend.System(cj.extend.unpack(scene), FORMULATION)
    variables = system.encode(cj.extend.unpack(turned()).bodies)
    return bool(drivers_are_smooth(system, variables, 0.04, 0.06, 1e-6))


@pytest.mark.parametrize(("jump", "smooth"), [(0.0, True), (1.0, False), (2.0 * np.pi, False)])
def test_a_distance_that_jumps_is_not_smooth(jump, smooth):
    """A jump of a prescribed distance by 2 pi m is one, unlike that of an angle by 2 pi rad."""
    driver = cj.PrescribedTranslation(
        "ground", "shaft", ORIGIN, ORIGIN, Z, lambda t: jnp.where(t < 0.05, 0.0, jump) + 0.0 * t
    )
    scene = cj.Scene({"shaft": SHAFT}, {"slide": driver})
    assert is_smooth(scene) == smooth


@pytest.mark.parametrize("at_middle", [slow(0.0), np.pi])
@pytest.mark.parametrize(("turns", "smooth"), [slow(0.0, True), (1.0, True), slow(0.5, False)])
def test_an_angle_that_jumps_by_a_revolution_is_smooth(turns, smooth, at_middle):
    """Also where the angle passes half a revolution, so that its principal value jumps."""
    jump = 2.0 * np.pi * turns

    def angle(t):
        return at_middle + 3.0 * (t - 0.05) + jnp.where(t < 0.05, 0.0, jump)

    assert is_smooth(shaft(motor=cj.PrescribedAngle(*ON_SHAFT, angle))) == smooth
