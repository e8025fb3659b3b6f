"""Equations of motion in joint coordinates, and of joints of a class of its own."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint import GROUND, constraint_report
from clearjoint._dynamics import system as dynamics
from clearjoint._math.rotations import conjugate
from clearjoint._math.vectors import fold_constants
from clearjoint._model.joints.motion_subspaces import Slider
from clearjoint.extend import (
    EulerParameters,
    Formulation,
    System,
    pack,
    quantity,
    rotation_matrix,
    unit,
    unpack,
)
from clearjoint.mechanisms import bricard, double_four_bar
from tests.dynamics.test_joint_coordinates import ABSOLUTE, JOINT, RANDOM, TURN


class Rail(cj.extend.AbstractConstraint):
    """A user-defined joint: the second body slides on the first along an axis of the latter."""

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    point: Any = quantity("m")
    axis: Any = quantity("1")
    orientation: Any = quantity("1")

    def body_names(self):
        return self.first, self.second

    def rows(self, motions, t):
        turn = rotation_matrix(self.orientation)

        def residual(first, second):
            apart = first[1].transposed_times(second[0] - first[0]) - self.point
            here, place = first[1].T, apart.cross(self.axis)
            x, y, z = (second[1] @ row for row in (turn.row_x, turn.row_y, turn.row_z))
            tilts = here.row_y.dot(z), here.row_z.dot(x), here.row_x.dot(y)
            return place.x, place.y, *tilts

        names = (self.first, self.second)
        labels = ("across 1", "across 2", "turn x", "turn y", "turn z")
        return cj.extend.rows_from_residual(
            names, labels, residual, motions[names[0]], motions[names[1]]
        )

    def motion_subspace(self, parent):
        here = rotation_matrix(self.orientation).transposed_times(unit(self.axis))
        zero = here * 0.0
        if parent == self.first:
            return Slider(self.point, zero, here, self.orientation)
        return Slider(zero, self.point, -unit(self.axis), conjugate(self.orientation))


def body():
    """A body with a full inertia matrix."""
    frame = np.linalg.qr(RANDOM.normal(size=(3, 3)))[0]
    return cj.Body(RANDOM.uniform(0.5, 2.0), frame @ np.diag(RANDOM.uniform(1.0, 1.5, 3)) @ frame.T)


def joint(kind, first, second):
    """A joint of the given kind at random points and axes."""
    one, other, axis, axis_second = RANDOM.normal(size=(4, 3))
    if kind == "revolute":
        return cj.RevoluteJoint(first, second, one, other, axis, axis_second)
    if kind == "spherical":
        return cj.SphericalJoint(first, second, one, other)
    if kind == "fixed":
        return cj.FixedJoint(first, second, one, other, TURN)
    if kind == "prismatic":
        return cj.PrismaticJoint(first, second, one, other, axis, TURN)
    if kind == "planar":
        return cj.PlanarJoint(first, second, one, other, axis, axis_second)
    if kind == "screw":
        return cj.ScrewJoint(first, second, one, other, axis, axis_second, lead=-0.7)
    if kind == "universal":
        return cj.UniversalJoint(first, second, one, other, axis, axis_second)
    return Rail(first, second, one, axis, TURN)


EDGES = {
    "standing": (
        (GROUND, "a", "revolute"), ("a", "b", "spherical"), ("b", "c", "fixed"),
        ("b", "d", "prismatic"), ("d", "e", "revolute"),
    ),
    "hanging from a ball": ((GROUND, "a", "spherical"), ("a", "b", "revolute")),
    "on a rail": ((GROUND, "a", "rail"), ("a", "b", "revolute"), (GROUND, "c", "fixed")),
    "flying": (
        ("a", "b", "revolute"), ("b", "c", "prismatic"), ("a", "d", "spherical"),
    ),
    "on a table": (
        (GROUND, "a", "planar"), ("a", "b", "universal"), ("b", "c", "planar"),
    ),
    "from a cross": (
        (GROUND, "a", "universal"), ("a", "b", "universal"), ("b", "c", "screw"),
        (GROUND, "d", "screw"),
    ),
}  # fmt: skip


SELDOM = ("standing", "on a table", "from a cross", "flying", "on a rail")


def tree(edges, backwards, gravity=(1.0, -2.0, 3.0)):
    """A scene with a joint for each edge and springs on all bodies.

    `backwards` makes the parent the second body of each joint.
    """
    names = sorted({name for *pair, _ in edges for name in pair} - {GROUND})
    joints = {
        f"{parent} {child}": joint(kind, *((child, parent) if backwards else (parent, child)))
        for parent, child, kind in edges
    }
    springs = {
        f"to {name}": cj.SpringDamper(
            GROUND if k == 0 else names[k - 1], name, *RANDOM.normal(size=(2, 3)), 30.0, 2.0, 0.1
        )
        for k, name in enumerate(names)
    }
    return cj.Scene({name: body() for name in names}, joints, springs, gravity)


def random_variables(scene):
    """Random variables of a scene, with Euler parameters of unit norm."""
    rest = cj.State({name: cj.body_state((0, 0, 0)) for name in scene.bodies})
    shapes = jax.eval_shape(lambda: JOINT.encode(unpack(scene), unpack(rest.bodies)))
    values = jax.tree.map(lambda leaf: RANDOM.normal(), shapes)
    return jax.tree.map(normalised, values, is_leaf=lambda node: isinstance(node, EulerParameters))


def normalised(node):
    if not isinstance(node, EulerParameters):
        return node
    numbers = np.array([node.e0, node.e1, node.e2, node.e3])
    return EulerParameters(*(numbers / np.linalg.norm(numbers)))


def close(found, expected, tolerance=1e-12):
    scale = max(np.abs(leaf).max() for leaf in jax.tree.leaves(expected))
    jax.tree.map(
        lambda a, b: np.testing.assert_allclose(a, b, rtol=0, atol=tolerance * scale),
        found,
        expected,
    )


def arrays(tree):
    return jax.tree.map(jnp.asarray, pack(tree))


@pytest.mark.parametrize(
    "backwards",
    [False, pytest.param(True, marks=pytest.mark.slow)],
    ids=["forwards", "backwards"],
)
@pytest.mark.parametrize(
    "kind",
    [pytest.param(kind, marks=pytest.mark.slow) if kind in SELDOM else kind for kind in EDGES],
)
def test_trees_move_as_in_absolute_coordinates(kind, backwards):
    """Accelerations equal those with multipliers. The motions satisfy the joints, their rates are
    consistent with those of the variables, and encoding and decoding are inverse."""
    scene = tree(EDGES[kind], backwards)
    variables = random_variables(scene)

    @jax.jit
    def both(variables):
        form = unpack(scene)
        bodies = JOINT.decode(form, variables)
        again = JOINT.encode(form, bodies)
        of_joints = System(form, Formulation(JOINT)).dynamics(variables, {}, 0.0)
        absolute = System(form, Formulation(ABSOLUTE)).dynamics(bodies, {}, 0.0)

        def motions(variables):
            return arrays({name: JOINT.motions(form, variables)[name] for name in form.bodies})

        rates = jax.tree.map(lambda a, b: a + 0.0 * b, of_joints.variable_rates, variables)
        moved = jax.jvp(motions, (variables,), (rates,))
        parts = again, of_joints.accelerations, absolute.accelerations
        return arrays(bodies), moved, *(arrays(part) for part in parts)

    bodies, (motions, rates), again, found, expected = both(variables)
    close(found, expected)
    close(arrays(again), arrays(variables))
    for name, motion in motions.items():
        np.testing.assert_allclose(rates[name].position, motion.velocity, atol=1e-12)
        np.testing.assert_allclose(rates[name].velocity, expected[name].linear, atol=1e-10)
        np.testing.assert_allclose(rates[name].spin, expected[name].angular, atol=1e-10)
    report = constraint_report(scene, cj.State(bodies), coordinates=JOINT)
    assert np.abs(report.values).max() < 1e-13 and np.abs(report.rates).max() < 1e-12
    assert report.redundant == ()
    names = {f"{parent} {child}" for parent, child, _ in EDGES[kind]}
    assert JOINT.eliminated(unpack(scene)) == names


@pytest.mark.parametrize(
    ("mechanism", "redundant", "left"),
    [
        (cj.mechanisms.double_pendulum, False, 0),
        pytest.param(lambda: cj.mechanisms.double_pendulum(None), False, 0, marks=pytest.mark.slow),
        pytest.param(double_four_bar, True, 10, marks=pytest.mark.slow),
        pytest.param(bricard, True, 5, marks=pytest.mark.slow),
    ],
    ids=["pendulum with clearance", "ideal pendulum", "double four-bar", "Bricard"],
)
def test_mechanisms_accelerate_as_in_absolute_coordinates(mechanism, redundant, left):
    scene, state = mechanism()
    form = fold_constants(scene)
    entry_speeds = {name: dict.fromkeys(family, 0.1) for name, family in scene.laws().items()}

    def accelerations(coordinates):
        def at(form, state):
            scene = unpack(form)
            variables = coordinates.encode(scene, unpack(state.bodies))
            formulation = Formulation(coordinates, redundant=redundant)
            found = System(scene, formulation).dynamics(variables, entry_speeds, 0.0)
            return arrays(found.accelerations), sum(map(len, found.rows.values()))

        return eqx.filter_jit(at)(form, state)

    expected, _ = accelerations(ABSOLUTE)
    found, rows = accelerations(JOINT)
    close(found, expected)
    assert rows == left


@pytest.mark.slow
def test_flying_tree_keeps_energy_and_momentum():
    edges = (("a", "b", "revolute"), ("b", "c", "revolute"), ("a", "d", "spherical"))
    scene = tree(edges, False, None)
    scene = cj.Scene(scene.bodies, scene.joints)
    bodies = JOINT.decode(unpack(scene), random_variables(scene))
    solution = cj.simulate(
        scene, cj.State(pack(bodies)), 2.0, cj.Settings(rtol=1e-11), save=cj.Saving([0.0, 2.0])
    )

    def momenta(bodies):
        linear, angular = 0.0, 0.0
        for name, part in unpack(bodies).items():
            mass, turn = scene.bodies[name].mass, rotation_matrix(part.orientation)
            own = turn @ unpack(scene).bodies[name].angular_momentum(part.spin)
            linear = linear + pack(part.velocity * mass)
            angular = angular + pack(own + (part.position * mass).cross(part.velocity))
        return linear, angular

    start, end = (
        momenta(jax.tree.map(lambda leaf, k=k: leaf[k], solution.states.bodies)) for k in (0, 1)
    )
    np.testing.assert_allclose(end, start, atol=1e-9)
    observed = cj.observe(scene, solution)
    assert np.ptp(observed.energies["kinetic"]) < 1e-9 * observed.energies["kinetic"][0]


def test_a_tree_solves_no_constraints(monkeypatch):
    """Neither stabilisation nor projection nor multipliers are traced."""
    monkeypatch.setattr(dynamics, "ConstraintEquations", None)
    scene, state = cj.mechanisms.double_pendulum()
    scene, bodies = unpack(fold_constants(scene)), unpack(state.bodies)
    variables, entry_speeds = JOINT.encode(scene, bodies), {"shoulder": {"V": 0.1, "W": 0.1}}
    system = System(scene, Formulation(JOINT, cj.Projection()))
    assert system.dynamics(variables, entry_speeds, 0.0).multipliers == {}
    assert not system.is_constrained(0.0)
    absolute = System(scene, Formulation(ABSOLUTE))
    assert absolute.is_constrained(0.0)
    assert system.project(variables, 0.0) is variables
