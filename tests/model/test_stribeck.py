"""Friction that falls from breakaway, and variants of Coulomb friction: closed forms, limits."""

import jax
import numpy as np
import pytest

from clearjoint.extend import Vector, pack
from clearjoint.frictions import (
    BengisuAkay,
    BrownMcPhee,
    LinearCoulomb,
    Stribeck,
    Threlfall,
)

SLOW, FAST = 0.25, 0.15
FALLING = (
    Stribeck(SLOW, FAST, stribeck_speed=0.05, regularisation_speed=1e-5),
    BengisuAkay(SLOW, FAST, breakaway_speed=2e-3, decay=50.0),
    BrownMcPhee(SLOW, FAST, transition_speed=2e-3),
)
SPEEDS = np.linspace(0.0, 0.2, 20_001)


def test_linear_and_threlfalls_rise():
    speeds = np.array([0.0, 1e-4, 5e-4, 1e-3, 2e-3, 10.0])
    linear, threlfall = (law(0.3).ratio(speeds) for law in (LinearCoulomb, Threlfall))
    np.testing.assert_allclose(linear, [0.0, 0.03, 0.15, 0.3, 0.3, 0.3], rtol=1e-14)
    full = 0.3 * (1.0 - np.exp(-3.0))
    expected = [0.3 * (1.0 - np.exp(-3e3 * v)) for v in speeds[:3]] + [full] * 3
    np.testing.assert_allclose(threlfall, expected, rtol=1e-13, atol=1e-17)


@pytest.mark.parametrize("law", FALLING)
def test_falls_from_breakaway_to_kinetic_friction(law):
    """It starts at zero, has its peak at the breakaway coefficient, but for the rounding of the
    corner, and falls from there to the kinetic one."""
    ratios = np.asarray(law.ratio(SPEEDS))
    peak = int(np.argmax(ratios))
    assert ratios[0] == 0.0 and float(law.ratio(1e3)) == pytest.approx(FAST, rel=1e-6)
    assert SLOW * 0.998 < ratios[peak] <= SLOW * 1.002
    assert (np.diff(ratios[: peak + 1]) > 0.0).all()
    assert (np.diff(ratios[peak:]) <= 0.0).all()


def test_stribeck_follows_its_exponential_beyond_the_regularisation():
    v = np.array([1e-3, 0.02, 0.05, 0.1])
    for exponent in (1.0, 2.0):
        law = Stribeck(
            SLOW, FAST, stribeck_speed=0.05, exponent=exponent, regularisation_speed=1e-5
        )
        expected = FAST + (SLOW - FAST) * np.exp(-((v / 0.05) ** exponent))
        np.testing.assert_allclose(law.ratio(v), expected, rtol=1e-13)


def test_bengisu_and_akays_parts_meet_at_breakaway():
    law = FALLING[1]
    v = np.array([1e-3, 2e-3, 0.022])
    expected = [0.75 * SLOW, SLOW, FAST + (SLOW - FAST) * np.exp(-1.0)]
    np.testing.assert_allclose(law.ratio(v), expected, rtol=1e-14)


def test_brown_and_mcphees_peak_is_at_the_transition_speed():
    law = FALLING[2]
    at_peak = FAST * np.tanh(4.0) + (SLOW - FAST)
    assert float(law.ratio(2e-3)) == pytest.approx(at_peak, rel=1e-14)
    slope = jax.grad(law.ratio)(2e-3)
    coulomb = FAST * 4.0 / 2e-3 / np.cosh(4.0) ** 2
    assert float(slope) == pytest.approx(coulomb, rel=1e-10)


@pytest.mark.parametrize("law", FALLING)
def test_slope_at_rest_is_that_of_the_law(law):
    def force(slip):
        return pack(law.force(7.0, Vector(slip[0], slip[1], slip[2])))

    slope = float(jax.grad(law.ratio)(0.0))
    assert slope > 0.0
    np.testing.assert_allclose(jax.jacfwd(force)(np.zeros(3)), -7.0 * slope * np.eye(3))


@pytest.mark.parametrize("kind", [Stribeck, BengisuAkay, BrownMcPhee])
def test_friction_that_rises_from_breakaway_is_refused(kind):
    options = {"stribeck_speed": 0.01} if kind is Stribeck else {}
    with pytest.raises(ValueError, match="breakaway.*at least kinetic = 0.2"):
        kind(0.1, 0.2, **options)
    with pytest.raises(ValueError, match="exponent"):
        Stribeck(0.2, 0.1, stribeck_speed=0.01, exponent=0.5)
