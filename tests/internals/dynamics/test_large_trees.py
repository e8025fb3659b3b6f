"""Equations of motion of random trees: against constraints, in extended precision, and counted."""

import dataclasses
from collections import Counter
from typing import Any

import equinox as eqx
import jax
import numpy as np
import pytest
from jax.interpreters import partial_eval

import clearjoint as cj
from clearjoint import GROUND, BodyState
from clearjoint._compilation.xla import CALLS, program_of
from clearjoint._dynamics.equations_of_motion import constraint_rows, flattened
from clearjoint._dynamics.joint_coordinates import inertia
from clearjoint._dynamics.joint_coordinates.coordinates import JointMechanics
from clearjoint._dynamics.joint_coordinates.trees import UPRIGHT, FreeBranch, forest
from clearjoint._math.rotations import conjugate
from clearjoint._math.vectors import fold_constants
from clearjoint._model.joints.motion_subspaces import Slider
from clearjoint.extend import (
    EulerParameters,
    Formulation,
    JointState,
    System,
    Vector,
    Wrench,
    pack,
    quantity,
    rotation_matrix,
    unit,
    unpack,
)
from studies.benchmark.chain import ideal_chain
from tests.support.motions import AT_REST
from tests.support.profiling import assert_linear, calls

ABSOLUTE, JOINT = cj.AbsoluteCoordinates(), cj.JointCoordinates()
KINDS = "revolute", "spherical", "prismatic", "universal", "screw", "fixed", "planar", "rail"
SIZES = [3, pytest.param(60, marks=pytest.mark.slow)]
pytestmark = [
    pytest.mark.filterwarnings("ignore::clearjoint.UnusualValueWarning"),
    pytest.mark.filterwarnings("ignore::clearjoint.LooseBodyWarning"),
]


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


def body(random):
    """A body with principal moments between 0.001 and 2.3 kg m^2, as those of the pendulum."""
    moments = np.exp(random.uniform(np.log(5e-4), np.log(1.15), 3))
    frame = np.linalg.qr(random.normal(size=(3, 3)))[0]
    tensor = frame @ np.diag(moments.sum() - moments) @ frame.T
    return cj.Body(np.exp(random.uniform(np.log(0.1), np.log(10.0))), 0.5 * (tensor + tensor.T))


def joint(random, kind, first, second):
    one, other, axis, axis_second = random.normal(size=(4, 3))
    turn = random.normal(size=4)
    turn /= np.linalg.norm(turn)
    names, points = (first, second), (one, other)
    return {
        "revolute": lambda: cj.RevoluteJoint(*names, *points, axis, axis_second),
        "spherical": lambda: cj.SphericalJoint(*names, *points),
        "prismatic": lambda: cj.PrismaticJoint(*names, *points, axis, turn),
        "universal": lambda: cj.UniversalJoint(*names, *points, axis, axis_second),
        "screw": lambda: cj.ScrewJoint(*names, *points, axis, axis_second, lead=0.7),
        "fixed": lambda: cj.FixedJoint(*names, *points, turn),
        "planar": lambda: cj.PlanarJoint(*names, *points, axis, axis_second),
        "rail": lambda: Rail(*names, one, axis, turn),
    }[kind]()


def random_scene(random, sizes, kinds=KINDS, is_chain=False, on_ground=0.6):
    """Trees of the given sizes, on the ground with a probability, or free, with bodies and joints
    in random order."""
    bodies, joints = {}, {}
    for size in sizes:
        names = [f"{random.integers(10**9)} {k}" for k in range(size)]
        parents = [GROUND if random.random() < on_ground else None]
        parents += [names[k if is_chain else random.integers(k + 1)] for k in range(size - 1)]
        for name, parent in zip(names, parents, strict=True):
            bodies[name] = body(random)
            if parent is not None:
                pair = [parent, name]
                random.shuffle(pair)
                joints[f"to {name}"] = joint(random, random.choice(kinds), *pair)
    order = random.permutation(list(bodies)).tolist()
    return cj.Scene(
        {name: bodies[name] for name in order},
        {name: joints[name] for name in random.permutation(list(joints)).tolist()},
        gravity=random.normal(size=3),
    )


def random_variables(random, scene):
    """Random variables of a scene in scalar form."""

    def number(_):
        return np.float64(random.normal())

    def position(node):
        if not isinstance(node, EulerParameters):
            return jax.tree.map(number, node)
        parts = random.normal(size=4)
        return EulerParameters(*(parts / np.linalg.norm(parts)))

    variables = {}
    for branch in (branch for tree in forest(scene) for branch in tree):
        at = UPRIGHT, AT_REST
        state = branch.encode(at, at)
        if isinstance(branch, FreeBranch):
            turn = position(state.orientation)
            vectors = [Vector(*random.normal(size=3)) for _ in range(3)]
            variables[branch.body] = BodyState(vectors[0], turn, *vectors[1:])
        else:
            place = jax.tree.map(
                position, state.position, is_leaf=lambda node: isinstance(node, EulerParameters)
            )
            variables[branch.body] = JointState(place, tuple(map(number, state.speeds)))
    return variables


def random_wrenches(random, scene):
    return {
        name: Wrench(*(Vector(*random.normal(size=3)) for _ in range(2))) for name in scene.bodies
    }


def array(accelerations):
    """Rows of linear and angular acceleration."""
    return np.array([[*one.linear, *one.angular] for one in accelerations], dtype=np.longdouble)


def constrained_accelerations(scene, bodies, wrenches):
    """Accelerations and multipliers from the rows of all joints, by a pseudoinverse."""
    motions = ABSOLUTE.motions(scene, bodies)
    rows = flattened(constraint_rows(scene, ABSOLUTE, motions, 0.0))
    n = 6 * len(bodies)
    inverse, free, jacobian = np.zeros((n, n)), np.zeros(n), np.zeros((len(rows), n))
    for k, (name, one) in enumerate(scene.bodies.items()):
        at, spin = slice(6 * k, 6 * k + 6), np.array([*motions[name].spin], dtype=float)
        tensor = np.asarray(pack(one.inertia), dtype=float)
        tensor = np.diag(tensor) if tensor.ndim == 1 else tensor
        inverse[at, at][:3, :3] = np.eye(3) / one.mass
        inverse[at, at][3:, 3:] = np.linalg.inv(tensor)
        force, moment = (
            np.array([*part]) for part in (wrenches[name].force, wrenches[name].moment)
        )
        load = np.concatenate([force, moment - np.cross(spin, tensor @ spin)])
        free[at] = inverse[at, at] @ load + np.array([*scene.gravity, 0.0, 0.0, 0.0])
        for i, row in enumerate(rows):
            if name in row.jacobian:
                jacobian[i, at] = [*row.jacobian[name].force, *row.jacobian[name].moment]
    bias = np.array([row.bias for row in rows], dtype=float)
    solution = np.linalg.lstsq(
        jacobian @ inverse @ jacobian.T, -bias - jacobian @ free, rcond=1e-13
    )
    return (free + inverse @ jacobian.T @ solution[0]).reshape(-1, 6)


def solved(scene, variables, wrenches):
    mechanics = JointMechanics(scene, variables)
    found = mechanics.accelerations(mechanics.free_rates(wrenches))
    return array(found[name] for name in scene.bodies)


@pytest.mark.parametrize("count", SIZES)
def test_trees_accelerate_as_bodies_under_constraints(count):
    for seed in range(count):
        random = np.random.default_rng(seed)
        scene = unpack(random_scene(random, random.integers(1, 9, size=2)))
        variables, wrenches = random_variables(random, scene), random_wrenches(random, scene)
        expected = constrained_accelerations(scene, JOINT.decode(scene, variables), wrenches)
        error = np.abs(solved(scene, variables, wrenches) - expected).max()
        assert error < 1e-8 * np.abs(expected).max(), seed


@pytest.mark.parametrize("count", SIZES)
def test_responses_to_generalised_forces_are_those_of_the_inertia(count):
    """M H r for the rates r that forces cause, projected by H^T, are the forces."""
    for seed in range(count):
        random = np.random.default_rng(seed)
        scene = unpack(random_scene(random, random.integers(1, 9, size=2)))
        mechanics = JointMechanics(scene, random_variables(random, scene))
        rest = mechanics.accelerations([0.0] * len(mechanics.projected({})))
        for _ in range(2):
            forces = random.normal(size=len(mechanics.projected({}))).tolist()
            rates = mechanics.solved(forces)
            wrenches = {}
            for name, at in mechanics.accelerations(rates).items():
                linear, angular = at.linear - rest[name].linear, at.angular - rest[name].angular
                one = scene.bodies[name]
                wrenches[name] = Wrench(linear * one.mass, one.angular_momentum(angular))
            np.testing.assert_allclose(
                mechanics.projected(wrenches), forces, rtol=0, atol=1e-9, err_msg=str(seed)
            )


@pytest.mark.parametrize("count", SIZES)
def test_variables_are_found_again_and_their_rates_are_those_of_the_motions(count):
    """By differences of the motions of all bodies over 2e-6 s."""
    for seed in range(count):
        random = np.random.default_rng(seed)
        scene = unpack(random_scene(random, random.integers(1, 9, size=2)))
        variables = random_variables(random, scene)
        again = JOINT.encode(scene, JOINT.decode(scene, variables))
        expected = columns(JOINT.motions(scene, variables), scene.bodies)
        found = columns(JOINT.motions(scene, again), scene.bodies)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
        dynamics = System(scene, Formulation(JOINT)).dynamics(variables, {}, 0.0)
        ahead, behind = (
            columns(JOINT.motions(scene, moved(variables, dynamics, time)), scene.bodies)
            for time in (1e-6, -1e-6)
        )
        accelerations = array(dynamics.accelerations[name] for name in scene.bodies)
        rates = np.hstack([expected[:, 3:6], accelerations])
        error = np.abs((ahead - behind)[:, :9] / 2e-6 - rates).max()
        assert error < 1e-6 * np.abs(rates).max(), seed
        assert JOINT.eliminated(scene) == set(scene.joints)


def columns(motions, names):
    """Positions, velocities, spins and rotations of bodies, (N, 18)."""
    parts = ("position", "velocity", "spin", "rotation")
    return np.array(
        [jax.tree.leaves([getattr(motions[name], part) for part in parts]) for name in names]
    )


def moved(variables, dynamics, time):
    """The variables after a short time, to first order."""
    return jax.tree.map(lambda x, rate: x + time * rate, variables, dynamics.variable_rates)


def errors_in_extended_precision(random, bodies):
    """Relative errors of the accelerations of a chain in doubles: with the mass matrix, and with
    the articulated body algorithm."""

    def cast(tree):
        return jax.tree.map(lambda leaf: np.longdouble(leaf) if np.ndim(leaf) == 0 else leaf, tree)

    kinds = "revolute", "spherical", "prismatic"
    scene = unpack(random_scene(random, [bodies], kinds, is_chain=True))
    numbers = random_variables(random, scene), random_wrenches(random, scene)
    errors = []
    for largest in (bodies, 0):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(inertia, "LARGEST_DENSE", largest)
            expected = solved(cast(scene), *map(cast, numbers))
            errors.append(np.abs(solved(scene, *numbers) - expected).max() / np.abs(expected).max())
    return errors


@pytest.mark.parametrize(
    ("bodies", "count", "bound"),
    [(12, 5, 2e-14), pytest.param(60, 9, 5e-14, marks=pytest.mark.slow)],
)
def test_long_chains_keep_their_digits(bodies, count, bound):
    """The masses and inertias differ by factors of a hundred and of a thousand."""
    errors = [
        errors_in_extended_precision(np.random.default_rng(seed), bodies) for seed in range(count)
    ]
    by_matrix, recursive = np.median(errors, axis=0)
    assert recursive < bound
    assert recursive < 0.5 * by_matrix


def program(scene, state, evaluated):
    """The jaxpr of a function of the system and its variables, without what no result needs."""
    form = fold_constants(scene)

    def rates(tree, variables):
        system = System(unpack(dataclasses.replace(form, tree=tree)), Formulation())
        return evaluated(system, variables)

    variables = System(unpack(form), Formulation()).encode(unpack(state.bodies))
    closed = program_of(rates, form.tree, variables).jaxpr
    outputs = [True] * len(closed.jaxpr.outvars)
    return partial_eval.dce_jaxpr(closed.jaxpr, outputs, instantiate=False)[0]


def counted(jaxpr, traced):
    """The number of each operation, and in `traced` the inner jaxprs."""
    operations = Counter()
    for equation in jaxpr.eqns:
        if equation.primitive.name in CALLS:
            inner = equation.params[CALLS[equation.primitive.name]].jaxpr
            traced[id(inner)] = inner
            operations += counted(inner, traced)
        else:
            operations[equation.primitive.name] += 1
    return operations


def right_side(system, variables):
    return system.rates(variables, {}, 0.0)[0]


def response_to_a_row(system, variables):
    """The rates that an impulse between the last body and the first one causes."""
    mechanics, names = system.mechanics(variables), list(system.scene.bodies)
    force = Wrench(Vector(1.0, 2.0, 0.0), Vector(0.0, 0.0, 3.0))
    return mechanics.solved(mechanics.projected({names[-1]: force, names[0]: force}))


@pytest.mark.parametrize("evaluated", [right_side, response_to_a_row])
def test_operations_are_proportional_to_the_number_of_bodies(evaluated):
    counts, kinds = [], []
    for bodies in (8, 16, 32):
        traced = {}
        counts.append(counted(program(*ideal_chain(bodies), evaluated), traced))
        kinds.append(len(traced))
    numbers = [operations.total() for operations in counts]
    assert counts[0]["mul"] > 100
    assert numbers[2] - numbers[1] == pytest.approx(2 * (numbers[1] - numbers[0]), rel=0.03)
    # Each function is traced once, whatever the number of bodies.
    assert kinds[1] == kinds[2]


@pytest.mark.parametrize("count", SIZES)
def test_carriers_are_on_the_paths_between_bodies(count):
    for seed in range(10 * count):
        random = np.random.default_rng(seed)
        scene = unpack(random_scene(random, random.integers(1, 9, size=2), ("spherical",)))
        parents = {branch.body: branch.parent for tree in forest(scene) for branch in tree}
        bodies = random.choice([GROUND, *scene.bodies], size=random.integers(1, 4)).tolist()
        paths = []
        for name in bodies:
            path = []
            while name != GROUND:
                path.append(name)
                name = parents[name]
            paths.append(set(path))
        expected = set.union(*paths) - set.intersection(*paths)
        assert JOINT.carriers(scene, bodies) == expected, seed


def test_operations_of_python_are_proportional_to_the_number_of_bodies():
    counts = []
    for bodies in (25, 50, 100):
        scene, state = ideal_chain(bodies)
        form, names = unpack(scene), [GROUND, *scene.bodies]

        def whole(form=form, state=state, names=names):
            variables = JOINT.encode(form, unpack(state.bodies))
            JOINT.decode(form, variables)
            JOINT.rotation_rates(form, variables)
            JOINT.eliminated(form)
            for pair in zip(names[1:], names, strict=False):
                JOINT.carriers(form, pair)

        counts.append(calls(whole))
    assert_linear(counts, 1.05)
