"""Vectors, rotations and linear solvers against numpy and scipy."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import clearjoint as cj
from clearjoint.extend import (
    IDENTITY,
    UNIT_Y,
    UNIT_Z,
    ZERO,
    EulerParameters,
    Matrix,
    Motion,
    Vector,
    normalised,
    pack,
    rotation_matrix,
    turned,
    unit,
    unpack,
)
from tests.support.motions import AT_REST

RANDOM = np.random.default_rng(1)
N = 40
A, B = RANDOM.normal(size=(2, N, 3))
M = RANDOM.normal(size=(N, 3, 3)) + 2 * np.eye(3)
Q = RANDOM.normal(size=(N, 4))


def vector(rows):
    return Vector(*np.moveaxis(np.asarray(rows), -1, 0))


def matrix(batch):
    return Matrix(*(vector(batch[:, i]) for i in range(3)))


def parameters(rows):
    return EulerParameters(*rows.T)


def rotation(rows):
    return Rotation.from_quat(rows, scalar_first=True)


def equations(function, *arguments):
    return len(jax.make_jaxpr(function)(*arguments).eqns)


@pytest.mark.parametrize(
    ("ours", "numpys"),
    [
        (lambda a, b: a + b, A + B),
        (lambda a, b: a - b, A - B),
        (lambda a, b: -a, -A),
        (lambda a, b: a * 2.5, 2.5 * A),
        (lambda a, b: 2.5 * a, 2.5 * A),
        (lambda a, b: a * b.x, A * B[:, :1]),
        (lambda a, b: a.componentwise_product(b), A * B),
        (lambda a, b: a.cross(b), np.cross(A, B)),
        (lambda a, b: a.dot(b), np.einsum("ni,ni->n", A, B)),
        (lambda a, b: unit(a), A / np.linalg.norm(A, axis=1, keepdims=True)),
    ],
)
def test_vector_operation(ours, numpys):
    np.testing.assert_allclose(pack(ours(vector(A), vector(B))), numpys, rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize(
    ("ours", "numpys"),
    [
        (lambda m, a: m @ a, np.einsum("nij,nj->ni", M, A)),
        (lambda m, a: m.transposed_times(a), np.einsum("nji,nj->ni", M, A)),
        (lambda m, a: m.T, M.transpose(0, 2, 1)),
        (lambda m, a: m.inverse(), np.linalg.inv(M)),
    ],
)
def test_matrix_operation(ours, numpys):
    np.testing.assert_allclose(pack(ours(matrix(M), vector(A))), numpys, rtol=1e-9, atol=1e-12)


def test_numbers_of_an_array_are_not_structural():
    """A zero in an array may change without compiling again."""
    assert equations(lambda v: pack(v.cross(UNIT_Z)), ZERO) > 0


def test_products_with_the_ground_need_no_operations():
    free = Motion(vector(A[0]), matrix(M[:1]), vector(A[1]), vector(A[2]))

    def uses(motion, local):
        return motion.point(local), motion.velocity_at(local), motion.direction(local)

    assert equations(lambda v: uses(AT_REST, v), vector(B[0])) == 0
    assert equations(uses, free, vector(B[0])) > 30
    assert equations(lambda v: v.cross(UNIT_Z), vector(B[0])) == 1
    assert equations(lambda v, w: v.cross(w), vector(B[0]), vector(B[1])) == 9


TREE = {"v": A[0], "q": Q[0], "m": M[0], "s": np.float64(3.0), "pair": (B[0], [B[1]])}


def test_unpack_makes_scalars_and_pack_undoes_it():
    scalar_form = unpack(TREE)
    assert isinstance(scalar_form["v"], Vector) and isinstance(scalar_form["m"], Matrix)
    assert isinstance(scalar_form["q"], EulerParameters)
    assert all(np.shape(leaf) == () for leaf in jax.tree.leaves(scalar_form))
    jax.tree.map(np.testing.assert_array_equal, pack(scalar_form), TREE)


@pytest.mark.parametrize("library", [np, jnp])
def test_pack_keeps_leading_axes_and_the_library(library):
    batch = {"v": library.asarray(A), "q": library.asarray(Q), "m": library.asarray(M)}
    scalar_form = {
        "v": vector(A) if library is np else jax.vmap(unpack)(batch["v"]),
        "q": parameters(Q) if library is np else jax.vmap(unpack)(batch["q"]),
        "m": matrix(M) if library is np else jax.vmap(unpack)(batch["m"]),
    }
    packed = pack(scalar_form)
    jax.tree.map(np.testing.assert_array_equal, packed, batch)
    assert all(type(packed[name]) is type(batch[name]) for name in batch)


def test_pack_spreads_structural_components():
    np.testing.assert_array_equal(pack(Vector(np.arange(2.0), 0.0, 1.0)), [[0, 0, 1], [1, 0, 1]])
    np.testing.assert_array_equal(pack(IDENTITY), np.eye(3))
    matrix = Matrix(Vector(np.arange(2.0), 0.0, 1.0), UNIT_Y, UNIT_Z)
    expected = [[[k, 0, 1], [0, 1, 0], [0, 0, 1]] for k in range(2)]
    np.testing.assert_array_equal(pack(matrix), expected)


def test_rotation_matrix_turns_body_components_into_global_ones():
    np.testing.assert_allclose(
        pack(rotation_matrix(parameters(Q))), rotation(Q).as_matrix(), rtol=0.0, atol=1e-14
    )


def test_normalised_has_unit_norm_and_the_same_direction():
    p = pack(normalised(parameters(Q)))
    np.testing.assert_allclose(p, Q / np.linalg.norm(Q, axis=1, keepdims=True), rtol=1e-14)


def test_turned_is_a_small_rotation_about_body_axes():
    angle = 1e-3 * A
    p = pack(normalised(parameters(Q)))
    new = pack(turned(parameters(p), vector(angle)))
    exact = (rotation(p) * Rotation.from_rotvec(angle)).as_matrix()
    np.testing.assert_allclose(rotation(new).as_matrix(), exact, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(np.linalg.norm(new, axis=1), 1.0, rtol=1e-15)


def test_arrays_of_networks_are_no_vectors():
    """A bias of a network with three or four neurons became a vector or Euler parameters."""
    network = eqx.nn.MLP(3, 4, 3, 1, key=jax.random.key(0))
    spring = cj.SpringDamper("ground", "arm", (0, 0, 1), (0, 0, 0), stiffness=1.0)
    unpacked, inside = unpack((spring, {"inside": network}))
    assert isinstance(unpacked.point_first, Vector)
    pairs = zip(jax.tree.leaves(network), jax.tree.leaves(inside["inside"]), strict=True)
    assert all(after is before for before, after in pairs)
