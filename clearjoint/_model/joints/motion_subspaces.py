"""Motion subspaces: the relative motions that ideal joints allow, for joint coordinates.

In joint coordinates the bodies form a tree, in which each joint connects a *child* body with its
*parent*. A motion subspace describes the motion of the child relative to the parent: the joint's
point on the child may slide away from the point on the parent, and the child may rotate about its
own point. Displacements, velocities and spins have components in the child's axes, because the
usual joints have constant directions of motion in these axes.
"""

import abc
from dataclasses import dataclass

import equinox as eqx
import jax
from jaxtyping import PyTree

from ..._math.rotations import (
    composed,
    conjugate,
    euler_parameter_rates,
    kept_unit,
    rotation_matrix,
    turned,
    within_two_turns,
)
from ..._math.smoothing import cosine as cosine_of
from ..._math.smoothing import norm, polar_angle, where
from ..._math.smoothing import sine as sine_of
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


@jax.tree_util.register_dataclass
@dataclass(frozen=True, slots=True)
class Twist:
    """Velocity of a child body relative to its parent, in the child's axes.

    - `angular`: relative spin, rad/s.
    - `linear`: rate, m/s, of the components of the displacement d, the vector from the joint's
      point on the parent to its point on the child. These components are in the child's axes, which
      rotate: the velocity of the child's point relative to the parent is `linear` + `angular` x d.

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

    - `orientation`: Euler parameters that transform components in the child's axes to the
      parent's.
    - `displacement`: vector from the joint's point on the parent to its point on the child, m in
      the child's axes.
    - `twist`: relative spin, rad/s, and rate of the displacement's components, m/s, in the child's
      axes.

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

    The coordinates consist of a `position`, a PyTree whose structure depends on the joint, and of
    one speed for each degree of freedom. `columns` maps the speeds to the relative motion.
    `point_parent` and `point_child` are the joint's points, m from each body's centre of mass in
    its axes.

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
        """Return Euler parameters that transform components in the child's axes to the parent's.

        Their norm need not be 1.
        """

    @abc.abstractmethod
    def columns(self, position: PyTree) -> tuple[Twist, ...]:
        """Return one relative twist for each speed, in the child's axes: the twist if this speed is
        1 rad/s or 1 m/s and all other speeds are zero."""

    def rates(self, state: JointState) -> PyTree:
        """Return the time derivative of the position, with the same structure as the position.

        The default returns the speeds as the rates. It suits a position that consists of one number
        for each speed.
        """
        return jax.tree.unflatten(jax.tree.structure(state.position), state.speeds)

    def after_displacement(self, position: PyTree, changes: tuple[Scalar, ...]) -> PyTree:
        """Return the position after a small motion along the columns.

        It is called to correct positions so that they satisfy the constraints. `changes` are in rad
        or m, one for each speed. The default adds them to the numbers of the position, in order.
        """
        numbers, structure = jax.tree.flatten(position)
        return jax.tree.unflatten(structure, map(add, numbers, changes))

    def without_drift(self, position: PyTree) -> PyTree:
        """Return an equivalent position in which angles are reduced by whole revolutions and Euler
        parameters are scaled to the norm 1.

        It is called at the end of each step, so that neither angles nor rounding errors grow over a
        long run. The default returns the position unchanged, which suits distances.
        """
        return position

    def rotation(self, position: PyTree) -> Matrix:
        """Return the matrix that transforms components in the child's axes to the parent's."""
        return rotation_matrix(self.orientation(position))

    def displacement(self, position: PyTree) -> Vector:
        """Return the vector from the parent's point to the child's in the child's axes, m; zero by
        default."""
        return ZERO

    def bias(self, state: JointState) -> Twist:
        """Return the time derivative of the relative twist's components in the child's axes if the
        speeds are constant.

        Its unit is rad/s^2 and m/s^2. The default is zero, which is right for constant columns.
        """
        return REST

    def twist(self, state: JointState) -> Twist:
        """Return the child's relative twist, rad/s and m/s: the columns times the speeds."""
        parts = zip(self.columns(state.position), state.speeds, strict=True)
        return sum((column * speed for column, speed in parts), REST)

    def rotation_rate(self, state: JointState) -> Scalar | None:
        """Return how fast the child rotates relative to its parent, rad/s, a positive number;
        ``None`` if runs need not limit this rotation in a step.

        An angle that grows evenly is integrated exactly, so that errors limit no step. Runs
        therefore limit the rotation in a step where they search steps for contacts and other
        events. The default is the magnitude of the relative spin, or ``None`` without rotation.
        """
        spin = self.twist(state).angular
        return None if all(map(is_zero, spin)) else norm(spin)


class AbstractMotionAtPoints(AbstractMotionSubspace):
    """Base class of motion subspaces with the joint's points on parent and child as fields.

    The points are in m from the centre of mass, in each body's axes.
    """

    point_parent: Vector
    point_child: Vector


class Weld(AbstractMotionAtPoints):
    """The subspace of a fixed joint, without relative motion.

    `reference` is the constant orientation: Euler parameters that transform components in the
    child's axes to the parent's.
    """

    reference: EulerParameters

    def encode(self, relative: Relative) -> JointState:
        """Return an empty position and no speeds."""
        return JointState((), ())

    def orientation(self, position: PyTree) -> EulerParameters:
        """Return the constant `reference`."""
        return self.reference

    def columns(self, position: PyTree) -> tuple[Twist, ...]:
        """Return no columns."""
        return ()


def rotation_about(axis: Vector, angle: Scalar) -> EulerParameters:
    """Return Euler parameters of a rotation by an angle, rad, about a unit vector."""
    vector = axis * sine_of(0.5 * angle)
    return EulerParameters(cosine_of(0.5 * angle), vector.x, vector.y, vector.z)


class AbstractTurning(AbstractMotionAtPoints):
    """Base class of motion subspaces in which the child only rotates about one axis.

    `axis` is a unit vector along this axis, in the child's axes. `reference` is the orientation at
    angle zero, as Euler parameters that transform components in the child's axes to the parent's.
    `aligning` computes such an orientation from the axis in both bodies. Subclasses may add
    translations.
    """

    axis: Vector
    reference: EulerParameters

    def angle(self, relative: Relative) -> Scalar:
        """Return the angle of rotation, rad, within [-2 pi, 2 pi].

        Angles that differ by two revolutions give the same result, because Euler parameters depend
        on half the angle: after one revolution they have the opposite sign, after two the same.
        """
        rotation = composed(conjugate(self.reference), relative.orientation)
        vector = Vector(rotation.e1, rotation.e2, rotation.e3)
        return 2.0 * polar_angle(vector.dot(self.axis), rotation.e0)

    def orientation(self, position: Scalar) -> EulerParameters:
        """Return Euler parameters that transform components in the child's axes to the parent's.

        They are those of the rotation by the angle `position`, rad, followed by `reference`.
        """
        return composed(self.reference, rotation_about(self.axis, position))

    def rotation(self, position: Scalar) -> Matrix:
        """Return the matrix that transforms the child's components to the parent's.

        It is R (b b^T + cos(angle) (I - b b^T) + sin(angle) ~b) with the matrix R of `reference`,
        the identity I, the axis b, and the matrix ~b of the cross product with b. This form has few
        products if the axis is along x, y or z: its components are then exactly 0 or 1, and are
        compiled as constants.
        """
        b, cosine, sine = self.axis, cosine_of(position), sine_of(position)

        def row(reference: Vector) -> Vector:
            along = b * reference.dot(b)
            return along + (reference - along) * cosine + reference.cross(b) * sine

        matrix = rotation_matrix(self.reference)
        return Matrix(row(matrix.row_x), row(matrix.row_y), row(matrix.row_z))


class Hinge(AbstractTurning):
    """Rotation by an angle (rad) about an axis; its position is the angle."""

    def encode(self, relative: Relative) -> JointState:
        """Return the angle, rad, and its rate, rad/s, for a relative motion of the child."""
        return JointState(self.angle(relative), (relative.twist.angular.dot(self.axis),))

    def columns(self, position: Scalar) -> tuple[Twist, ...]:
        """Return a rotation about the axis at 1 rad/s."""
        return (Twist(self.axis, ZERO),)

    def without_drift(self, position: Scalar) -> Scalar:
        """Return the angle less a multiple of 4 pi, within [-2 pi, 2 pi]."""
        return within_two_turns(position)


class Ball(AbstractMotionAtPoints):
    """Free rotation of the child about the joint's point.

    The position consists of the Euler parameters that transform components in the child's axes to
    the parent's. The three speeds are the relative spin in the child's axes, rad/s.
    """

    def encode(self, relative: Relative) -> JointState:
        """Return the relative Euler parameters and the relative spin, rad/s in the child's axes."""
        spin = relative.twist.angular
        return JointState(relative.orientation, (spin.x, spin.y, spin.z))

    def orientation(self, position: EulerParameters) -> EulerParameters:
        """Return the Euler parameters unchanged."""
        return position

    def columns(self, position: EulerParameters) -> tuple[Twist, ...]:
        """Return rotations about the child's axes at 1 rad/s."""
        return tuple(Twist(axis, ZERO) for axis in (UNIT_X, UNIT_Y, UNIT_Z))

    def rates(self, state: JointState) -> EulerParameters:
        """Return the rates of the Euler parameters, 1/s."""
        return euler_parameter_rates(state.position, Vector(*state.speeds))

    def after_displacement(
        self, position: EulerParameters, changes: tuple[Scalar, ...]
    ) -> EulerParameters:
        """Return the Euler parameters after a small rotation.

        `changes` are the components of the rotation vector in the child's axes, rad.
        """
        return turned(position, Vector(*changes))

    def without_drift(self, position: EulerParameters) -> EulerParameters:
        """Return the Euler parameters with their norm corrected to 1 if it has drifted."""
        return kept_unit(position)

    def rotation_rate(self, state: JointState) -> None:
        """Return ``None``: the integration error of Euler parameters limits the rotation in a
        step."""


class Slider(AbstractMotionAtPoints):
    """Translation by a distance (m) along `axis`, a unit vector in the child's axes.

    The position is the distance, and its rate the only speed, m/s. `reference` is the constant
    orientation, as Euler parameters that transform components in the child's axes to the parent's.
    """

    axis: Vector
    reference: EulerParameters

    def encode(self, relative: Relative) -> JointState:
        """Return the distance along the axis, m, and its rate, m/s, for a motion of the child."""
        distance = relative.displacement.dot(self.axis)
        return JointState(distance, (relative.twist.linear.dot(self.axis),))

    def orientation(self, position: Scalar) -> EulerParameters:
        """Return the constant `reference`."""
        return self.reference

    def displacement(self, position: Scalar) -> Vector:
        """Return the vector from the parent's point to the child's, m in the child's axes."""
        return self.axis * position

    def columns(self, position: Scalar) -> tuple[Twist, ...]:
        """Return a translation along the axis at 1 m/s."""
        return (Twist(ZERO, self.axis),)


def aligning(first: Vector, second: Vector) -> EulerParameters:
    """Return Euler parameters of a rotation that turns the second unit vector into the first.

    Their norm need not be 1. For equal vectors they are exactly proportional to (1, 0, 0, 0). The
    rotation is also defined for opposite vectors, for which the shortest rotation is not unique. In
    general it is not the shortest one.
    """
    return composed(_from_zeta(first), conjugate(_from_zeta(second)))


def _from_zeta(axis: Vector) -> EulerParameters:
    """Return Euler parameters, not normalised, of a rotation that turns the z axis into a unit
    vector.

    If the vector's z component is not negative, this is the shortest rotation, whose formula is
    singular for the direction -z. If the z component is negative, half a revolution about x first
    turns the z axis into -z, and the shortest rotation from -z to the vector follows.
    """
    forwards = EulerParameters(1.0 + axis.z, -axis.y, axis.x, 0.0)
    shortest = EulerParameters(1.0 - axis.z, axis.y, -axis.x, 0.0)
    backwards = composed(shortest, EulerParameters(0.0, 1.0, 0.0, 0.0))
    # A Python number is known before compilation, so that only one branch is computed.
    if isinstance(axis.z, int | float):
        return forwards if axis.z >= 0.0 else backwards
    return jax.tree.map(lambda a, b: where(axis.z >= 0.0, a, b), forwards, backwards)
