"""Motion subspaces: the relative motions that ideal joints allow, for joint coordinates.

In joint coordinates the bodies form a tree, in which each joint connects a *child* body with its
*parent*. The joint's point on the child may slide away from the point on the parent, and the child
may rotate about its own point. Displacements, velocities and spins have components in the child's
axes, because the usual joints have constant directions of motion there. Orientations are Euler
parameters that transform components in the child's axes to the parent's.
"""

import abc
from dataclasses import dataclass

import equinox as eqx
import jax
from jaxtyping import PyTree
from typing_extensions import override

from ..._math.rotations import (
    composed,
    conjugate,
    euler_parameter_rates,
    kept_unit,
    rotation_matrix,
    transverse_axes,
    turned,
    within_two_turns,
)
from ..._math.smoothing import TURN, cosine, norm_and_direction, polar_angle, sine, where, wrapped
from ..._math.vectors import (
    UNIT_X,
    UNIT_Y,
    UNIT_Z,
    ZERO,
    EulerParameters,
    Matrix,
    Scalar,
    Vector,
    add,
    is_zero,
)
from ..tree_dataclass import tree_dataclass


@tree_dataclass
class Twist:
    """Velocity of a child body relative to its parent, in the child's axes.

    - `angular`: relative spin, rad/s.
    - `linear`: rate, m/s, of the components of the displacement d, the vector from the joint's
      point on the parent to its point on the child. The child's axes rotate: the velocity of the
      child's point relative to the parent is `linear` + `angular` x d.

    >>> twist = extend.Twist(angular=extend.UNIT_Z, linear=extend.ZERO) * 2.0
    >>> twist.angular.z
    2.0
    """

    angular: Vector
    linear: Vector

    def __add__(self, other: "Twist") -> "Twist":
        return Twist(self.angular + other.angular, self.linear + other.linear)

    def __sub__(self, other: "Twist") -> "Twist":
        return Twist(self.angular - other.angular, self.linear - other.linear)

    def __mul__(self, factor: Scalar) -> "Twist":
        return Twist(self.angular * factor, self.linear * factor)


REST = Twist(ZERO, ZERO)


@dataclass(frozen=True, slots=True)
class Relative:
    """Position and motion of a child body relative to its parent.

    `orientation` transforms components in the child's axes to the parent's. `displacement`, m, from
    the joint's point on the parent to that on the child, and `twist` are in the child's axes.

    >>> still = extend.Twist(extend.ZERO, extend.ZERO)
    >>> relative = extend.Relative(extend.EulerParameters(1.0, 0.0, 0.0, 0.0), extend.UNIT_X, still)
    >>> relative.displacement
    Vector(x=1.0, y=0.0, z=0.0)
    """

    orientation: EulerParameters
    displacement: Vector
    twist: Twist


class JointState(eqx.Module):
    """Joint coordinates of one joint.

    - `position`: an angle in rad, a distance in m, Euler parameters, or any other PyTree.
    - `speeds`: one per degree of freedom, rad/s or m/s.

    >>> extend.JointState(position=0.5, speeds=(2.0,)).speeds  # a hinge: rad, rad/s
    (2.0,)
    """

    position: PyTree
    speeds: tuple[Scalar, ...]
    __getattribute__ = object.__getattribute__  # as in `AbstractReadable`, faster than Equinox's


class AbstractMotionSubspace(eqx.Module):
    """The relative motion that a joint allows, described by joint coordinates.

    The coordinates are a `position`, a PyTree whose structure depends on the joint, and one speed
    for each degree of freedom. `columns` maps the speeds to the relative motion. `point_parent` and
    `point_child` are the joint's points, m from each body's centre of mass in its axes.

    >>> axes = (0, 0, 1), (0, 0, 1)
    >>> hinge = cj.RevoluteJoint("ground", "arm", (0, 0, 0), (-0.5, 0, 0), *axes)
    >>> subspace = extend.unpack(hinge).motion_subspace("ground")
    >>> (column,) = subspace.columns(0.0)  # one speed
    >>> print(f"{abs(column.angular.z):.1f}")
    1.0
    """

    point_parent: eqx.AbstractVar[Vector]
    point_child: eqx.AbstractVar[Vector]
    __getattribute__ = object.__getattribute__  # as in `AbstractReadable`, faster than Equinox's

    @abc.abstractmethod
    def encode(self, relative: Relative) -> JointState:
        """Return position and speeds of the joint for a relative motion that the joint allows."""

    @abc.abstractmethod
    def orientation(self, position: PyTree) -> EulerParameters:
        """Return Euler parameters, of any norm, from the child's axes to the parent's."""

    @abc.abstractmethod
    def columns(self, position: PyTree) -> tuple[Twist, ...]:
        """Return the relative twist for each speed equal to 1 rad/s or 1 m/s, the others zero."""

    def rates(self, state: JointState) -> PyTree:
        """Return the time derivative of the position; by default the speeds."""
        return jax.tree.unflatten(jax.tree.structure(state.position), state.speeds)

    def after_displacement(self, position: PyTree, changes: tuple[Scalar, ...]) -> PyTree:
        """Return the position after a small motion, the columns times `changes`, rad or m. By
        default the changes are added to the numbers of the position, in order."""
        numbers, structure = jax.tree.flatten(position)
        return jax.tree.unflatten(structure, map(add, numbers, changes))

    def without_drift(self, position: PyTree) -> PyTree:
        """Return the same position with angles between -2 pi and 2 pi and Euler parameters of about
        unit norm, so that rounding errors do not grow over a long run. It is called at the end of
        each step. By default the position is unchanged, which suits distances and screws."""
        return position

    def rotation(self, position: PyTree) -> Matrix:
        """Return the matrix that transforms components in the child's axes to the parent's."""
        return rotation_matrix(self.orientation(position))

    def displacement(self, position: PyTree) -> Vector:
        """Return the vector from the parent's point to the child's, m in the child's axes."""
        return ZERO

    def bias(self, state: JointState) -> Twist:
        """Return the rate of the relative twist at constant speeds, zero for constant columns."""
        return REST

    def twist(self, state: JointState) -> Twist:
        """Return the child's relative twist, rad/s and m/s: the columns times the speeds."""
        parts = zip(self.columns(state.position), state.speeds, strict=True)
        return sum((column * speed for column, speed in parts), REST)

    def rotation_rate(self, state: JointState) -> Scalar | None:
        """Return how fast the child rotates relative to its parent, rad/s; ``None`` if this need
        not limit the step (see `AbstractCoordinates.rotation_rates`)."""
        spin = self.twist(state).angular
        return None if all(map(is_zero, spin)) else norm_and_direction(spin)[0]


class AbstractMotionAtPoints(AbstractMotionSubspace):
    """Base class of motion subspaces with the joint's points on parent and child as fields."""

    point_parent: Vector
    point_child: Vector


class Weld(AbstractMotionAtPoints):
    """The subspace of a fixed joint, without relative motion; `reference` is the orientation."""

    reference: EulerParameters

    @override
    def encode(self, relative: Relative) -> JointState:
        return JointState((), ())

    @override
    def orientation(self, position: PyTree) -> EulerParameters:
        return self.reference

    @override
    def columns(self, position: PyTree) -> tuple[Twist, ...]:
        return ()


def rotation_about(axis: Vector, angle: Scalar) -> EulerParameters:
    """Return Euler parameters of a rotation by an angle, rad, about a unit vector."""
    vector = axis * sine(0.5 * angle)
    return EulerParameters(cosine(0.5 * angle), *vector)


class AbstractTurning(AbstractMotionAtPoints):
    """Base class of motion subspaces in which the child rotates about one axis; some also have
    translations. `axis` is a unit vector in the child's axes, and `reference` the orientation at
    angle zero, which `aligning` computes from the axis in both bodies."""

    axis: Vector
    reference: EulerParameters

    def angle(self, relative: Relative) -> Scalar:
        """Return the angle of rotation, rad in [-2 pi, 2 pi]: Euler parameters change their sign
        after one revolution, and repeat after two."""
        rotation = composed(conjugate(self.reference), relative.orientation)
        vector = Vector(rotation.e1, rotation.e2, rotation.e3)
        return 2.0 * polar_angle(vector.dot(self.axis), rotation.e0)

    @override
    def orientation(self, position: Scalar) -> EulerParameters:
        return composed(self.reference, rotation_about(self.axis, position))

    @override
    def rotation(self, position: Scalar) -> Matrix:
        # R (b b^T + cos(angle) (I - b b^T) + sin(angle) ~b), with R of `reference` and the axis b.
        # This form has few products if the axis is along x, y or z.
        b, c, s = self.axis, cosine(position), sine(position)

        def rotated(row: Vector) -> Vector:
            along = b * row.dot(b)
            return along + (row - along) * c + row.cross(b) * s

        return Matrix(*map(rotated, rotation_matrix(self.reference).rows))


class Hinge(AbstractTurning):
    """Rotation by an angle (rad) about an axis; its position is the angle."""

    @override
    def encode(self, relative: Relative) -> JointState:
        return JointState(self.angle(relative), (relative.twist.angular.dot(self.axis),))

    @override
    def columns(self, position: Scalar) -> tuple[Twist, ...]:
        return (Twist(self.axis, ZERO),)

    @override
    def without_drift(self, position: Scalar) -> Scalar:
        return within_two_turns(position)


class Ball(AbstractMotionAtPoints):
    """Free rotation of the child about the joint's point. The position is the orientation's Euler
    parameters; the three speeds are the relative spin in the child's axes, rad/s."""

    @override
    def encode(self, relative: Relative) -> JointState:
        spin = relative.twist.angular
        return JointState(relative.orientation, (spin.x, spin.y, spin.z))

    @override
    def orientation(self, position: EulerParameters) -> EulerParameters:
        return position

    @override
    def columns(self, position: EulerParameters) -> tuple[Twist, ...]:
        return tuple(Twist(axis, ZERO) for axis in (UNIT_X, UNIT_Y, UNIT_Z))

    @override
    def rates(self, state: JointState) -> EulerParameters:
        return euler_parameter_rates(state.position, Vector(*state.speeds))

    @override
    def after_displacement(
        self, position: EulerParameters, changes: tuple[Scalar, ...]
    ) -> EulerParameters:
        return turned(position, Vector(*changes))

    @override
    def without_drift(self, position: EulerParameters) -> EulerParameters:
        return kept_unit(position)

    @override
    def rotation_rate(self, state: JointState) -> None: ...


class Slider(AbstractMotionAtPoints):
    """Translation by a distance, m, along `axis`, with the constant orientation `reference`. `axis`
    is a unit vector in the child's axes; the distance is the position."""

    axis: Vector
    reference: EulerParameters

    @override
    def encode(self, relative: Relative) -> JointState:
        distance = relative.displacement.dot(self.axis)
        return JointState(distance, (relative.twist.linear.dot(self.axis),))

    @override
    def orientation(self, position: Scalar) -> EulerParameters:
        return self.reference

    @override
    def displacement(self, position: Scalar) -> Vector:
        return self.axis * position

    @override
    def columns(self, position: Scalar) -> tuple[Twist, ...]:
        return (Twist(ZERO, self.axis),)


def aligning(first: Vector, second: Vector) -> EulerParameters:
    """Return Euler parameters, of any norm, of a rotation from the second unit vector to the z axis
    and on to the first (see `_from_zeta`). Unlike the shortest rotation, it is defined for opposite
    vectors too. For equal vectors the result is exactly proportional to (1, 0, 0, 0)."""
    return composed(_from_zeta(first), conjugate(_from_zeta(second)))


def _from_zeta(axis: Vector) -> EulerParameters:
    """Return Euler parameters, of any norm, of a rotation from the z axis to a unit vector. The
    formula of the shortest one is singular for -z. If the z component is negative, the rotation is
    therefore half a revolution about x, from z to -z, and then the shortest one from there."""
    forwards = EulerParameters(1.0 + axis.z, -axis.y, axis.x, 0.0)
    shortest = EulerParameters(1.0 - axis.z, axis.y, -axis.x, 0.0)
    backwards = composed(shortest, EulerParameters(0.0, 1.0, 0.0, 0.0))
    return jax.tree.map(lambda a, b: where(axis.z >= 0.0, a, b), forwards, backwards)


class ScrewMotion(AbstractTurning):
    """Rotation about an axis by an unlimited angle, rad, with an advance of `pitch`, m/rad."""

    pitch: Scalar

    @override
    def encode(self, relative: Relative) -> JointState:
        angle, rate = self.angle(relative), relative.twist.angular.dot(self.axis)
        # The advance determines the number of revolutions, and the orientation the angle up to
        # whole revolutions, exactly.
        angle_by_advance = relative.displacement.dot(self.axis) / self.pitch
        error = wrapped(angle_by_advance - angle, TURN)
        return JointState(angle_by_advance - error, (rate,))

    @override
    def displacement(self, position: Scalar) -> Vector:
        return self.axis * (self.pitch * position)

    @override
    def columns(self, position: Scalar) -> tuple[Twist, ...]:
        return (Twist(self.axis, self.axis * self.pitch),)


Position = tuple[Scalar, Scalar, Scalar]
"""Coordinates of a planar joint: distances, m, along the `transverse_axes` of the parent's normal,
and the angle about it, rad."""


class PlanarMotion(AbstractTurning):
    """Translation by two distances, m, in a plane of the parent, and rotation by an angle, rad.
    `axis` and `normal_parent` are the plane's normal in the child's and in the parent's axes. The
    distances are along the `transverse_axes` of `normal_parent`: along axes of the child they would
    oscillate as the child rotates."""

    normal_parent: Vector

    @override
    def encode(self, relative: Relative) -> JointState:
        # The vectors of `relative` have components in the child's axes, but the distances are along
        # axes of the parent. Along these, the displacement also changes because the child rotates.
        angle = self.angle(relative)
        rotation = super().rotation(angle)
        apart, spin = relative.displacement, relative.twist.angular
        offset = rotation @ apart
        velocity = rotation @ (relative.twist.linear + spin.cross(apart))
        x_axis, y_axis = transverse_axes(self.normal_parent)
        return JointState(
            (offset.dot(x_axis), offset.dot(y_axis), angle),
            (velocity.dot(x_axis), velocity.dot(y_axis), spin.dot(self.axis)),
        )

    @override
    def orientation(self, position: Position) -> EulerParameters:
        return super().orientation(position[2])

    @override
    def rotation(self, position: Position) -> Matrix:
        return super().rotation(position[2])

    @override
    def displacement(self, position: Position) -> Vector:
        return self._in_child(position[:2], position)

    @override
    def columns(self, position: Position) -> tuple[Twist, ...]:
        directions = (self._in_child(axis, position) for axis in ((1.0, 0.0), (0.0, 1.0)))
        apart = self.displacement(position)
        # While the child rotates at spin = axis, a displacement that is constant in the parent has
        # the rate -(spin x displacement) in the child's axes.
        rotation = Twist(self.axis, apart.cross(self.axis))
        return (*(Twist(ZERO, direction) for direction in directions), rotation)

    @override
    def bias(self, state: JointState) -> Twist:
        x_speed, y_speed, angular_speed = state.speeds
        spin = self.axis * angular_speed
        velocity = self._in_child((x_speed, y_speed), state.position)
        apart = self.displacement(state.position)
        # The twist's linear part is velocity - spin x apart. In the child's axes, the rate of
        # velocity is -(spin x velocity), and the rate of apart is the linear part itself.
        return Twist(ZERO, spin.cross(spin.cross(apart) - velocity * 2.0))

    @override
    def without_drift(self, position: Position) -> Position:
        return position[0], position[1], within_two_turns(position[2])

    def _in_child(self, across: tuple[Scalar, Scalar], position: Position) -> Vector:
        """Return a vector in the child's axes from its components `across` along the
        `transverse_axes` of `normal_parent`."""
        x_axis, y_axis = transverse_axes(self.normal_parent)
        vector = x_axis * across[0] + y_axis * across[1]
        return self.rotation(position).transposed_times(vector)


Angles = tuple[Scalar, Scalar]
"""Angle of the cross about the arm fixed to the parent, and of the child about the other, rad."""


class UniversalMotion(AbstractMotionAtPoints):
    """Rotation by two angles, rad, about the arms of a universal joint's cross. The cross rotates
    in the parent about `arm_parent`, and the child rotates about `arm_child`, which is
    perpendicular to `arm_parent`; each arm is a unit vector fixed to its body, in its axes."""

    arm_parent: Vector
    arm_child: Vector

    def _reference(self) -> EulerParameters:
        """Return the Euler parameters from the child's axes to the parent's at zero angles."""
        return aligning(transverse_axes(self.arm_parent)[0], self.arm_child)

    def _about_child(self, reference: EulerParameters) -> Hinge:
        return Hinge(self.point_parent, self.point_child, self.arm_child, reference)

    def _parents_arm(self, angle: Scalar) -> tuple[Vector, Vector]:
        """Return `arm_parent` in the child's axes at the second angle, `angle`, rad, and the
        derivative of this vector by this angle."""
        # In the child's axes, the parent's arm rotates backwards about the child's arm.
        start = rotation_matrix(self._reference()).transposed_times(self.arm_parent)
        quarter = self.arm_child.cross(start)
        c, s = cosine(angle), sine(angle)
        return start * c - quarter * s, -(start * s + quarter * c)

    @override
    def encode(self, relative: Relative) -> JointState:
        start, quarter = transverse_axes(self.arm_parent)
        arm = rotation_matrix(relative.orientation) @ self.arm_child
        # The child's arm rotates with the cross about the parent's arm, which gives the first
        # angle. What remains of the orientation is the rotation about the child's arm.
        first_angle = polar_angle(arm.dot(quarter), arm.dot(start))
        reference = composed(rotation_about(self.arm_parent, first_angle), self._reference())
        about_child = self._about_child(reference).encode(relative)
        # The relative spin is the sum of the arms, each times the rate of the angle about it. The
        # arms are perpendicular, so that the scalar product of spin and arm is this rate.
        parents_arm, _ = self._parents_arm(about_child.position)
        first_rate = relative.twist.angular.dot(parents_arm)
        position = first_angle, about_child.position
        return JointState(position, (first_rate, *about_child.speeds))

    @override
    def orientation(self, position: Angles) -> EulerParameters:
        about_parent = rotation_about(self.arm_parent, position[0])
        reference = composed(about_parent, self._reference())
        return self._about_child(reference).orientation(position[1])

    @override
    def columns(self, position: Angles) -> tuple[Twist, ...]:
        return Twist(self._parents_arm(position[1])[0], ZERO), Twist(self.arm_child, ZERO)

    @override
    def bias(self, state: JointState) -> Twist:
        _, change = self._parents_arm(state.position[1])
        return Twist(change * (state.speeds[0] * state.speeds[1]), ZERO)

    @override
    def without_drift(self, position: Angles) -> Angles:
        return within_two_turns(position[0]), within_two_turns(position[1])
