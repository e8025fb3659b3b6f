"""Vectors, rotations and linear solvers against numpy and scipy."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import clearjoint as cj
from clearjoint._math.block_matrices import BlockMatrix
from clearjoint._math.linear_solvers import (
    Exact,
    LeastNorm,
    OrderedFactorisation,
    ScalarMatrix,
    UnrolledFactorisation,
    inner,
)
from clearjoint._math.rotations import euler_parameter_rates, transverse_axes
from clearjoint._math.vectors import add, multiply, subtract
from clearjoint.extend import (
    IDENTITY,
    UNIT_X,
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


def test_structural_zeros_and_ones_need_no_operations():
    x = jnp.asarray(2.0)
    assert add(x, 0.0) is x and add(0.0, x) is x and subtract(x, 0.0) is x
    assert multiply(x, 1.0) is x and multiply(1.0, x) is x and multiply(x, 0.0) == 0.0
    assert float(subtract(0.0, x)) == -2.0


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
        pack(rotation_matrix(parameters(Q))), rotation(Q).as_matrix(), atol=1e-14
    )


def test_normalised_has_unit_norm_and_the_same_direction():
    p = pack(normalised(parameters(Q)))
    np.testing.assert_allclose(p, Q / np.linalg.norm(Q, axis=1, keepdims=True), rtol=1e-14)


def test_euler_parameter_rates_are_those_of_the_rotation():
    """Compare with central differences of the orientation at constant angular velocity."""
    h = 1e-5
    p = pack(normalised(parameters(Q)))
    rate = pack(euler_parameter_rates(parameters(p), vector(A)))

    def later(t):
        return (rotation(p) * Rotation.from_rotvec(t * A)).as_matrix()

    measured = (later(h) - later(-h)) / (2 * h)
    ahead, behind = (pack(rotation_matrix(parameters(p + s * h * rate))) for s in (1, -1))
    np.testing.assert_allclose((ahead - behind) / (2 * h), measured, atol=1e-8)
    np.testing.assert_allclose(np.einsum("ni,ni->n", p, rate), 0.0, atol=1e-14)


def test_turned_is_a_small_rotation_about_body_axes():
    angle = 1e-3 * A
    p = pack(normalised(parameters(Q)))
    new = pack(turned(parameters(p), vector(angle)))
    exact = (rotation(p) * Rotation.from_rotvec(angle)).as_matrix()
    np.testing.assert_allclose(rotation(new).as_matrix(), exact, atol=1e-8)
    np.testing.assert_allclose(np.linalg.norm(new, axis=1), 1.0, rtol=1e-15)


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
    np.testing.assert_allclose(gram, np.broadcast_to(np.eye(3), gram.shape), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0, rtol=1e-14)


def test_transverse_axes_of_z_are_x_and_y():
    first, second = transverse_axes(UNIT_Z)
    np.testing.assert_array_equal([pack(first), pack(second)], [pack(UNIT_X), pack(UNIT_Y)])


def positive_definite(n, pattern):
    """A random symmetric positive definite matrix; entries off the pattern are zero."""
    dense = RANDOM.normal(size=(n, n))
    return np.where(pattern(n), dense + dense.T, 0.0) + 3 * n * np.eye(n)


def full(n):
    return np.ones((n, n), dtype=bool)


def arrow(n):
    i, j = np.indices((n, n))
    return (i == j) | (i == 0) | (j == 0)


def tridiagonal(n):
    i, j = np.indices((n, n))
    return np.abs(i - j) <= 1


def lower_triangle(matrix):
    """As nested lists, zeros structural."""
    return [[float(matrix[i, j]) for j in range(i + 1)] for i in range(len(matrix))]


def unrolled(solver, s, b):
    return np.array(solver.solving(ScalarMatrix(lower_triangle(s)))(list(b)))


def in_blocks(solver, s, b):
    rows = [[float(x) for x in row] for row in s]
    return np.array(solver.solving(BlockMatrix(rows, np.eye(len(s)).tolist()))(list(b)))


both_forms = pytest.mark.parametrize("solved", [unrolled, in_blocks])


@both_forms
@pytest.mark.parametrize("pattern", [full, arrow, tridiagonal, np.eye])
@pytest.mark.parametrize("n", [1, 2, 6])
def test_exact_solution_of_a_regular_system(n, pattern, solved):
    s = positive_definite(n, lambda n: np.asarray(pattern(n), dtype=bool))
    b = RANDOM.normal(size=n)
    np.testing.assert_allclose(solved(Exact(), s, b), np.linalg.solve(s, b), rtol=1e-12)


def test_factorisation_of_a_sparse_matrix_is_sparse():
    def cost(pattern, n=6):
        def solve(x):
            rows = [[x if pattern(n)[i, j] else 0.0 for j in range(i + 1)] for i in range(n)]
            return UnrolledFactorisation(rows).solve([x] * n)

        return equations(solve, 1.0)

    assert cost(np.eye) == 2 * 6
    assert cost(np.eye) < cost(tridiagonal) < cost(full) / 2


def singular_system(rank, n):
    """A matrix J J^T whose rows repeat each other, and a right side in its range."""
    j = RANDOM.normal(size=(n, rank)) @ RANDOM.normal(size=(rank, rank + 2))
    s = j @ j.T
    return s, s @ RANDOM.normal(size=n)


@both_forms
@pytest.mark.parametrize(("rank", "n"), [(1, 2), (3, 5), (4, 6), (5, 5)])
def test_least_norm_solution_of_a_singular_system(rank, n, solved):
    s, b = singular_system(rank, n)
    assert np.linalg.matrix_rank(s) == rank
    x = solved(LeastNorm(), s, b)
    expected = np.linalg.lstsq(s, b, rcond=1e-10)[0]
    np.testing.assert_allclose(s @ x, b, atol=1e-10 * np.abs(b).max())
    np.testing.assert_allclose(x, expected, atol=1e-5 * np.abs(expected).max())


@both_forms
def test_least_norm_solution_where_the_system_is_nearly_singular_as_well(solved):
    basis = np.linalg.qr(RANDOM.normal(size=(3, 3)))[0]
    s = basis @ np.diag([1.0, 1e-6, 0.0]) @ basis.T
    expected = basis @ [1.0, 1.0, 0.0]
    np.testing.assert_allclose(solved(LeastNorm(), s, s @ expected), expected, atol=1e-5)


def test_ordered_factorisation_of_an_arrow_matrix_has_no_fill_in():
    """Coupled to the first unknown only, n unknowns cost a few operations each; in the given order
    the factors are full, and the cost is cubic."""
    n = 6
    full = np.eye(n) * 5.0
    full[0] = full[:, 0] = RANDOM.normal(size=n)
    full[0, 0] = 20.0
    right = RANDOM.normal(size=n)

    def solution(kind, entries, right):
        numbers = iter(entries)
        rows = [[next(numbers) if full[i, j] else 0.0 for j in range(i + 1)] for i in range(n)]
        return inner(kind(rows).solve(right), [1.0] * n)

    entries = [jnp.asarray(x) for x in full[np.tril_indices(n)] if x]
    found = solution(OrderedFactorisation, entries, right)
    np.testing.assert_allclose(found, np.linalg.solve(full, right).sum(), rtol=1e-13)
    ordered, given = (
        equations(lambda e, r, kind=kind: solution(kind, e, list(r)), entries, tuple(right))
        for kind in (OrderedFactorisation, UnrolledFactorisation)
    )
    assert ordered < 12 * n and given > 2 * ordered


def test_arrays_of_networks_are_no_vectors():
    """A bias of a network with three or four neurons became a vector or Euler parameters."""
    network = eqx.nn.MLP(3, 4, 3, 1, key=jax.random.key(0))
    spring = cj.SpringDamper("ground", "arm", (0, 0, 1), (0, 0, 0), stiffness=1.0)
    unpacked, inside = unpack((spring, {"inside": network}))
    assert isinstance(unpacked.point_first, Vector)
    for before, after in zip(
        jax.tree.leaves(network), jax.tree.leaves(inside["inside"]), strict=True
    ):
        assert after is before
