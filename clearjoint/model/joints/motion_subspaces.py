"""The motions that ideal joints leave free, for coordinates that follow them.

A freedom describes how a *child* body moves against its *parent*: the joint's point on the child
may slide away from that on the parent, and the child may turn about it. Displacements, velocities
and spins have components in the child's axes, in which the directions of motion of the usual joints
are constant.
"""

import abc
from dataclasses import dataclass

import equinox as eqx
from jaxtyping import PyTree

from ...math.functions import cosine as cosine_of
from ...math.functions import polar_angle, where
from ...math.functions import sine as sine_of
from ...math.rotations import (
    composed,
    conjugate,
    euler_parameter_rates,
    kept_unit,
    rotation_matrix,
    turned,
    within_two_turns,
)
from ...math.vectors import (
    UNIT_X,
    UNIT_Y,
    UNIT_Z,
    ZERO,
    EulerParameters,
    Matrix,
    Scalar,
    Vector,
    add,
)


@dataclass(frozen=True, slots=True)
class Twist:
    """A spin of the child and a velocity of its joint's point, against the parent.

    >>> twist = extend.Twist(angular=extend.UNIT_Z, linear=extend.ZERO) * 2.0
    >>> twist.angular.z
    2.0
    """

    angular: Vector
    linear: Vector

    def __add__(self, other: "Twist") -> "Twist":
        return Twist(self.angular + other.angular, self.linear + other.linear)

    def __mul__(self, factor: Scalar) -> "Twist":
        return Twist(self.angular * factor, self.linear * factor)


REST = Twist(ZERO, ZERO)


@dataclass(frozen=True, slots=True)
class Relative:
    """Pose and twist of a child against its parent.

    `orientation` turns the child's components into the parent's; `displacement` leads from the
    parent's point to the child's, in the child's axes, in which its rate is ``twist.linear``.

    >>> still = extend.Twist(extend.ZERO, extend.ZERO)
    >>> relative = extend.Relative(extend.EulerParameters(1.0, 0.0, 0.0, 0.0), extend.UNIT_X, still)
    >>> relative.displacement
    Vector(x=1.0, y=0.0, z=0.0)
    """

    orientation: EulerParameters
    displacement: Vector
    twist: Twist


class JointState(eqx.Module):
    """Variables of one joint.

    - `position`: an angle in rad, a distance in m, Euler parameters, or any other PyTree.
    - `speeds`: one for each degree of freedom, rad/s or m/s.

    >>> extend.JointState(position=0.5, speeds=(2.0,)).speeds  # a hinge: rad, rad/s
    (2.0,)
    """

    position: PyTree
    speeds: tuple[Scalar, ...]


class AbstractMotionSubspace(eqx.Module):
    """The relative motion that a joint allows.

    `point_parent` and `point_child` are the joint's points, m in each body's axes.

    >>> axes = (0, 0, 1), (0, 0, 1)
    >>> hinge = cj.RevoluteJoint("ground", "arm", (0, 0, 0), (-0.5, 0, 0), *axes)
    >>> freedom = extend.unpack(hinge).motion_subspace("ground")
    >>> (column,) = freedom.columns(0.0)  # one speed
    >>> print(f"{abs(column.angular.z):.1f}")
    1.0
    """

    point_parent: eqx.AbstractVar[Vector]
    point_child: eqx.AbstractVar[Vector]

    @abc.abstractmethod
    def encode(self, relative: Relative) -> JointState:
        """The variables of a relative motion that the joint allows."""

    @abc.abstractmethod
    def orientation(self, position: PyTree) -> EulerParameters:
        """Euler parameters, of any norm, that turn the child's components into the parent's."""

    @abc.abstractmethod
    def columns(self, position: PyTree) -> tuple[Twist, ...]:
        """For each speed, the relative twist that a value of one gives."""

    @abc.abstractmethod
    def rates(self, state: JointState) -> PyTree:
        """Time derivative of the position."""

    @abc.abstractmethod
    def after_displacement(self, position: PyTree, changes: tuple[Scalar, ...]) -> PyTree:
        """The position after a small motion along the columns."""

    def without_drift(self, position: PyTree) -> PyTree:
        """The same position, without what numbers gather in many steps: whole turns of an angle, a
        norm that drifts. Called at the end of each step; by default the position as it is."""
        return position

    def rotation(self, position: PyTree) -> Matrix:
        """The matrix that turns the child's components into the parent's."""
        return rotation_matrix(self.orientation(position))

    def displacement(self, position: PyTree) -> Vector:
        """From the parent's point to the child's, child's axes; none unless the joint slides."""
        del position
        return ZERO

    def bias(self, state: JointState) -> Twist:
        """Rate of the relative twist at constant speeds, in the child's axes; zero for constant
        columns."""
        del state
        return REST

    def twist(self, state: JointState) -> Twist:
        """Twist of the child against the parent: the columns times the speeds."""
        parts = zip(self.columns(state.position), state.speeds, strict=True)
        return sum((column * speed for column, speed in parts), REST)


class Weld(AbstractMotionSubspace):
    """No motion at all. `reference` turns the child's components into the parent's."""

    point_parent: Vector
    point_child: Vector
    reference: EulerParameters

    def encode(self, relative: Relative) -> JointState:
        """A state without position and speeds."""
        del relative
        return JointState((), ())

    def orientation(self, position: PyTree) -> EulerParameters:
        """The `reference`, whatever the position."""
        del position
        return self.reference

    def columns(self, position: PyTree) -> tuple[Twist, ...]:
        """No columns, since there are no speeds."""
        del position
        return ()

    def rates(self, state: JointState) -> PyTree:
        """The rate of a position without numbers."""
        return state.position

    def after_displacement(self, position: PyTree, changes: tuple[Scalar, ...]) -> PyTree:
        """The position without numbers."""
        del changes
        return position


class Hinge(AbstractMotionSubspace):
    """Turning by an angle (rad) about `axis`, a unit vector in the child's axes.

    `reference` turns the child's components into the parent's at angle zero; see `aligning`.
    """

    point_parent: Vector
    point_child: Vector
    axis: Vector
    reference: EulerParameters

    def encode(self, relative: Relative) -> JointState:
        """The angle, within (-2 pi, 2 pi], and its rate.

        Over two turns, not one: so the Euler parameters come back with their sign.
        """
        turn = composed(conjugate(self.reference), relative.orientation)
        vector = Vector(turn.e1, turn.e2, turn.e3)
        angle = 2.0 * polar_angle(vector.dot(self.axis), turn.e0)
        return JointState(angle, (relative.twist.angular.dot(self.axis),))

    def orientation(self, position: Scalar) -> EulerParameters:
        """The reference, turned by the angle about the axis."""
        vector = self.axis * sine_of(0.5 * position)
        turn = EulerParameters(cosine_of(0.5 * position), vector.x, vector.y, vector.z)
        return composed(self.reference, turn)

    def rotation(self, position: Scalar) -> Matrix:
        """R (b b^T + cos (1 - b b^T) + sin ~b) with constant R, so that two products an entry are
        left, and none where they are zeros and ones."""
        b, cosine, sine = self.axis, cosine_of(position), sine_of(position)

        def row(reference: Vector) -> Vector:
            along = b * reference.dot(b)
            return along + (reference - along) * cosine + reference.cross(b) * sine

        matrix = rotation_matrix(self.reference)
        return Matrix(row(matrix.row_x), row(matrix.row_y), row(matrix.row_z))

    def columns(self, position: Scalar) -> tuple[Twist, ...]:
        """A turn about the axis at 1 rad/s."""
        del position
        return (Twist(self.axis, ZERO),)

    def rates(self, state: JointState) -> Scalar:
        """Rate of the angle, rad/s."""
        return state.speeds[0]

    def after_displacement(self, position: Scalar, changes: tuple[Scalar, ...]) -> Scalar:
        """The angle plus the change, rad."""
        return add(position, changes[0])

    def without_drift(self, position: Scalar) -> Scalar:
        """The angle within two turns, as `encode` gives it."""
        return within_two_turns(position)


class Ball(AbstractMotionSubspace):
    """Turning freely: relative Euler parameters, and relative spin in the child's axes."""

    point_parent: Vector
    point_child: Vector

    def encode(self, relative: Relative) -> JointState:
        """Relative orientation and spin."""
        spin = relative.twist.angular
        return JointState(relative.orientation, (spin.x, spin.y, spin.z))

    def orientation(self, position: EulerParameters) -> EulerParameters:
        """The Euler parameters themselves."""
        return position

    def columns(self, position: EulerParameters) -> tuple[Twist, ...]:
        """Turns about the child's axes at 1 rad/s."""
        del position
        return tuple(Twist(axis, ZERO) for axis in (UNIT_X, UNIT_Y, UNIT_Z))

    def rates(self, state: JointState) -> EulerParameters:
        """Rates of the Euler parameters, 1/s."""
        return euler_parameter_rates(state.position, Vector(*state.speeds))

    def after_displacement(
        self, position: EulerParameters, changes: tuple[Scalar, ...]
    ) -> EulerParameters:
        """The Euler parameters after a small turn (rad, child's axes)."""
        return turned(position, Vector(*changes))

    def without_drift(self, position: EulerParameters) -> EulerParameters:
        """The Euler parameters, brought back to unit norm."""
        return kept_unit(position)


class Slider(AbstractMotionSubspace):
    """Sliding by a distance (m) along `axis`, a unit vector in the child's axes.

    `reference` turns the child's components into the parent's.
    """

    point_parent: Vector
    point_child: Vector
    axis: Vector
    reference: EulerParameters

    def encode(self, relative: Relative) -> JointState:
        """Distance along the axis in m, and its rate in m/s."""
        distance = relative.displacement.dot(self.axis)
        return JointState(distance, (relative.twist.linear.dot(self.axis),))

    def orientation(self, position: Scalar) -> EulerParameters:
        """The `reference`, whatever the position."""
        del position
        return self.reference

    def displacement(self, position: Scalar) -> Vector:
        """The distance along the axis, as a vector in m."""
        return self.axis * position

    def columns(self, position: Scalar) -> tuple[Twist, ...]:
        """A motion along the axis at 1 m/s."""
        del position
        return (Twist(ZERO, self.axis),)

    def rates(self, state: JointState) -> Scalar:
        """Rate of the distance, m/s."""
        return state.speeds[0]

    def after_displacement(self, position: Scalar, changes: tuple[Scalar, ...]) -> Scalar:
        """The distance plus the change, m."""
        return add(position, changes[0])


def aligning(first: Vector, second: Vector) -> EulerParameters:
    """Euler parameters, not normalised, of a turn that takes the second direction to the first.

    Equal directions give the identity to the last bit.
    """
    return composed(_from_zeta(first), conjugate(_from_zeta(second)))


def _from_zeta(axis: Vector) -> EulerParameters:
    """The shortest turn of the zeta axis to a unit vector, after a half turn about xi where the
    vector points backwards."""
    if isinstance(axis.z, int | float):
        return _forwards(axis) if axis.z >= 0.0 else _backwards(axis)
    both = zip(_parts(_forwards(axis)), _parts(_backwards(axis)), strict=True)
    return EulerParameters(*(where(axis.z >= 0.0, a, b) for a, b in both))


def _forwards(axis: Vector) -> EulerParameters:
    return EulerParameters(1.0 + axis.z, -axis.y, axis.x, 0.0)


def _backwards(axis: Vector) -> EulerParameters:
    shortest = EulerParameters(1.0 - axis.z, axis.y, -axis.x, 0.0)
    return composed(shortest, EulerParameters(0.0, 1.0, 0.0, 0.0))


def _parts(p: EulerParameters) -> tuple[Scalar, ...]:
    return p.e0, p.e1, p.e2, p.e3
