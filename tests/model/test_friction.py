"""Friction laws: printed formulas, and properties of every friction law."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from clearjoint.extend import Vector, pack
from clearjoint.frictions import BengisuAkay, BrownMcPhee, Stribeck
from studies.catalogue.frictions import FAST, SLOW
from studies.catalogue.frictions import LAWS as PRINTED

LOAD = 1500.0
SLOPES = {
    "RegularisedCoulomb": FAST / 1e-3,
    "LinearCoulomb": FAST / 1e-3,
    "Threlfall": 3.0 * FAST / 1e-3,
    "Ambrosio": 0.0,
    "Stribeck": SLOW / 1e-6,
    "BengisuAkay": 2.0 * SLOW / 2e-3,
    "BrownMcPhee": (4.0 * FAST + (SLOW - FAST) / 0.75**2) / 2e-3,
}
"""Of the ratio at rest, s/m."""
RANDOM = np.random.default_rng(5)
SLIPS = RANDOM.normal(size=(60, 3)) * np.logspace(-7, 2, 60)[:, None]
every_law = pytest.mark.parametrize("name", PRINTED)
FALLING = ["Stribeck", "BengisuAkay", "BrownMcPhee"]


def force(law, slip):
    return pack(law.force(LOAD, Vector(*np.moveaxis(slip, -1, 0))))


def test_stribecks_exponent_may_be_one():
    v = np.array([1e-3, 0.02, 0.05, 0.1])
    law = Stribeck(SLOW, FAST, stribeck_speed=0.05, exponent=1.0, regularisation_speed=1e-5)
    expected = FAST + (SLOW - FAST) * np.exp(-v / 0.05)
    np.testing.assert_allclose(law.ratio(v), expected, rtol=1e-13)


@every_law
def test_force_opposes_the_slip_within_the_limit(name):
    """Antiparallel, so that its power is -|F||v|, and never above the largest friction."""
    law, _, formula = PRINTED[name]
    friction = np.asarray(force(law, SLIPS))
    size, speed = np.linalg.norm(friction, axis=1), np.linalg.norm(SLIPS, axis=1)
    power = np.sum(friction * SLIPS, axis=1)
    np.testing.assert_allclose(power, -size * speed, rtol=1e-12)
    assert (size <= (SLOW if name in FALLING else FAST) * LOAD * (1 + 1e-12)).all()
    assert size[-1] == pytest.approx(formula(speed[-1]) * LOAD, rel=1e-12)


@every_law
def test_force_and_its_derivative_at_rest_are_those_of_the_law(name):
    """The force falls with the slip in its direction by the slope of the ratio times the load."""
    law, steepest = PRINTED[name][0], max(SLOPES[name], FAST / 9e-4)
    assert not np.any(force(law, np.zeros(3)))
    for differentiate in (jax.jacfwd, jax.jacrev):
        at_rest = differentiate(lambda slip: force(law, slip))(jnp.zeros(3))
        np.testing.assert_allclose(at_rest, -LOAD * SLOPES[name] * np.eye(3), rtol=1e-12)
    for slip in (np.array([1e-120, 0.0, 0.0]), np.array([1e-9, 0.0, -1e-9])):
        jacobian = jax.jacfwd(lambda slip: force(law, slip))(slip)
        assert np.abs(jacobian).max() <= LOAD * steepest * (1 + 1e-9)


@pytest.mark.parametrize("kind", [Stribeck, BengisuAkay, BrownMcPhee])
def test_friction_that_rises_from_breakaway_is_refused(kind):
    options = {"stribeck_speed": 0.01} if kind is Stribeck else {}
    with pytest.raises(ValueError, match="breakaway.*at least kinetic = 0.2"):
        kind(0.1, 0.2, **options)


def test_an_exponent_below_one_is_refused():
    with pytest.raises(ValueError, match="exponent"):
        Stribeck(0.2, 0.1, stribeck_speed=0.01, exponent=0.5)
