"""Friction laws: closed forms, and properties of every friction law."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from clearjoint.extend import Vector, pack, slip_velocity
from clearjoint.frictions import Ambrosio, RegularisedCoulomb

MU, LOAD = 0.3, 1500.0
LAWS = (
    RegularisedCoulomb(MU, regularisation_speed=2e-3),
    Ambrosio(MU, lower_speed=1e-4, upper_speed=1e-3),
)
STEEPEST = (MU / 2e-3, MU / 9e-4)
RANDOM = np.random.default_rng(5)
SLIPS = RANDOM.normal(size=(60, 3)) * np.logspace(-7, 2, 60)[:, None]
both_laws = pytest.mark.parametrize("law", LAWS)


def force(law, slips):
    return np.asarray(pack(law.force(LOAD, Vector(*np.moveaxis(slips, -1, 0)))))


@both_laws
def test_force_is_odd(law):
    np.testing.assert_array_equal(force(law, -SLIPS), -force(law, SLIPS))


@both_laws
def test_force_opposes_the_slip_within_coulombs_limit(law):
    """Antiparallel, so that its power is -|F||v|, and never above mu N."""
    friction = force(law, SLIPS)
    size, speed = np.linalg.norm(friction, axis=1), np.linalg.norm(SLIPS, axis=1)
    power = np.sum(friction * SLIPS, axis=1)
    np.testing.assert_allclose(power, -size * speed, rtol=1e-12)
    assert (size <= MU * LOAD * (1 + 1e-12)).all()
    assert size[-1] == pytest.approx(MU * LOAD, rel=1e-12)


@both_laws
def test_force_is_proportional_to_the_normal_force(law):
    slip = Vector(0.01, -0.02, 0.0)
    np.testing.assert_allclose(
        pack(law.force(2 * LOAD, slip)), 2 * pack(law.force(LOAD, slip)), rtol=1e-14
    )


@pytest.mark.parametrize(("law", "steepest"), list(zip(LAWS, STEEPEST, strict=True)))
def test_ratio_is_continuous(law, steepest):
    """The change between adjacent speeds is limited by the largest slope."""
    speeds = np.linspace(0.0, 5e-3, 5001)
    changes = np.diff(np.asarray(law.ratio(speeds)))
    assert law.ratio(0.0) == 0.0
    assert (changes >= 0.0).all() and (changes <= steepest * 1e-6 * (1 + 1e-6)).all()
    assert changes.max() > 0.99 * steepest * 1e-6


@both_laws
def test_force_and_its_derivative_vanish_or_are_finite_at_zero_slip(law):
    for slip in (np.zeros(3), np.array([1e-120, 0.0, 0.0]), np.array([1e-9, 0.0, -1e-9])):
        jacobian = jax.jacfwd(lambda v: pack(law.force(LOAD, Vector(*v))))(slip)
        assert np.isfinite(jacobian).all()
        assert np.abs(jacobian).max() <= LOAD * max(STEEPEST)
    assert not force(law, np.zeros(3)).any()


def test_regularised_coulomb_is_a_hyperbolic_tangent():
    speeds = np.array([0.0, 1e-4, 2e-3, 0.1])
    expected = MU * (1 - 2 / (np.exp(2 * speeds / 2e-3) + 1))
    np.testing.assert_allclose(LAWS[0].ratio(speeds), expected, rtol=1e-12, atol=1e-16)


def test_ambrosio_rises_between_its_two_speeds():
    speeds = np.array([0.0, 5e-5, 1e-4, 3.25e-4, 5.5e-4, 1e-3, 2e-3, 10.0])
    np.testing.assert_allclose(
        LAWS[1].ratio(speeds), MU * np.array([0, 0, 0, 0.25, 0.5, 1, 1, 1]), atol=1e-15
    )
    assert not force(LAWS[1], np.array([[9.9e-5, 0, 0], [0, 5e-5, -5e-5]])).any()


def test_slip_is_the_tangential_part_of_the_velocity():
    velocity, normal = RANDOM.normal(size=3), np.array([0.6, 0.0, -0.8])
    rate = velocity @ normal
    slip = pack(slip_velocity(Vector(*velocity), Vector(*normal), rate))
    np.testing.assert_allclose(slip, (np.eye(3) - np.outer(normal, normal)) @ velocity, rtol=1e-13)


@pytest.mark.parametrize(
    ("law", "slope"), [(RegularisedCoulomb(0.3, 2e-3), 150.0), (Ambrosio(0.3), 0.0)]
)
def test_derivative_at_rest_is_that_of_the_law(law, slope):
    """At zero slip the force falls with the slip in its direction by mu/v_d times the load."""

    def force(slip):
        return pack(law.force(7.0, Vector(slip[0], slip[1], slip[2])))

    np.testing.assert_allclose(jax.jacfwd(force)(jnp.zeros(3)), -7.0 * slope * np.eye(3))
    np.testing.assert_allclose(jax.jacrev(force)(jnp.zeros(3)), -7.0 * slope * np.eye(3))
