"""Rotation vectors and their rates, against SciPy and a series of matrices."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from clearjoint._math.rotations import rotation_vector
from clearjoint.extend import Matrix, Vector, pack


def as_matrix(rotation: np.ndarray) -> Matrix:
    return Matrix(*(Vector(*row) for row in rotation))


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 0.0099, 0.0101, 0.099, 0.101, 1.0, 3.0, 3.141])
def test_rotation_vectors_and_their_rates(angle):
    """Against SciPy's, and the left Jacobian of the exponential map as a series of matrices."""
    vector = angle * np.array([2.0, -1.0, 2.0]) / 3.0
    found = rotation_vector(as_matrix(Rotation.from_rotvec(vector).as_matrix()))
    np.testing.assert_allclose(pack(found.vector), vector, rtol=1e-12, atol=1e-15)
    x, y, z = vector
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    series = sum(np.linalg.matrix_power(skew, k) / math.factorial(k + 1) for k in range(40))
    spin = np.array([0.3, 0.7, -0.4])
    rate, torque = found.rate(Vector(*spin)), found.torque(Vector(*spin))
    np.testing.assert_allclose(pack(rate), np.linalg.solve(series, spin), rtol=1e-10)
    np.testing.assert_allclose(pack(torque), np.linalg.solve(series.T, spin), rtol=1e-10)


def test_half_a_revolution_gives_finite_numbers():
    found = rotation_vector(as_matrix(np.diag([1.0, -1.0, -1.0])))
    assert [float(part) for part in found.vector] == [0.0, 0.0, 0.0]
    assert np.isfinite(float(found.factor))


@pytest.mark.slow
def test_derivatives_of_a_relaxed_bushing_are_finite():
    """Its generalised force by the turn about each axis, where the turn vanishes."""

    def angle(turn: jax.Array) -> jax.Array:
        x, y, z = turn
        near = Matrix(Vector(1.0, -z, y), Vector(z, 1.0, -x), Vector(-y, x, 1.0))
        return jnp.stack(list(rotation_vector(near).vector))

    np.testing.assert_allclose(jax.jacfwd(angle)(jnp.zeros(3)), np.eye(3), rtol=0.0, atol=1e-15)
