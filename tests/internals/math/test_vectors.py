"""Matrices of blocks, linear solvers, and operations that leave out zeros."""

import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from clearjoint._math.linear_solvers import Factorisation, inner
from clearjoint._math.rotations import euler_parameter_rates, transverse_axes
from clearjoint._math.vectors import add, multiply, subtract
from clearjoint.extend import UNIT_X, UNIT_Y, UNIT_Z, normalised, pack, rotation_matrix
from tests.math.test_vectors import RANDOM, A, Q, equations, parameters, rotation, vector


def test_structural_zeros_and_ones_need_no_operations():
    x = jnp.asarray(2.0)
    assert add(x, 0.0) is x and add(0.0, x) is x and subtract(x, 0.0) is x
    assert multiply(x, 1.0) is x and multiply(1.0, x) is x and multiply(x, 0.0) == 0.0
    assert float(subtract(0.0, x)) == -2.0


def test_euler_parameter_rates_are_those_of_the_rotation():
    """Compare with central differences of the orientation at constant angular velocity."""
    h = 1e-5
    p = pack(normalised(parameters(Q)))
    rate = pack(euler_parameter_rates(parameters(p), vector(A)))

    def later(t):
        return (rotation(p) * Rotation.from_rotvec(t * A)).as_matrix()

    measured = (later(h) - later(-h)) / (2 * h)
    ahead, behind = (pack(rotation_matrix(parameters(p + s * h * rate))) for s in (1, -1))
    np.testing.assert_allclose((ahead - behind) / (2 * h), measured, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(np.einsum("ni,ni->n", p, rate), 0.0, atol=1e-14)


AXES = np.concatenate(
    [
        np.eye(3),
        -np.eye(3),
        A,
        [[1e-9, 0, -1], [0, -1e-9, -1], [1e-9, 1e-9, 1], [1, 0, 1e-300], [1, 0, -1e-300]],
    ]
)


def test_transverse_axes_complete_a_right_handed_frame():
    axes = AXES / np.linalg.norm(AXES, axis=1, keepdims=True)
    first, second = transverse_axes(vector(axes))
    frames = np.stack([pack(first), pack(second), axes], axis=-1)
    gram = frames.transpose(0, 2, 1) @ frames
    np.testing.assert_allclose(gram, np.broadcast_to(np.eye(3), gram.shape), rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0, rtol=1e-14)


def test_transverse_axes_of_z_are_x_and_y():
    first, second = transverse_axes(UNIT_Z)
    np.testing.assert_array_equal([pack(first), pack(second)], [pack(UNIT_X), pack(UNIT_Y)])


def test_ordered_factorisation_of_an_arrow_matrix_has_no_fill_in():
    """Coupled to the first unknown only, n unknowns cost a few operations each; in the given order
    the factors would be full, and the cost cubic."""
    n = 6
    full = np.eye(n) * 5.0
    full[0] = full[:, 0] = RANDOM.normal(size=n)
    full[0, 0] = 20.0
    right = RANDOM.normal(size=n)

    def solution(entries, right):
        numbers = iter(entries)
        rows = [[next(numbers) if full[i, j] else 0.0 for j in range(i + 1)] for i in range(n)]
        return inner(Factorisation(rows).solve(right), [1.0] * n)

    entries = [jnp.asarray(x) for x in full[np.tril_indices(n)] if x]
    found = solution(entries, right)
    np.testing.assert_allclose(found, np.linalg.solve(full, right).sum(), rtol=1e-13)
    assert equations(lambda e, r: solution(e, list(r)), entries, tuple(right)) < 12 * n
