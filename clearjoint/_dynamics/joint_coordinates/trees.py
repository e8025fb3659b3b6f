"""Trees of bodies: their branches, and the kinematics and inertia of their bodies.

A branch is one body with its parent: the next body towards the root of the tree or, for the root,
the ground. A link is the body with its kinematics in the axes of the tree's root body, about one
reference point. In a small tree, all bodies have one reference point, namely the point on the
ground of the root's joint or, for a free root, the root's centre of mass. So the inertia of the
root is constant if the root is free or its joint only lets it rotate, and constant vectors keep
their exact zeros. In a large tree, the reference point of a body is its point at the joint's point
on the parent, so that no lever arm grows with the tree. A twist is the angular velocity of a body
with the velocity of its reference point. "At constant speeds" means: the part of an acceleration
that remains if the time derivatives of all joint speeds are zero.
"""

import weakref
from collections.abc import Collection
from dataclasses import field, replace
from typing import ClassVar, NamedTuple, TypeAlias

from ..._math.rotations import (
    composed,
    conjugate,
    euler_parameter_rates,
    kept_unit,
    normalised,
    turned,
)
from ..._math.vectors import (
    IDENTITY,
    NOTHING,
    UNIT_X,
    UNIT_Y,
    UNIT_Z,
    ZERO,
    EulerParameters,
    Matrix,
    Scalar,
    Vector,
    add,
    multiply,
    subtract,
)
from ..._model.bodies import GROUND, BodyState, Motion
from ..._model.joints.base import AbstractConstraint
from ..._model.joints.ideal import AbstractDriveableJoint
from ..._model.joints.motion_subspaces import AbstractMotionSubspace, JointState, Relative, Twist
from ..._model.scene import Scene
from ..._model.tree_dataclass import STATIC, tree_dataclass
from ..coordinates import Speeds, anchors, free_motion


@tree_dataclass
class Link:
    """A body of a tree at one instant; all vectors are in the tree's axes.

    - `rotation`: matrix that maps components in body axes to components in the tree's axes.
    - `offset`: m, from the parent's reference point to the body's.
    - `arm`: m, from the body's reference point to its centre of mass.
    - `spin`: rad/s, angular velocity.
    - `angular_bias`: rad/s^2, angular acceleration at constant speeds.
    - `bias`: m/s^2, acceleration of the centre of mass at constant speeds.
    - `gradient`: 1/s^2, matrix that maps the vector between two points of the body to the
      difference of their accelerations at constant speeds.
    - `columns`: for each speed of the link's joint, the twist that a unit of this speed causes.
    - `armature`: inertia of the joint's drive, kg m^2 or kg (see `AbstractDriveableJoint`).
    """

    rotation: Matrix
    offset: Vector
    arm: Vector
    spin: Vector
    angular_bias: Vector
    bias: Vector
    gradient: Matrix
    columns: tuple[Twist, ...]
    armature: Scalar | None = None

    def load(self, force: Vector, moment: Vector) -> Twist:
        """Return force and moment at the centre of mass as a load about the reference point, in the
        form of a `Twist`: `angular` is the moment, N m, and `linear` the force, N."""
        return Twist(moment + self.arm.cross(force), force)


GROUND_LINK = Link(IDENTITY, ZERO, ZERO, ZERO, ZERO, ZERO, NOTHING, ())
"""The ground, as the parent of links."""


def _gradient(spin: Vector, angular_bias: Vector) -> Matrix:
    """Return the matrix, 1/s^2, that maps r to angular_bias x r + spin x (spin x r)."""
    w, b = spin, angular_bias
    xx, yy, zz = (multiply(part, part) for part in w)
    xy, xz, yz = multiply(w.x, w.y), multiply(w.x, w.z), multiply(w.y, w.z)
    return Matrix(
        Vector(subtract(0.0, add(yy, zz)), subtract(xy, b.z), add(xz, b.y)),
        Vector(add(xy, b.z), subtract(0.0, add(xx, zz)), subtract(yz, b.x)),
        Vector(subtract(xz, b.y), add(yz, b.x), subtract(0.0, add(xx, yy))),
    )


UPRIGHT = EulerParameters(1.0, 0.0, 0.0, 0.0)
"""Euler parameters of a body whose axes are the global ones."""
BodyPose: TypeAlias = tuple[EulerParameters, Motion]
"""Orientation of a body, and the body's motion."""


@tree_dataclass
class FreeBranch:
    """A free body, the root of a tree, with a `BodyState` as variables as in absolute coordinates.
    The six speeds are velocity (m/s) and spin (rad/s), both in body axes. Rates of the velocity are
    relative to free fall, since gravity accelerates all bodies of a free tree alike. `position` is
    that of the centre of mass or, with an `anchor`, the vector from the point on the ground to that
    on the body (see `anchors`). Methods are those of `JointedBranch`, but ignore the parent.
    """

    body: str = field(metadata=STATIC)
    anchor: tuple[Vector, Vector] | None
    parent: ClassVar[str] = GROUND

    def nameless(self) -> "FreeBranch":
        return replace(self, body="")

    def encode(self, parent: BodyPose, body: BodyPose) -> BodyState:
        orientation, motion = body
        position = motion.position
        if self.anchor is not None:
            local, origin = self.anchor
            position = (position + motion.rotation @ local) - origin
        return BodyState(position, orientation, motion.velocity, motion.spin)

    def orientation(self, parent: EulerParameters, state: BodyState) -> EulerParameters:
        return state.orientation

    def motion(self, parent: Motion, state: BodyState) -> Motion:
        return free_motion(state, self.anchor)

    def link(self, parent: Link | None, state: BodyState, one_point: bool) -> Link:
        """Return the body as the root link of its tree, about its centre of mass. The argument
        `one_point` of `JointedBranch.link` has no effect here."""
        axes = UNIT_X, UNIT_Y, UNIT_Z
        columns = *(Twist(ZERO, axis) for axis in axes), *(Twist(axis, ZERO) for axis in axes)
        gradient = _gradient(state.spin, ZERO)
        return replace(GROUND_LINK, spin=state.spin, gradient=gradient, columns=columns)

    def rates(self, state: BodyState, rates: Speeds, axes: Matrix, gravity: Vector) -> BodyState:
        shift = self._shift(axes, state.velocity, state.spin)
        orientation = euler_parameter_rates(state.orientation, state.spin)
        acceleration = axes @ Vector(*rates[:3]) + gravity
        return BodyState(shift, orientation, acceleration, Vector(*rates[3:]))

    def _shift(self, axes: Matrix, velocity: Vector, spin: Vector) -> Vector:
        """Return the rate of the position variable, m/s, for velocity in global and spin in body
        axes, or its change, m, for displacement and rotation vector. `axes`: body to global."""
        if self.anchor is None:
            return velocity
        return velocity + axes @ spin.cross(self.anchor[0])

    def after_displacement(self, state: BodyState, changes: Speeds, axes: Matrix) -> BodyState:
        """Return the state after a displacement of the centre of mass, m, and a rotation vector,
        rad: the six `changes`, in body axes. `axes`: matrix from body to global axes."""
        rotation = Vector(*changes[3:])
        shift = self._shift(axes, axes @ Vector(*changes[:3]), rotation)
        orientation = turned(state.orientation, rotation)
        return replace(state, position=state.position + shift, orientation=orientation)

    def after_speed_change(self, state: BodyState, changes: Speeds, axes: Matrix) -> BodyState:
        velocity = state.velocity + axes @ Vector(*changes[:3])
        return replace(state, velocity=velocity, spin=state.spin + Vector(*changes[3:]))

    def without_drift(self, state: BodyState) -> BodyState:
        return replace(state, orientation=kept_unit(state.orientation))

    def with_speeds(self, state: BodyState, other: BodyState) -> BodyState:
        return replace(state, velocity=other.velocity, spin=other.spin)


@tree_dataclass
class JointedBranch:
    """A body that an ideal joint carries on a parent. The variables are a `JointState`: the
    relative positions and speeds in this joint.

    In all methods, `state` is these variables, `parent` the pose, orientation, motion or link of
    the parent, and `axes` the rotation matrix from the axes of the tree's root body to global ones.
    Lists of the type `Speeds` have an entry for each speed of the joint.
    """

    body: str = field(metadata=STATIC)
    parent: str = field(metadata=STATIC)
    joint: str = field(metadata=STATIC)
    motion_subspace: AbstractMotionSubspace
    armature: Scalar | None = None

    def nameless(self) -> "JointedBranch":
        """Return the branch without names, so that alike branches are traced together."""
        return replace(self, body="", parent="", joint="")

    def encode(self, parent: BodyPose, body: BodyPose) -> JointState:
        """Return the joint's state from two poses, without motion that the joint forbids."""
        on_child, on_parent = self.motion_subspace.point_child, self.motion_subspace.point_parent
        (orientation_parent, carrier), (orientation_body, carried) = parent, body
        displacement = carried.components(carried.point(on_child) - carrier.point(on_parent))
        spin = carried.spin - carried.components(carrier.direction(carrier.spin))
        apart_rate = carried.velocity_at(on_child) - carrier.velocity_at(on_parent)
        # The rate of the displacement's components in the body's axes, which rotate with the body.
        linear = carried.components(apart_rate) - carried.spin.cross(displacement)
        orientation = composed(conjugate(orientation_parent), orientation_body)
        return self.motion_subspace.encode(Relative(orientation, displacement, Twist(spin, linear)))

    def orientation(self, parent: EulerParameters, state: JointState) -> EulerParameters:
        return normalised(composed(parent, self.motion_subspace.orientation(state.position)))

    def motion(self, parent: Motion, state: JointState) -> Motion:
        subspace, point = self.motion_subspace, self.motion_subspace.point_parent
        relative, twist = subspace.rotation(state.position), subspace.twist(state)
        rotation = parent.rotation @ relative
        spin = relative.transposed_times(parent.spin) + twist.angular
        # From the joint's point on the parent to the body's centre of mass, in body axes.
        arm = subspace.displacement(state.position) - subspace.point_child
        position = parent.point(point) + rotation @ arm
        velocity = parent.velocity_at(point) + rotation @ (spin.cross(arm) + twist.linear)
        return Motion(position, rotation, velocity, spin)

    def link(self, parent: Link | None, state: JointState, one_point: bool) -> Link:
        """Return the body as a link of its tree; `parent` is ``None`` for a joint on the ground.
        With `one_point`, the link's reference point is the parent's, so that the whole tree has
        one reference point; otherwise it is the joint's point on the parent."""
        subspace = self.motion_subspace
        # `rotation` leads from the body's axes to the tree's, and `offset`, m, from the parent's
        # reference point to the joint's point on the parent. `bias`, m/s^2, is at first the
        # acceleration of this point at constant speeds, to which the motion in the joint is added.
        # For a root on the ground, these three are the identity and zeros, since the tree's axes
        # are those of the root. A link's `gradient` times the vector between two points of the body
        # is the difference of their accelerations at constant speeds.
        rotation, offset, bias = IDENTITY, ZERO, ZERO
        if parent is None:
            parent = GROUND_LINK
        else:
            rotation = parent.rotation @ subspace.rotation(state.position)
            to_joint = parent.rotation @ subspace.point_parent
            offset, bias = parent.arm + to_joint, parent.bias + parent.gradient @ to_joint
        # Relative motion in the joint, and its acceleration at constant speeds. Both are given in
        # the axes of the carried body, so its own rotation leads to the tree's axes.
        twist, joint_bias = subspace.twist(state), subspace.bias(state)
        angular, linear = rotation @ twist.angular, rotation @ twist.linear
        spin = parent.spin + angular
        turning = parent.spin.cross(angular)
        angular_bias = parent.angular_bias + turning + rotation @ joint_bias.angular
        gradient = _gradient(spin, angular_bias)
        # From the joint's point on the parent, via the joint's point on the body, to the body's
        # centre of mass. The displacement has its components, and their rates `linear`, in the axes
        # of the carried body. So the Coriolis acceleration has the spin of this body, and
        # `gradient` acts on the whole arm.
        displacement = subspace.displacement(state.position)
        arm = rotation @ (displacement - subspace.point_child)
        coriolis = (spin * 2.0).cross(linear) + rotation @ joint_bias.linear
        bias = bias + coriolis + gradient @ arm
        columns = []
        for column in subspace.columns(state.position):
            # The column has the velocity of the body's point that coincides with the joint's point
            # on the parent.
            axis, velocity = rotation @ column.angular, rotation @ column.linear
            columns.append(Twist(axis, velocity + offset.cross(axis) if one_point else velocity))
        if one_point:
            offset, arm = ZERO, offset + arm
        return Link(
            rotation, offset, arm, spin, angular_bias, bias, gradient, tuple(columns), self.armature
        )

    def rates(self, state: JointState, rates: Speeds, axes: Matrix, gravity: Vector) -> JointState:
        return JointState(self.motion_subspace.rates(state), tuple(rates))

    def after_displacement(self, state: JointState, changes: Speeds, axes: Matrix) -> JointState:
        position = self.motion_subspace.after_displacement(state.position, tuple(changes))
        return JointState(position, state.speeds)

    def after_speed_change(self, state: JointState, changes: Speeds, axes: Matrix) -> JointState:
        speeds = tuple(add(a, b) for a, b in zip(state.speeds, changes, strict=True))
        return JointState(state.position, speeds)

    def without_drift(self, state: JointState) -> JointState:
        return JointState(self.motion_subspace.without_drift(state.position), state.speeds)

    def with_speeds(self, state: JointState, other: JointState) -> JointState:
        return JointState(state.position, other.speeds)


TreeBranch: TypeAlias = FreeBranch | JointedBranch


class Place(NamedTuple):
    """Names of a body, of its parent, and of the joint between them, ``None`` for a free root."""

    body: str
    parent: str
    joint: str | None


class Topology:
    """The `trees` of a scene, each a list of `Place`s with the root first and a parent before its
    children, and the `places` of all trees by name of body."""

    def __init__(self, trees: list[list[Place]]):
        self.trees = trees
        self.places = {place.body: place for tree in trees for place in tree}
        self._numbers = {body: number for number, body in enumerate((GROUND, *self.places))}

    def between(self, bodies: Collection[str]) -> frozenset[str]:
        """Return those bodies whose joints change the poses of `bodies` relative to each other."""
        # The ends of the paths move towards the roots until they meet in one body. Each parent has
        # a smaller number than its children, so that the end with the largest number is not on the
        # path from another end to the root.
        ends, passed = set(bodies), set()
        while len(ends) > 1:
            body = max(ends, key=self._numbers.__getitem__)
            ends.remove(body)
            passed.add(body)
            ends.add(self.places[body].parent)
        return frozenset(passed)


_known: dict[int, tuple[weakref.ref[Scene], Topology]] = {}
"""Weak reference to each scene object that exists, and its topology, by the `id` of the scene."""


def topology(scene: Scene) -> Topology:
    """Return the topology of a scene, which is found once for each scene object."""
    key = id(scene)
    if key not in _known or _known[key][0]() is not scene:
        trees = Topology(_grown_trees(scene))
        # The entry is removed with the scene, since another object may get the same `id`.
        _known[key] = weakref.ref(scene, lambda _: _known.pop(key, None)), trees
    return _known[key][1]


def forest(scene: Scene) -> list[list[TreeBranch]]:
    """Return the trees of a scene, each as a list of branches with the root first, and each parent
    before its children. Which bodies form a tree depends on types and names, but on no numbers.

    Ideal joints that would close a loop, and constraints without a `motion_subspace`, such as
    drivers, belong to no tree. Bodies are visited breadth first, so that chains are short. Of
    connected bodies without a joint to the ground, one becomes a free root, preferably one with an
    `Anchor`, relative to which the body's position keeps more digits.
    """
    points = anchors(scene)
    return [[_branch(scene, points, *place) for place in tree] for tree in topology(scene).trees]


def _branch(
    scene: Scene, points: dict[str, tuple[Vector, Vector]], body: str, parent: str, name: str | None
) -> TreeBranch:
    if name is None:
        return FreeBranch(body, points.get(body))
    joint = scene.joints[name]
    subspace = joint.motion_subspace(parent) if isinstance(joint, AbstractConstraint) else None
    if subspace is None:
        raise ValueError(
            f"joints[{name!r}].motion_subspace({parent!r}) is None, but was not for the same scene "
            "before; let it depend on nothing but the types and names in the scene"
        )
    armature = joint.armature if isinstance(joint, AbstractDriveableJoint) else None
    return JointedBranch(body, parent, name, subspace, armature)


def _grown_trees(scene: Scene) -> list[list[Place]]:
    # For each body, the ideal joints that may carry another body on it. A body looks only at its
    # own joints, so that the work does not grow with the square of their number.
    joints: _Incident = {body: [] for body in (GROUND, *scene.bodies)}
    for name, joint in scene.joints.items():
        if isinstance(joint, AbstractConstraint) and len(pair := joint.body_names()) == 2:
            for parent, body in (pair, pair[::-1]):
                joints[parent].append((name, joint, body))
    # Each joint on the ground begins a tree of its own, since the ground does not move.
    placed = {GROUND}
    trees = [[root] for root in _children(joints, GROUND, placed)]
    for tree in trees:
        _grow(tree, joints, placed)
    # The bodies that are left have no joint to the ground. Roots are preferably those with an
    # anchor, a point on the ground from which their position is measured without loss of digits.
    points = anchors(scene)
    for name in sorted(scene.bodies, key=lambda name: name not in points):
        if name not in placed:
            placed.add(name)
            trees.append([Place(name, GROUND, None)])
            _grow(trees[-1], joints, placed)
    return trees


_Incident: TypeAlias = dict[str, list[tuple[str, AbstractConstraint, str]]]
"""By name of body, its ideal joints to other bodies: name, joint, and the other body's name."""


def _grow(tree: list[Place], joints: _Incident, placed: set[str]) -> None:
    for place in tree:  # The loop also visits the places that it appends.
        tree += _children(joints, place.body, placed)


def _children(joints: _Incident, parent: str, placed: set[str]) -> list[Place]:
    """Return a place for each body that an ideal joint can carry on `parent` and that is not in
    `placed`, the bodies that have a place already. Add the bodies found to `placed`."""
    children = []
    for name, joint, body in joints[parent]:
        # The subspace is made last: for a placed body, JAX would trace its operations in vain.
        if body not in placed and joint.motion_subspace(parent) is not None:
            placed.add(body)
            children.append(Place(body, parent, name))
    return children
