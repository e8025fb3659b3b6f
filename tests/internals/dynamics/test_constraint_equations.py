"""Multipliers and accelerations of random closed-loop mechanisms against dense NumPy solutions."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import clearjoint as cj
from clearjoint._dynamics.multipliers import ConstraintEquations, row_weights
from clearjoint._math.block_matrices import BlockMatrix, gram_matrix
from clearjoint._math.linear_solvers import Exact, LeastNorm, ScalarMatrix
from clearjoint._native.functions import NativeProgram
from clearjoint._native.lowering import count_equations
from clearjoint.extend import ZERO, Formulation, Row, System, Vector, Wrench, unpack
from tests.support.one_body import Z, hinge

COORDINATES = {"absolute": cj.AbsoluteCoordinates(), "joint": cj.JointCoordinates()}


def closer(random, first, second):
    """A random joint between two bodies with one to three rows."""
    a, b, axis = random.normal(size=(3, 3))
    kind = random.integers(3)
    if kind == 0:
        return cj.DistanceJoint(first, second, a, b, float(random.uniform(1, 2)))
    if kind == 1:
        return cj.InlineJoint(first, second, a, b, axis)
    return cj.SphericalJoint(first, second, a, b)


def mechanism(random, count, redundant):
    """A chain of bodies in revolute joints with random closing joints, some of them twice."""
    names = [f"b{k}" for k in random.permutation(count)]
    bodies = {n: cj.Body(random.uniform(1, 2), random.uniform(1, 2, 3)) for n in sorted(names)}
    joints = {}
    for k, (first, second) in enumerate(zip(["ground", *names], names, strict=False)):
        a, b, axis, other = random.normal(size=(4, 3))
        joints[f"hinge {k}"] = cj.RevoluteJoint(first, second, a, b, axis, other)
    for k, name in enumerate(names):
        ends = names[max(k - 2, 0) : k]
        joints[f"closer {k}"] = closer(random, ends[0] if ends else "ground", name)
        if redundant and k % 2 == 0:
            joints[f"again {k}"] = joints[f"closer {k}"]
    states = {}
    for name in names:
        turn = Rotation.random(rng=random).as_quat(scalar_first=True)
        states[name] = unpack(
            cj.body_state(*random.normal(size=(1, 3)), turn, *random.normal(size=(2, 3)))
        )
    return unpack(cj.Scene(bodies, joints, gravity=random.normal(size=3))), states


def jacobian(mechanics, rows):
    return np.array([[float(x) for x in mechanics.projected(row.jacobian)] for row in rows])


def independent(d):
    """The indices of rows that are apart from the span of those before them."""
    kept, basis = [], np.zeros((0, d.shape[1]))
    for k, row in enumerate(d):
        rest = row - (basis @ row) @ basis
        if np.linalg.norm(rest) > 0.05 * np.linalg.norm(row):
            kept.append(k)
            basis = np.vstack([basis, rest / np.linalg.norm(rest)])
    return kept


SLOW = pytest.mark.slow


FEW = [(name, *of) for name in COORDINATES for of in ((0, 1), (2, 5))]
MANY = [
    (name, 100 * seed + count, count)
    for name, most in (("absolute", 5), ("joint", 8))
    for seed in range(10)
    for count in range(1, most + 1)
]


@pytest.mark.parametrize("redundant", [False, True])
@pytest.mark.parametrize(
    ("coordinates", "seed", "count"), [*FEW, *(pytest.param(*of, marks=SLOW) for of in MANY)]
)
def test_random_mechanisms_agree_with_dense_solutions(seed, count, coordinates, redundant):
    random = np.random.default_rng(seed)
    scene, states = mechanism(random, count, redundant)
    system = System(scene, Formulation(COORDINATES[coordinates], redundant=redundant))
    variables = system.encode(states)
    mechanics = system.mechanics(variables)
    rows = [
        row for family in system.rows(mechanics.motions, 0.0).values() for row in family.values()
    ]
    d = jacobian(mechanics, rows)
    if not redundant:
        kept = independent(d)
        rows, d = [rows[k] for k in kept], d[kept]
    units = np.eye(d.shape[1]).tolist()
    inverse = np.array([[float(x) for x in mechanics.solved(unit)] for unit in units])
    weights = np.array([float(w) for w in row_weights(scene.bodies, rows)]) if redundant else 1.0
    weighted = (np.multiply(weights, d.T)).T
    targets = d @ random.normal(size=d.shape[1])
    s = weighted @ inverse @ weighted.T
    expected = weights * (np.linalg.pinv(s, rcond=1e-11) @ (weights * targets))
    directions = [mechanics.projected(row.jacobian) for row in rows]
    solver = system.formulation.solver()
    equations = ConstraintEquations(mechanics, directions, solver, weights if redundant else None)
    change, multipliers = map(np.array, equations.response(targets.tolist()))
    conditioned = np.linalg.svd(s)[1]
    smallest = conditioned[conditioned > 1e-11 * conditioned[0]][-1] / conditioned[0]
    if smallest < 1e-5:  # too near a singular position for a comparison
        return
    bound = 1e-6 if redundant else 1e-9
    np.testing.assert_allclose(multipliers, expected, rtol=0.0, atol=bound * np.abs(expected).max())
    np.testing.assert_allclose(d @ change, targets, rtol=0.0, atol=1e-9 * np.abs(targets).max())
    np.testing.assert_allclose(
        change, inverse @ d.T @ expected, rtol=0.0, atol=bound * np.abs(change).max()
    )


def four_bars(count):
    """Parallel cranks in a row, in joint coordinates: two rows for each loop."""
    near, far = (-0.5, 0.0, 0.0), (0.5, 0.0, 0.0)
    upright = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
    bodies, joints, states = {}, {}, {}
    for k in range(count + 1):
        bodies[f"post {k}"] = bodies[f"beam {k}"] = cj.Body(1.0, (1e-3, 1 / 12, 1 / 12))
        states[f"post {k}"] = cj.body_state((k, 0.5, 0.0), upright, (0.5, 0, 0), (0, 0, -1.0))
        states[f"beam {k}"] = cj.body_state((k + 0.5, 1.0, 0.0), velocity=(1.0, 0.0, 0.0))
        joints[f"foot {k}"] = hinge("ground", f"post {k}", (float(k), 0, 0), near)
        joints[f"left {k}"] = hinge(f"post {k}", f"beam {k}", far, near)
        if k:
            joints[f"right {k}"] = cj.InlineJoint(f"beam {k - 1}", f"post {k}", far, far, Z)
    return unpack(cj.Scene(bodies, joints)), unpack(states)


def test_equations_grow_linearly_with_the_number_of_loops():
    def size(count):
        scene, states = four_bars(count)
        system = System(scene, Formulation())
        variables = system.encode(states)
        program = jax.make_jaxpr(lambda v: system.rates(v, {}, 0.0))(variables)
        return count_equations(program.jaxpr)

    small, middle, large = map(size, (3, 6, 12))
    assert large - middle <= 2.02 * (middle - small)


def chain_pattern(random, rows):
    """A Jacobian like that of a chain of bodies in hinges."""
    d = np.zeros((rows, 6 * (rows // 5 + 1)))
    for k in range(rows):
        first = 6 * (k // 5)
        d[k, max(first - 6, 0) : first + 6] = random.normal(size=first + 6 - max(first - 6, 0))
    return d


@pytest.mark.parametrize(
    ("kind", "rows", "solver"),
    [
        ("chain", 5, Exact()),
        ("chain", 13, LeastNorm()),
        pytest.param("chain", 48, Exact(), marks=SLOW),
        pytest.param("chain", 60, LeastNorm(), marks=SLOW),
        ("full", 13, Exact()),
        pytest.param("full", 48, Exact(), marks=SLOW),
        pytest.param("full", 60, LeastNorm(), marks=SLOW),
    ],
)
def test_systems_of_any_size_are_lowered_natively(rows, kind, solver):
    random = np.random.default_rng(rows)
    d = chain_pattern(random, rows) if kind == "chain" else random.normal(size=(rows, rows + 6))
    right = random.normal(size=rows)

    def solution(entries, right):
        numbers = iter(entries)
        lists = [[next(numbers) if x else 0.0 for x in row] for row in d]
        return jnp.stack(solver.solving(gram_matrix(lists, lists))(list(right)))

    arguments = jnp.asarray(d[d != 0]), jnp.asarray(right)
    (found,) = NativeProgram(jax.make_jaxpr(solution)(*arguments))([*map(np.asarray, arguments)])
    np.testing.assert_allclose(found, np.linalg.solve(d @ d.T, right), rtol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [BlockMatrix, ScalarMatrix])
@pytest.mark.parametrize("solver", [LeastNorm(), Exact()])
def test_derivatives_of_solutions(kind, solver):
    """Forward, in reverse, and of several parameters at once in native code."""
    random = np.random.default_rng(3)
    base, rate = chain_pattern(random, 5), chain_pattern(random, 5)
    if isinstance(solver, LeastNorm):
        repeated = random.normal(size=(2, 5))
        base, rate = (np.vstack([d, repeated @ d]) for d in (base, rate))
    speeds = random.normal(size=base.shape[1])

    def system(t):
        d = base + t * rate
        return d @ d.T, d @ speeds

    def solution(t):
        s, b = system(t)
        lists = [list(row) for row in s]
        if kind is ScalarMatrix:
            return jnp.stack(solver.solving(ScalarMatrix(lists))(list(b)))
        d = [list(row) for row in base + t * rate]
        return jnp.stack(solver.solving(BlockMatrix(d, d))(list(b)))

    def expected(t):
        s, b = system(t)
        return np.linalg.pinv(s, rcond=1e-9) @ b

    step = 1e-5
    slope = (expected(step) - expected(-step)) / (2 * step)
    value, forward = jax.jvp(solution, (0.0,), (1.0,))
    close = functools.partial(
        np.testing.assert_allclose, rtol=1e-3, atol=1e-4 * np.abs(slope).max()
    )
    np.testing.assert_allclose(value, expected(0.0), rtol=1e-6, atol=1e-7 * np.abs(value).max())
    close(forward, slope)
    close(jax.jacrev(solution)(0.0), slope)

    def several(t):
        return jax.vmap(lambda rate: jax.jvp(solution, (t,), (rate,))[1])(jnp.arange(3.0))

    (native,) = NativeProgram(jax.make_jaxpr(several)(0.0))([np.asarray(0.0)])
    close(native, np.outer(np.arange(3.0), slope))


def test_a_row_without_effect_has_a_finite_weight():
    """As in a singular position; the weight of another row is the mass that it moves."""
    bodies = {"a": unpack(cj.Body(4.0, (1.0, 1.0, 1.0)))}
    rows = [Row(0.0, {"a": Wrench(force, ZERO)}, 0.0) for force in (ZERO, Vector(0.0, 1.0, 0.0))]
    np.testing.assert_allclose(row_weights(bodies, rows), [1.0, 2.0], rtol=1e-15)
