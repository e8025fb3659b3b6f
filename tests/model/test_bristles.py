"""Bristle laws without a mechanism: closed forms, elasticity, and errors."""

import numpy as np
import pytest

from clearjoint.extend import Vector
from clearjoint.frictions import Dahl, ElastoPlastic, LuGre

SLOW, FAST, STIFFNESS, STRIBECK_SPEED = 0.25, 0.15, 1e5, 0.01
LUGRE = LuGre(
    SLOW, FAST, stribeck_speed=STRIBECK_SPEED, stiffness=STIFFNESS, damping=30.0, viscosity=0.4
)
ELASTIC = 0.7e-6
ELASTO_PLASTIC = ElastoPlastic(
    SLOW, FAST, stribeck_speed=STRIBECK_SPEED, elastic_deflection=ELASTIC, stiffness=STIFFNESS
)


def curve(speed):
    """Stribeck's curve, as LuGre has it."""
    return FAST + (SLOW - FAST) * np.exp(-((speed / STRIBECK_SPEED) ** 2))


def on_x(number):
    return Vector(number, 0.0, 0.0)


@pytest.mark.parametrize("speed", [-0.3, -5e-3, 1e-3, 0.02, 1.0])
@pytest.mark.parametrize("law", [LUGRE, ELASTO_PLASTIC])
def test_long_slip_has_stribecks_curve(law, speed):
    """Where the deflection is g/sigma0 it stays, and friction is g and the viscous part."""
    g = curve(abs(speed)) * np.sign(speed)
    z = on_x(g / STIFFNESS)
    rate = law.rate(z, on_x(speed))
    assert abs(float(rate.x)) < 1e-13 * abs(speed)
    viscous = float(law.viscosity) * speed
    assert float(law.ratio(z, rate, on_x(speed)).x) == pytest.approx(g + viscous, rel=1e-12)
    assert float(law.force(3.0, on_x(speed)).x) == pytest.approx(-3.0 * g, rel=1e-12)


def test_elasto_plastic_bristles_are_elastic_up_to_their_limit_and_where_they_relax():
    for share in (0.0, 0.5, 0.999):
        z = on_x(share * ELASTIC)
        assert float(ELASTO_PLASTIC.rate(z, on_x(0.02)).x) == 0.02
    beyond = on_x(1.4e-6)
    assert float(ELASTO_PLASTIC.rate(beyond, on_x(-0.02)).x) == -0.02
    middle = 0.5 * (ELASTIC + curve(0.02) / STIFFNESS)
    expected = 0.02 * (1.0 - 0.5 * middle * STIFFNESS / curve(0.02))
    assert float(ELASTO_PLASTIC.rate(on_x(middle), on_x(0.02)).x) == pytest.approx(expected)


def test_invalid_bristles_are_refused():
    with pytest.raises(ValueError, match="breakaway.*at least kinetic"):
        LuGre(0.1, 0.2, stribeck_speed=0.01)
    with pytest.raises(ValueError, match=r"elastic_deflection.*below kinetic/stiffness"):
        ElastoPlastic(0.2, 0.1, stribeck_speed=0.01, elastic_deflection=1e-5)
    with pytest.raises(ValueError, match="stiffness"):
        Dahl(0.1, stiffness=0.0)
