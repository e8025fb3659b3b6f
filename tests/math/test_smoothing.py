"""Norms, powers and ramps: values and derivatives, in particular at kinks."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from clearjoint.extend import Vector, norm_and_direction, pack, positive_power, ramp

POINTS = np.array([-2.0, -1e-9, 0.0, 1e-9, 0.3, 2.0])


def derivative(function, points):
    """Return values and first derivatives at many points."""
    points = jnp.asarray(points)
    return jax.jvp(function, (points,), (jnp.ones_like(points),))


@pytest.mark.parametrize("exponent", [1.0, 1.3, 1.5, 2.0, 2.5])
def test_positive_power_and_its_derivative(exponent):
    values, slopes = derivative(lambda x: positive_power(x, exponent), POINTS)
    positive = np.maximum(POINTS, 0.0)
    expected = np.where(POINTS > 0, exponent * positive ** (exponent - 1), 0.0)
    np.testing.assert_allclose(values, positive**exponent, rtol=1e-14)
    np.testing.assert_allclose(slopes, expected, rtol=1e-14)


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.5])
def test_derivatives_of_positive_power_at_zero_are_zero(exponent):
    def power(x):
        return positive_power(x, exponent)

    assert power(0.0) == jax.grad(power)(0.0) == jax.grad(jax.grad(power))(0.0) == 0.0


VECTORS = np.random.default_rng(2).normal(size=(20, 3)) * np.logspace(-90, 90, 20)[:, None]


def norm(rows):
    return norm_and_direction(Vector(*jnp.moveaxis(rows, -1, 0)))[0]


def direction(rows):
    return pack(norm_and_direction(Vector(*jnp.moveaxis(rows, -1, 0)))[1])


def test_norm_and_direction_of_any_length():
    lengths = np.linalg.norm(VECTORS, axis=1)
    np.testing.assert_allclose(norm(VECTORS), lengths, rtol=1e-14)
    np.testing.assert_allclose(direction(VECTORS), VECTORS / lengths[:, None], rtol=1e-14)


def test_derivatives_of_norm_and_direction():
    change = np.random.default_rng(3).normal(size=(20, 3))
    vectors = change[::-1] + 1.0
    n = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    along = np.sum(n * change, axis=1)
    across = (change - n * along[:, None]) / np.linalg.norm(vectors, axis=1, keepdims=True)
    np.testing.assert_allclose(jax.jvp(norm, (vectors,), (change,))[1], along, rtol=1e-12)
    np.testing.assert_allclose(
        jax.jvp(direction, (vectors,), (change,))[1], across, rtol=0.0, atol=1e-13
    )


@pytest.mark.parametrize("vector", [np.zeros(3), np.array([1e-101, -1e-150, 0.0])])
def test_vanishing_vector_has_no_direction_and_no_derivatives(vector):
    assert norm(vector) == 0.0 and not direction(vector).any()
    assert not jax.grad(norm)(vector).any()
    assert not jax.jacfwd(direction)(vector).any()


def test_exact_ramp_is_the_positive_part():
    values, slopes = derivative(lambda x: ramp(x, None), POINTS[POINTS != 0.0])
    np.testing.assert_array_equal(values, np.maximum(POINTS[POINTS != 0.0], 0.0))
    np.testing.assert_array_equal(slopes, POINTS[POINTS != 0.0] > 0.0)
    assert ramp(0.0, None) == 0.0 and 0.0 <= jax.grad(lambda x: ramp(x, None))(0.0) <= 1.0


@pytest.mark.parametrize("w", [1e-7, 0.5])
def test_smooth_ramp(w):
    """The ramp and its derivative, closed forms; -w and w are the ends of the parabola."""
    points = w * np.array([-3.0, -1.0, -0.5, 0.0, 0.5, 1.0, 3.0])
    values, slopes = derivative(lambda x: ramp(x, w), points)
    np.testing.assert_allclose(values, w * np.array([0, 0, 1 / 16, 1 / 4, 9 / 16, 1, 3]))
    np.testing.assert_allclose(slopes, [0, 0, 1 / 4, 1 / 2, 3 / 4, 1, 1], rtol=1e-14)


def test_derivative_of_the_smooth_ramp_by_its_width():
    """(x+w)^2/(4w) has the derivative (w^2-x^2)/(4w^2) by w, zero outside."""
    x = jnp.array([-2.0, -0.25, 0.0, 0.25, 2.0])
    slopes = jax.jvp(lambda w: ramp(x, w), (0.5,), (1.0,))[1]
    np.testing.assert_allclose(slopes, [0.0, 0.1875, 0.25, 0.1875, 0.0], rtol=0.0, atol=1e-15)
