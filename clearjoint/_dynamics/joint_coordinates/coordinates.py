"""Joint coordinates, and the equations of motion in them by recursive algorithms.

The algorithms are those of R. Featherstone, Rigid Body Dynamics Algorithms, 2008, ch. 6 and 7, for
other unknowns. Each joint connects a carried body to its carrier, the next body towards the root of
the tree. The book solves for the rate u' of each joint's speed u, relative to the carrier. This
module solves for

    r = u' + axis . (angular acceleration of the carrier due to all u'),

the rate relative to a carrier whose rotation about the joint's axis is not accelerated. The angular
acceleration that remains if all u' are zero is left out, so that all r are zero if all u' are. For
a translation, r = u'.

The purpose is accuracy. With the unknowns u', the inertia of the carried bodies about the axis
enters the carrier's equations twice, with opposite signs; with the unknowns r, it does not enter
these equations. In the double pendulum of `clearjoint.mechanisms`, arm 2 has 0.001 kg m^2 about the
hinge, and arm 3, which it carries, 2.3 kg m^2: the rounding errors of the cancelling terms cost two
digits of the last impacts of a run. For coordinate axes, entries without this inertia are exact
zeros, which the compiled program omits.

Lists of the type `Speeds` have one entry for each speed: those of the first tree from its root to
its leaves, then those of the second, and so on. Rates, changes of speeds and displacements of this
type have the form of r.
"""

import abc
import operator
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import cached_property, reduce
from itertools import accumulate, chain, pairwise
from typing import TypeAlias

import jax
from typing_extensions import override

from ..._math.vectors import ZERO, EulerParameters, Matrix, Scalar, Vector, add
from ..._model.bodies import GROUND, GROUND_MOTION, NO_WRENCH, Body, BodyState, Motion, Wrench
from ..._model.joints.base import Motions, Row
from ..._model.joints.motion_subspaces import REST, Twist
from ..._model.scene import Scene
from ..coordinates import (
    AbstractCoordinates,
    AbstractMechanics,
    BodyAcceleration,
    MotionVariables,
    Speeds,
    Wrenches,
    free_motion,
)
from .inertia import (
    AbstractTreeSolver,
    Evaluate,
    LinkLoads,
    accelerated,
    along_columns,
    at_offset,
    central_inertia,
    evaluation,
    inertia,
    is_small,
    load_about,
    product,
    tree_solver,
)
from .trees import UPRIGHT, FreeBranch, JointedBranch, Link, TreeBranch, forest, topology

ForceAndMoment: TypeAlias = tuple[Vector, Vector]
"""Force, N, and moment about the centre of mass of the body, N m, in the tree's axes."""


TreeVariables: TypeAlias = dict[str, MotionVariables]
"""Variables by name of body: a `JointState` of a body on a joint, a `BodyState` of a free body."""
Walk: TypeAlias = Sequence[tuple[TreeBranch, Evaluate]]
"""Branches, each parent before its children, with how to evaluate functions of each branch."""


class JointMechanics(AbstractMechanics):
    """Equations of motion of a scene's trees at an instant, for any forces and constraints."""

    def __init__(self, scene: Scene, variables: TreeVariables):
        self._scene, self._variables = scene, variables
        self._gravity = ZERO if scene.gravity is None else scene.gravity
        trees = forest(scene)
        self._branches = [branch for tree in trees for branch in tree]
        self.motions = motions = motions_of(_walk(trees), variables)
        self._index = {branch.body: k for k, branch in enumerate(self._branches)}
        # Constant zeros: the inertia of a massless body then takes no operations.
        self._bodies = {
            name: jax.tree.map(lambda _: 0.0, body) if body.is_massless else body
            for name, body in scene.bodies.items()
        }
        self._parents = [self._index.get(branch.parent) for branch in self._branches]
        # In a free tree, all bodies fall alike: rates are relative to free fall, and gravity is
        # added to the accelerations (`_falls`). In a tree on the ground, gravity is a load on each
        # body (`_weights`). Both are accelerations, m/s^2, in the axes of the branch's tree, whose
        # rotation matrix to global axes is in `_axes`. `_central` has the inertias about centres of
        # mass, kg m^2, in the tree's axes. All these lists have an entry per branch.
        self._axes: list[Matrix] = []
        self._falls: list[Vector] = []
        self._weights: list[Vector] = []
        self._tree_of: list[int] = []
        self._links: list[Link] = []
        self._central: list[Matrix] = []
        for number, tree in enumerate(trees):
            axes = motions[tree[0].body].rotation
            gravity = axes.transposed_times(self._gravity)
            fall, weight = (gravity, ZERO) if isinstance(tree[0], FreeBranch) else (ZERO, gravity)
            self._axes += [axes] * len(tree)
            self._falls += [fall] * len(tree)
            self._weights += [weight] * len(tree)
            self._tree_of += [number] * len(tree)
            # A small tree gets a mass matrix, whose inertias refer to one point. In a large one,
            # `_link` is traced once for all links of a kind, whose names are left out for this.
            evaluate, one_point = evaluation(len(tree)), is_small(len(tree))
            for branch in tree:
                parent = self._index.get(branch.parent)
                carrier = None if parent is None else self._links[parent]
                state, body = variables[branch.body], self._bodies[branch.body]
                link, central = evaluate(_link, branch.nameless(), carrier, state, body, one_point)
                self._links.append(link)
                self._central.append(central)
        # Index of the first link of each tree, and of the first speed of each link, with the number
        # of all links and of all speeds at the end.
        self._starts = list(accumulate(map(len, trees), initial=0))
        self._firsts = list(accumulate((len(link.columns) for link in self._links), initial=0))
        self._evaluate = [evaluation(len(tree)) for tree in trees for _ in tree]

    @cached_property
    def _solvers(self) -> list[AbstractTreeSolver]:
        # Made on first use: some checks don't need them. The links of one tree are those from i to
        # j - 1; its solver counts them from zero.
        solvers = []
        for i, j in pairwise(self._starts):
            parents = [None if parent is None else parent - i for parent in self._parents[i:j]]
            bodies = [self._bodies[branch.body] for branch in self._branches[i:j]]
            solvers.append(tree_solver(self._links[i:j], parents, bodies, self._central[i:j]))
        return solvers

    def _by_link(self, numbers: Speeds) -> list[Speeds]:
        return [numbers[i:j] for i, j in pairwise(self._firsts)]

    @override
    def solved(self, forces: Speeds) -> Speeds:
        return self._rates({}, self._by_link(forces))

    def _rates(self, loads: LinkLoads, forces: Sequence[Speeds]) -> Speeds:
        """Return the rates r that the `loads` on links, and generalised `forces` in joints, cause.
        The latter have an entry for each link, with a force for each speed of its joint."""
        rates: list[Speeds] = []
        # As in `_solvers`, i to j - 1 are the links of one tree.
        for (i, j), solver in zip(pairwise(self._starts), self._solvers, strict=True):
            rates += solver.rates({k - i: loads[k] for k in range(i, j) if k in loads}, forces[i:j])
        return list(chain(*rates))

    @override
    def free_rates(self, wrenches: Wrenches) -> Speeds:
        loads = {}
        for k, branch in enumerate(self._branches):
            wrench, mass = wrenches.get(branch.body, NO_WRENCH), self._bodies[branch.body].mass
            place = self._links[k], self._axes[k], self._central[k]
            loads[k] = self._evaluate[k](_effective_load, wrench, *place, mass, self._weights[k])
        return self._rates(loads, self._by_link([0.0] * self._firsts[-1]))

    @override
    def projected(self, wrenches: Wrenches) -> Speeds:
        loads = {k: self._links[k].load(*load) for k, load in self._loads(wrenches).items()}
        # The Jacobian of a constraint has wrenches on few bodies, so that only these and their
        # carriers are visited.
        forces = along_columns(self._links, self._parents, loads, self._evaluate)
        return list(chain(*forces))

    def _loads(self, wrenches: Wrenches) -> dict[int, ForceAndMoment]:
        """Return each wrench in the axes of its body's tree, by index of the link and in the order
        of links, without the wrench on the ground."""
        indices = sorted(self._index[name] for name in wrenches if name != GROUND)
        bodies = {k: wrenches[self._branches[k].body] for k in indices}
        return {k: _in_tree(at, self._links[k], self._axes[k]) for k, at in bodies.items()}

    @override
    def bias(self, row: Row) -> Scalar:
        # The terms of each tree are added up first, so that rounding errors of a tree's sum do not
        # depend on other trees.
        sums: dict[int, Scalar] = {}
        for k, (force, moment) in self._loads(row.jacobian).items():
            link, tree = self._links[k], self._tree_of[k]
            bias = link.bias + self._falls[k]
            part = add(force.dot(bias), moment.dot(link.angular_bias))
            sums[tree] = add(sums.get(tree, 0.0), part)
        return reduce(add, sums.values(), 0.0)

    def _per_link(self, rates: Speeds) -> Iterator[tuple[Twist, Speeds]]:
        """Yield for each link, from the roots to the leaves, its acceleration without the part at
        constant speeds, and the u' of its joint. `rates`: r of all joints (see the module)."""
        twists: list[Twist] = []
        by_link = zip(self._links, self._by_link(rates), strict=True)
        for k, (link, joint_rates) in enumerate(by_link):
            parent = self._parents[k]
            carrier = REST if parent is None else twists[parent]
            twist, relative = self._evaluate[k](
                accelerated, link.columns, joint_rates, link.offset, carrier
            )
            twists.append(twist)
            yield twist, relative

    @override
    def accelerations(self, rates: Speeds) -> dict[str, BodyAcceleration]:
        return {
            self._branches[k].body: self._evaluate[k](
                _body_acceleration, twist, self._links[k], self._axes[k], self._falls[k]
            )
            for k, (twist, _) in enumerate(self._per_link(rates))
        }

    @override
    def variable_rates(self, rates: Speeds) -> TreeVariables:
        pairs = self._per_branch(rates)
        return {branch.body: branch.rates(*parts, self._gravity) for branch, parts in pairs}

    @override
    def after_displacement(self, changes: Speeds) -> TreeVariables:
        pairs = self._per_branch(changes)
        return {branch.body: branch.after_displacement(*parts) for branch, parts in pairs}

    @override
    def after_speed_change(self, changes: Speeds) -> TreeVariables:
        pairs = self._per_branch(changes)
        return {branch.body: branch.after_speed_change(*parts) for branch, parts in pairs}

    def _per_branch(
        self, rates: Speeds
    ) -> Iterator[tuple[TreeBranch, tuple[MotionVariables, Speeds, Matrix]]]:
        """Yield each branch, with its variables, its joint's rates u' for given `rates` r of all
        joints, and the rotation matrix from the axes of its tree to global axes."""
        links = zip(self._branches, self._per_link(rates), self._axes, strict=True)
        for branch, (_, relative), axes in links:
            yield branch, (self._variables[branch.body], relative, axes)


def _link(
    branch: TreeBranch, carrier: Link | None, state: MotionVariables, body: Body, one_point: bool
) -> tuple[Link, Matrix]:
    link = branch.link(carrier, state, one_point)
    return link, central_inertia(body, link.rotation)


def _in_tree(wrench: Wrench, link: Link, axes: Matrix) -> ForceAndMoment:
    return axes.transposed_times(wrench.force), link.rotation @ wrench.moment


def _effective_load(
    wrench: Wrench, link: Link, axes: Matrix, central: Matrix, mass: Scalar, weight: Vector
) -> Twist:
    """Return the load of wrench and weight on a link, less the one that the link's motion at
    constant speeds requires. `axes`: from the tree's axes to global ones. In the tree's axes,
    `central` is the inertia about the centre of mass, kg m^2, and `weight` is per mass, m/s^2."""
    force, moment = _in_tree(wrench, link, axes)
    gyroscopic = link.spin.cross(central @ link.spin) + central @ link.angular_bias
    inertial = (link.bias - weight) * mass
    return link.load(force - inertial, moment - gyroscopic)


def _body_acceleration(twist: Twist, link: Link, axes: Matrix, fall: Vector) -> BodyAcceleration:
    linear = twist.linear + twist.angular.cross(link.arm) + link.bias + fall
    angular = link.rotation.transposed_times(twist.angular + link.angular_bias)
    return BodyAcceleration(axes @ linear, angular)


class AbstractBranchCoordinates(AbstractCoordinates):
    """Base class of coordinates that describe each body as free, by a `FreeBranch`, or relative to
    the body that carries it in a joint, by a `JointedBranch`. Variables are by name of body."""

    @abc.abstractmethod
    def walk(self, scene: Scene) -> Walk:
        """Return the branches of all bodies of a scene."""

    @override
    def encode(self, scene: Scene, bodies: dict[str, BodyState]) -> TreeVariables:
        return encoded(self.walk(scene), bodies)

    @override
    def decode(self, scene: Scene, variables: TreeVariables) -> dict[str, BodyState]:
        bodies = decoded(self.walk(scene), variables)
        return {name: bodies[name] for name in scene.bodies}

    @override
    def motions(self, scene: Scene, variables: TreeVariables) -> Motions:
        return motions_of(self.walk(scene), variables)

    @override
    def without_drift(self, scene: Scene, variables: TreeVariables) -> TreeVariables:
        kept = {}
        for branch, evaluate in self.walk(scene):
            state = variables[branch.body]
            kept[branch.body] = evaluate(type(branch).without_drift, branch.nameless(), state)
        return kept

    @override
    def with_speeds(
        self, scene: Scene, variables: TreeVariables, others: TreeVariables
    ) -> TreeVariables:
        return {
            branch.body: branch.with_speeds(variables[branch.body], others[branch.body])
            for branch, _ in self.walk(scene)
        }


class JointCoordinates(AbstractBranchCoordinates):
    """Positions and speeds in ideal joints: of each body relative to the one that carries it.

    A clearance joint is a force element, so that in most mechanisms with clearances the bodies and
    ideal joints form trees, without multipliers, drift and redundant constraints in these
    coordinates. Ideal joints that close a loop remain constraints. The first body of a tree without
    an ideal joint to the ground has the same variables as in absolute coordinates.

    Joint coordinates are the default, since they are faster on every mechanism measured: for the
    double pendulum with clearance, one evaluation of the equations of motion takes 0.14 µs, and
    0.24 µs in absolute coordinates, which have more constraints.

    >>> cj.Settings(coordinates=cj.JointCoordinates()).coordinates
    JointCoordinates()
    """

    @override
    def walk(self, scene: Scene) -> Walk:
        return _walk(forest(scene))

    @override
    def eliminated(self, scene: Scene) -> frozenset[str]:
        places = topology(scene).places.values()
        return frozenset(place.joint for place in places if place.joint is not None)

    @override
    def mechanics(self, scene: Scene, variables: TreeVariables) -> JointMechanics:
        return JointMechanics(scene, variables)

    @override
    def rotation_rates(self, scene: Scene, variables: TreeVariables) -> dict[str, Scalar]:
        # Joints without an angle, such as ball joints, have the rate ``None``: the integration of
        # their Euler parameters has errors even in uniform rotation.
        rates = {}
        for branch, evaluate in self.walk(scene):
            if isinstance(branch, JointedBranch):
                subspace, state = branch.motion_subspace, variables[branch.body]
                rates[branch.body] = evaluate(type(subspace).rotation_rate, subspace, state)
        return {body: rate for body, rate in rates.items() if rate is not None}

    @override
    def carriers(self, scene: Scene, bodies: Collection[str]) -> frozenset[str]:
        return topology(scene).between(bodies)


def _walk(trees: Sequence[Sequence[TreeBranch]]) -> Walk:
    return [(branch, evaluation(len(tree))) for tree in trees for branch in tree]


def written_out(branches: Iterable[TreeBranch]) -> Walk:
    """Return branches, given parents first, as a `Walk` that evaluates functions by direct calls:
    JAX traces them again for every branch."""
    return [(branch, operator.call) for branch in branches]


def encoded(walk: Walk, bodies: Mapping[str, BodyState]) -> TreeVariables:
    poses, variables = {GROUND: (UPRIGHT, GROUND_MOTION)}, {}
    for branch, evaluate in walk:
        body = bodies[branch.body]
        poses[branch.body] = body.orientation, evaluate(free_motion, body, None)
        variables[branch.body] = evaluate(
            type(branch).encode, branch.nameless(), poses[branch.parent], poses[branch.body]
        )
    return variables


def motions_of(walk: Walk, variables: TreeVariables) -> Motions:
    motions: dict[str, Motion] = {GROUND: GROUND_MOTION}
    for branch, evaluate in walk:
        motions[branch.body] = evaluate(
            type(branch).motion, branch.nameless(), motions[branch.parent], variables[branch.body]
        )
    return motions


def orientations_of(walk: Walk, variables: TreeVariables) -> dict[str, EulerParameters]:
    orientations = {GROUND: UPRIGHT}
    for branch, evaluate in walk:
        parent, state = orientations[branch.parent], variables[branch.body]
        method, nameless = type(branch).orientation, branch.nameless()
        orientations[branch.body] = evaluate(method, nameless, parent, state)
    return orientations


def decoded(walk: Walk, variables: TreeVariables) -> dict[str, BodyState]:
    motions, orientations = motions_of(walk, variables), orientations_of(walk, variables)
    return {
        name: BodyState(at.position, orientations[name], at.velocity, at.spin)
        for name, at in motions.items()
    }


def inverse_dynamics(
    scene: Scene,
    branches: Sequence[TreeBranch],
    variables: TreeVariables,
    rates: Mapping[str, Sequence[Scalar]],
) -> dict[str, Speeds]:
    """Return the generalised forces in joints, N m or N by name, with which the bodies move at
    given rates of the joints' speeds, rad/s^2 or m/s^2 by name, zero by default (recursive
    Newton-Euler algorithm, R. Featherstone 2008, ch. 5).

    Free bodies are not accelerated. Forces and gravity of the scene act, at time zero, but no
    contacts, constraints and armatures. `branches`: parents first.
    """
    motions = motions_of(written_out(branches), variables)
    gravity = ZERO if scene.gravity is None else scene.gravity
    wrenches = dict.fromkeys((GROUND, *scene.bodies), NO_WRENCH)
    for element in scene.forces.values():
        for name, wrench in element.wrenches(motions, 0.0).items():
            wrenches[name] = wrenches[name] + wrench
    links: dict[str, Link] = {}
    axes: dict[str, Matrix] = {}
    twists = {GROUND: REST}
    loads: dict[str, Twist] = {}
    for branch in branches:
        name, parent, body = branch.body, branch.parent, scene.bodies[branch.body]
        links[name] = link = branch.link(links.get(parent), variables[name], one_point=False)
        # The axes of a tree are those of its root.
        axes[name] = axes.get(parent, motions[name].rotation)
        # The acceleration due to the given rates is the carrier's, plus that in the joint. The part
        # at constant speeds is accounted for in `effective`.
        twists[name] = at_offset(twists[parent], link.offset)
        if isinstance(branch, JointedBranch) and branch.joint in rates:
            for column, rate in zip(link.columns, rates[branch.joint], strict=True):
                twists[name] = twists[name] + column * rate
        # A body's momentum changes by the load of the scene, `effective`, and by that of its joints
        # with the carrier and the carried bodies, which is the difference.
        central = central_inertia(body, link.rotation)
        place = link, axes[name], central, body.mass
        effective = _effective_load(wrenches[name], *place, axes[name].transposed_times(gravity))
        change = inertia(body.mass, link.arm, central).momentum(twists[name])
        loads[name] = change - effective
    forces: dict[str, Speeds] = {}
    # From the leaves to the roots: the load on a body includes those on the bodies that it carries.
    for branch in reversed(branches):
        link, load = links[branch.body], loads[branch.body]
        if isinstance(branch, JointedBranch):
            forces[branch.joint] = [product(column, load) for column in link.columns]
        if branch.parent != GROUND:
            loads[branch.parent] = loads[branch.parent] + load_about(load, link.offset)
    return dict(reversed(forces.items()))  # joints in the order of `branches`
