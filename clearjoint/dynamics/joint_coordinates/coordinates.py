"""Joint coordinates, and the equations of motion in them by the composite rigid body algorithm.

A clearance joint is a force element, so it does not close a loop, and in most mechanisms with
clearances the bodies and ideal joints form trees. In joint coordinates, a tree has no multipliers,
no drift and no redundant constraints, and few variables. Ideal joints that close a loop remain
constraints.

The algorithm is that of R. Featherstone, Rigid Body Dynamics Algorithms, 2008, ch. 6, for other
unknowns. Each joint connects a carried body to its carrier, the next body towards the root of the
tree. The book solves for the rate u' of each joint's speed u, relative to the carrier. This module
solves for

    r = u' + axis . (angular acceleration of the carrier due to all u'),

the rate relative to a carrier whose rotation about the joint's axis is not accelerated. The angular
acceleration that remains if all u' are zero is left out, so that all r are zero if all u' are. For
a translation, r = u'.

The purpose is accuracy. With the unknowns u', the inertia of the carried bodies about the axis
enters the carrier's equations twice, with opposite signs, and the two terms cancel. With the
unknowns r, it does not enter the carrier's equations at all. In the double pendulum of
`clearjoint.mechanisms`, arm 2 has 0.001 kg m^2 about the hinge and arm 3, which it carries, has 2.3
kg m^2. There the rounding errors of the cancelling terms cost two digits of the results for the
last impacts of a run. If the joints' axes are coordinate axes, the entries of the equations from
which this inertia has disappeared are exact zeros, which the compiled program omits.

A branch is a body of a tree with its carrier and the joint between them, if there is one. A link is
the body with its kinematics, in the axes of the tree's root body. The tree's origin is the point on
the ground of the root's joint or, if no joint carries the root, the root's centre of mass. A twist
consists of the angular velocity of a body and the velocity of the body's point at the tree's
origin. The columns of a link are the twists that a unit of each speed of its joint causes.

Arguments and results of the type `Speeds` have one entry for each speed: those of the first tree
from its root to its leaves, then those of the second, and so on. Rates, changes of speeds and
displacements of this type have the form of r.
"""

from collections.abc import Collection, Iterator
from functools import cached_property, reduce
from itertools import pairwise
from typing import TypeAlias

from ...math.linear_solvers import OrderedFactorisation
from ...math.vectors import ZERO, Matrix, Scalar, Vector, add, subtract
from ...model.bodies import GROUND, GROUND_MOTION, NO_WRENCH, BodyState, Motion
from ...model.joints.base import Motions, Row
from ...model.joints.motion_subspaces import REST, Twist
from ...model.scene import Scene
from ..coordinates import (
    AbstractCoordinates,
    AbstractMechanics,
    BodyAcceleration,
    MotionVariables,
    Speeds,
    Wrenches,
    free_motion,
)
from .trees import (
    UPRIGHT,
    FreeBranch,
    Inertia,
    JointedBranch,
    Link,
    TreeBranch,
    central_inertia,
    forest,
    inertia,
)

ForceAndMoment: TypeAlias = tuple[Vector, Vector]
"""Force, N, and moment about the centre of mass of the body, N m, in the tree's axes."""


TreeVariables: TypeAlias = dict[str, MotionVariables]
"""Variables by name of body: a `JointState` (relative positions and speeds) if a joint carries the
body, a `BodyState` (position, orientation, velocity and spin) if it is free."""


class JointMechanics(AbstractMechanics):
    """Equations of motion of all trees of a scene.

    The mass matrix of each tree is factorised once, for all forces and constraints.

    **Arguments:** `scene`: with vectors as separate scalars (`Vector`); `variables`: joint
    coordinates and speeds, by name of body.
    """

    def __init__(self, scene: Scene, variables: TreeVariables):
        self._scene, self._variables = scene, variables
        self._gravity = ZERO if scene.gravity is None else scene.gravity
        trees = forest(scene)
        self._branches = [branch for tree in trees for branch in tree]
        self.motions = motions = _motions(self._branches, variables)
        self._index = {branch.body: k for k, branch in enumerate(self._branches)}
        self._parents = [self._index.get(branch.parent) for branch in self._branches]
        # In a free tree, all bodies fall alike: rates are relative to free fall, and gravity is
        # added to the accelerations (`_falls`). In a tree on the ground, gravity is a load on each
        # body (`_weights`). For each branch, `axes` is the rotation matrix of its tree's axes.
        self._axes: list[Matrix] = []
        self._falls: list[Vector] = []
        self._weights: list[Vector] = []
        self._tree_of: list[int] = []
        for number, tree in enumerate(trees):
            axes = motions[tree[0].body].rotation
            gravity = axes.transposed_times(self._gravity)
            fall, weight = (gravity, ZERO) if isinstance(tree[0], FreeBranch) else (ZERO, gravity)
            self._axes += [axes] * len(tree)
            self._falls += [fall] * len(tree)
            self._weights += [weight] * len(tree)
            self._tree_of += [number] * len(tree)
        self._links: list[Link] = []
        for branch, parent in zip(self._branches, self._parents, strict=True):
            carrier = None if parent is None else self._links[parent]
            self._links.append(branch.link(carrier, variables[branch.body]))
        self._central = [
            central_inertia(scene.bodies[branch.body], link.rotation)
            for branch, link in self._pairs()
        ]
        # Index of the first speed of each link, and the number of all speeds at the end.
        self._firsts = [0]
        for link in self._links:
            self._firsts.append(self._firsts[-1] + len(link.columns))
        # Speeds of different trees are not coupled.
        bounds = [self._firsts[k] for k, parent in enumerate(self._parents) if parent is None]
        self._trees = list(pairwise((*bounds, self._firsts[-1])))

    @cached_property
    def _factorisations(self) -> list[OrderedFactorisation]:
        """Factors of the mass matrix of each tree. Checks of constraints never need them."""
        matrix = self._mass_matrix()
        return [
            OrderedFactorisation([row[first:] for row in matrix[first:last]])
            for first, last in self._trees
        ]

    def _pairs(self) -> Iterator[tuple[TreeBranch, Link]]:
        """Return an iterator over the pairs of each branch and its link."""
        return zip(self._branches, self._links, strict=True)

    def _mass_matrix(self) -> list[list[Scalar]]:
        """Return the lower triangle of the mass matrix, one list for each speed: row i has i + 1
        entries."""
        matrix: list[list[Scalar]] = [[0.0] * (i + 1) for i in range(self._firsts[-1])]
        # For each link, the inertia of the link and of all bodies that it carries, as far as their
        # joints transmit that inertia. It is complete when the loop, which goes from the leaves to
        # the root, reaches the link.
        composites: list[Inertia] = [
            inertia(self._scene.bodies[branch.body], link.centre, central)
            for (branch, link), central in zip(self._pairs(), self._central, strict=True)
        ]
        for k in reversed(range(len(self._links))):
            columns, first = self._links[k].columns, self._firsts[k]
            # Momentum of the composite for a unit of each speed; its products with the columns are
            # the diagonal block. The joint transmits this momentum, except the angular momentum
            # about its free axes.
            wholes = [composites[k].momentum(column) for column in columns]
            block = [[_product(column, whole) for column in columns] for whole in wholes]
            rests = [_transmitted(columns, *pair) for pair in zip(wholes, block, strict=True)]
            for j, rest in enumerate(rests):
                matrix[first + j][first:] = block[j][: j + 1]
                self._fill_row(matrix[first + j], self._parents[k], rest)
            parent = self._parents[k]
            if parent is not None:
                # By the choice of unknowns, the composite does not follow the carrier's rotation
                # about the joint's axes, so its inertia about them does not act on the carrier.
                transmitted = composites[k]
                for column, whole, rest in zip(columns, wholes, rests, strict=True):
                    transmitted = transmitted.without(column.angular, whole, rest)
                composites[parent] = composites[parent] + transmitted
        return matrix

    def _fill_row(self, row: list[Scalar], k: int | None, momentum: Twist) -> None:
        """Fill the row of one speed of the mass matrix, in place, with the products of a momentum
        with the columns of link k and of all its carriers towards the root.

        **Arguments:** `row`: the list of the row's entries; `k`: the carrier's index, ``None``
        beyond the root; `momentum`: that of the carried bodies for a unit of the speed, as far as
        it acts on link k (see `_transmitted`).
        """
        while k is not None:
            columns, first = self._links[k].columns, self._firsts[k]
            for j, column in enumerate(columns, first):
                row[j] = _product(column, momentum)
            momentum = _transmitted(columns, momentum, row[first : first + len(columns)])
            k = self._parents[k]

    def solved(self, forces: Speeds) -> Speeds:
        """Return the rates r that generalised forces, one for each speed, cause."""
        trees = zip(self._trees, self._factorisations, strict=True)
        return [rate for (i, j), tree in trees for rate in tree.solve(forces[i:j])]

    def free_rates(self, wrenches: Wrenches) -> Speeds:
        """Return the rates r that gravity and wrenches, by name of body, cause, without the
        reactions of constraints."""
        loads = {}
        for k, (force, moment) in self._loads(
            {**dict.fromkeys(self._index, NO_WRENCH), **wrenches}
        ).items():
            link, body = self._links[k], self._scene.bodies[self._branches[k].body]
            central = self._central[k]
            # Part of the load causes the accelerations at constant speeds. The remainder changes
            # the speeds.
            gyroscopic = link.spin.cross(central @ link.spin) + central @ link.angular_bias
            inertial = (link.bias - self._weights[k]) * body.mass
            loads[k] = force - inertial, moment - gyroscopic
        return self.solved(self._along_columns(loads))

    def projected(self, wrenches: Wrenches) -> Speeds:
        """Return the generalised forces, one for each speed, of wrenches by name of body."""
        return self._along_columns(self._loads(wrenches))

    def _loads(self, wrenches: Wrenches) -> dict[int, ForceAndMoment]:
        """Return force, N, and moment about the centre of mass, N m, on the links of the bodies in
        `wrenches`, in their trees' axes, by index of the link, from the roots to the leaves.

        A constraint's row acts on few bodies, so that the work does not grow with their number.
        """
        indices = sorted(self._index[name] for name in wrenches if name != GROUND)
        loads = {}
        for k in indices:
            wrench = wrenches[self._branches[k].body]
            force = self._axes[k].transposed_times(wrench.force)
            loads[k] = force, self._links[k].rotation @ wrench.moment
        return loads

    def _along_columns(self, loads: dict[int, ForceAndMoment]) -> Speeds:
        """Return the generalised forces of loads on some links, by index of the link, summed from
        the leaves to the root."""
        totals = {
            k: Twist(moment + self._links[k].centre.cross(force), force)
            for k, (force, moment) in loads.items()
        }
        forces: Speeds = [0.0] * self._firsts[-1]
        for k in reversed(range(len(self._links))):
            if k not in totals:
                continue
            columns, first = self._links[k].columns, self._firsts[k]
            along = [_product(column, totals[k]) for column in columns]
            forces[first : first + len(along)] = along
            parent = self._parents[k]
            if parent is not None:
                transmitted = _transmitted(columns, totals[k], along)
                totals[parent] = totals[parent] + transmitted if parent in totals else transmitted
        return forces

    def bias(self, row: Row) -> Scalar:
        """Return the row's Jacobian times the bodies' accelerations at constant speeds, where all
        rates r are zero.

        It is a part of the second time derivative of the constraint row's value. The part that
        remains without accelerations of the bodies is the row's own `bias`, and is not included. In
        a free tree, whose rates are relative to free fall, the accelerations include gravity.
        """
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
        """Yield for each link, from the root to the leaves, its acceleration and its rates u'.

        The acceleration is a twist: the angular acceleration of the link, rad/s^2, and the
        acceleration of its point at the tree's origin, m/s^2, as far as the rates cause them; the
        parts at constant speeds are left out. The rates u' are relative to the carrier: u' = r -
        axis . (angular acceleration of the carrier).
        """
        twists: list[Twist] = []
        for k, link in enumerate(self._links):
            parent, part = self._parents[k], rates[self._firsts[k] : self._firsts[k + 1]]
            twist = REST if parent is None else twists[parent]
            relative = [
                subtract(rate, column.angular.dot(twist.angular))
                for column, rate in zip(link.columns, part, strict=True)
            ]
            for column, rate in zip(link.columns, relative, strict=True):
                twist = twist + column * rate
            twists.append(twist)
            yield twist, relative

    def accelerations(self, rates: Speeds) -> dict[str, BodyAcceleration]:
        """Return the accelerations of the bodies, m/s^2 and rad/s^2, by name, for given rates r."""
        accelerations = {}
        for k, (twist, _) in enumerate(self._per_link(rates)):
            link, fall = self._links[k], self._falls[k]
            linear = twist.linear + twist.angular.cross(link.centre) + link.bias + fall
            angular = link.rotation.transposed_times(twist.angular + link.angular_bias)
            acceleration = BodyAcceleration(self._axes[k] @ linear, angular)
            accelerations[self._branches[k].body] = acceleration
        return accelerations

    def variable_rates(self, rates: Speeds) -> TreeVariables:
        """Return the time derivatives of each body's variables, by name, for given rates r."""
        return {
            branch.body: branch.rates(state, part, axes, self._gravity)
            for branch, state, part, axes in self._per_branch(rates)
        }

    def after_displacement(self, changes: Speeds) -> TreeVariables:
        """Return each body's variables, by name, after a small displacement along each speed, m or
        rad, in the form of r."""
        return {
            branch.body: branch.after_displacement(state, part, axes)
            for branch, state, part, axes in self._per_branch(changes)
        }

    def after_speed_change(self, changes: Speeds) -> TreeVariables:
        """Return each body's variables, by name, after a sudden change of each speed, m/s or rad/s,
        in the form of r."""
        return {
            branch.body: branch.after_speed_change(state, part, axes)
            for branch, state, part, axes in self._per_branch(changes)
        }

    def _per_branch(
        self, rates: Speeds
    ) -> Iterator[tuple[TreeBranch, MotionVariables, Speeds, Matrix]]:
        """Yield each branch with its variables, its rates u' relative to its carrier, and the axes
        of its tree, for given rates r."""
        links = zip(self._branches, self._per_link(rates), self._axes, strict=True)
        for branch, (_, part), axes in links:
            yield branch, self._variables[branch.body], part, axes


def _product(first: Twist, second: Twist) -> Scalar:
    """Return the dot product of the angular parts plus the dot product of the linear parts.

    It is the power of a load (moment and force) with a twist, or the product of a momentum with a
    column.
    """
    return add(first.angular.dot(second.angular), first.linear.dot(second.linear))


def _transmitted(columns: tuple[Twist, ...], load: Twist, along: Speeds) -> Twist:
    """Return the part of a load or momentum of carried bodies that acts on their carrier, in the
    equations for the rates r.

    It has no moments about the free axes of the joint, but all forces. (About the axis of a screw
    it has the moment -pitch times the force along the axis, with the pitch in m/rad.) The reason is
    the choice of unknowns. Suppose that the carrier's acceleration changes, but the r of the joint
    does not. The carried bodies do not follow an angular acceleration of the carrier about a free
    axis, so a moment on them about this axis does not act on the carrier. They do follow an
    acceleration of the carrier along a free translation, where r is relative to the carrier.

    **Arguments:** `columns`: twists of the joint's free directions, whose angular part is zero for
    a translation; `load`: its `angular` part is the moment, N m, or angular momentum about the
    tree's origin, and its `linear` part the force, N, or momentum; `along`: products of `load` with
    each of the columns, which for a rotation are the moments about the joint's axis.
    """
    moment = load.angular
    for column, part in zip(columns, along, strict=True):
        moment = moment - column.angular * part
    return Twist(moment, load.linear)


class JointCoordinates(AbstractCoordinates):
    """Relative positions and speeds in the ideal joints that carry the bodies.

    A body that no joint carries has the same variables as in absolute coordinates: a `BodyState`.
    Its position is the centre of mass or, for a body with an `Anchor` (a point of the body, and a
    fixed point near it), the vector from the fixed point to the body's point, m.

    These coordinates are the default, because they are faster on every mechanism measured. The
    table shows the time in µs of one evaluation of the equations of motion in native code. It is
    that of a single run, and in a batch the time per run:

    | mechanism | joint coordinates | absolute coordinates |
    |---|---|---|
    | double pendulum with clearance | 0.14 | 0.24 |
    | the same, in a batch of 64 runs | 0.04 | 0.07 |
    | ideal double pendulum | 0.03 | 0.38 |
    | double four-bar | 0.25 | 50 |
    | Bricard | 0.5 | 45 |
    | chain of 4 bodies, changing axes | 0.2 | 34 |
    | chain of 12 bodies, changing axes | 2.3 | 150 |

    The large ratios arise because fewer constraints are left, and their equations need no LAPACK.

    >>> cj.Settings(coordinates=cj.JointCoordinates()).coordinates
    JointCoordinates()
    """

    def eliminated(self, scene: Scene) -> frozenset[str]:
        """Return the names of the ideal joints that carry a body of a tree. Their coordinates are
        the variables, so that they need no constraints."""
        return frozenset(
            branch.joint for branch in _branches(scene) if isinstance(branch, JointedBranch)
        )

    def encode(self, scene: Scene, bodies: dict[str, BodyState]) -> TreeVariables:
        """Return the variables for given states of the bodies, by name.

        If a state violates an ideal joint that carries a body, the violation is dropped: the
        variables describe a motion that satisfies the joint.
        """
        poses = {GROUND: (UPRIGHT, GROUND_MOTION)}
        poses |= {n: (body.orientation, free_motion(body, None)) for n, body in bodies.items()}
        return {
            branch.body: branch.encode(poses[branch.parent], poses[branch.body])
            for branch in _branches(scene)
        }

    def decode(self, scene: Scene, variables: TreeVariables) -> dict[str, BodyState]:
        """Return the states of the bodies, by name."""
        branches, orientations = _branches(scene), {GROUND: UPRIGHT}
        motions = _motions(branches, variables)
        for branch in branches:
            state = variables[branch.body]
            orientations[branch.body] = branch.orientation(orientations[branch.parent], state)
        bodies = {}
        for name in scene.bodies:
            at, orientation = motions[name], orientations[name]
            bodies[name] = BodyState(at.position, orientation, at.velocity, at.spin)
        return bodies

    def motions(self, scene: Scene, variables: TreeVariables) -> Motions:
        """Return pose and velocities of each body and of "ground", by name, computed from the roots
        to the leaves."""
        return _motions(_branches(scene), variables)

    def mechanics(self, scene: Scene, variables: TreeVariables) -> JointMechanics:
        """Return the equations of motion of all trees."""
        return JointMechanics(scene, variables)

    def without_drift(self, scene: Scene, variables: TreeVariables) -> TreeVariables:
        """Return normalised variables of the same motion, by name of body: Euler parameters are
        scaled to unit norm if their squared norm differs from one by more than 1e-6, and angles,
        except those of screws, are moved to between -2 pi and 2 pi."""
        return {
            branch.body: branch.without_drift(variables[branch.body]) for branch in _branches(scene)
        }

    def with_speeds(
        self, scene: Scene, variables: TreeVariables, others: TreeVariables
    ) -> TreeVariables:
        """Return variables with the positions of `variables` and the speeds of `others`, by name of
        body."""
        return {
            branch.body: branch.with_speeds(variables[branch.body], others[branch.body])
            for branch in _branches(scene)
        }

    def rotation_rates(self, scene: Scene, variables: TreeVariables) -> dict[str, Scalar]:
        """Return how fast bodies rotate in the joints that carry them, rad/s, by name; those in
        spherical joints, whose Euler parameters have integration errors, are left out."""
        rates = {
            branch.body: branch.motion_subspace.rotation_rate(variables[branch.body])
            for branch in _branches(scene)
            if isinstance(branch, JointedBranch)
        }
        return {body: rate for body, rate in rates.items() if rate is not None}

    def carriers(self, scene: Scene, bodies: Collection[str]) -> frozenset[str]:
        """Return the names of those bodies on the paths that connect `bodies` in the trees whose
        joints change the poses of `bodies` relative to each other."""
        parents = {branch.body: branch.parent for branch in _branches(scene)}

        def path(body: str) -> frozenset[str]:
            """Return a body and all bodies that carry it, without the ground."""
            return frozenset() if body == GROUND else path(parents[body]) | {body}

        # A joint that carries all of the bodies moves them together.
        paths = [path(body) for body in bodies]
        return frozenset.union(*paths) - frozenset.intersection(*paths)


def _branches(scene: Scene) -> list[TreeBranch]:
    """Return the branches of all trees of a scene; a parent comes before its children."""
    return [branch for tree in forest(scene) for branch in tree]


def _motions(branches: list[TreeBranch], variables: TreeVariables) -> Motions:
    """Return pose and velocities of each body and of "ground", by name, from all branches."""
    motions: dict[str, Motion] = {GROUND: GROUND_MOTION}
    for branch in branches:
        motions[branch.body] = branch.motion(motions[branch.parent], variables[branch.body])
    return motions
