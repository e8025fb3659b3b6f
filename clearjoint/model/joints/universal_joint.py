"""The universal joint and its motion subspace."""

from ...fields.checks import require_axis
from ...fields.declarations import quantity
from ...fields.types import Triple
from ...math.functions import cosine, polar_angle, sine
from ...math.rotations import composed, rotation_matrix, transverse_axes, unit, within_two_turns
from ...math.vectors import ZERO, EulerParameters, Scalar, Vector, add
from ..pen import AbstractPen
from .base import Motions, Row
from .ideal import AbstractPairJoint
from .motion_subspaces import (
    AbstractMotionSubspace,
    Hinge,
    JointState,
    Relative,
    Twist,
    aligning,
)

Angles = tuple[Scalar, Scalar]
"""Angles of the cross about the parent's arm, and of the child about its own arm, rad."""


class UniversalMotion(AbstractMotionSubspace):
    """Rotation by two angles (rad), about an arm of the parent and about an arm of the child.

    `arm_parent` and `arm_child` are unit vectors, each in the axes of its body.
    """

    point_parent: Vector
    point_child: Vector
    arm_parent: Vector
    arm_child: Vector

    def _reference(self) -> EulerParameters:
        """Return the transformation from the child's components to the parent's at zero angles."""
        return aligning(transverse_axes(self.arm_parent)[0], self.arm_child)

    def _about_child(self, reference: EulerParameters) -> Hinge:
        return Hinge(self.point_parent, self.point_child, self.arm_child, reference)

    def _about_parent(self, angle: Scalar) -> EulerParameters:
        vector = self.arm_parent * sine(0.5 * angle)
        return EulerParameters(cosine(0.5 * angle), vector.x, vector.y, vector.z)

    def _parents_arm(self, angle: Scalar) -> tuple[Vector, Vector]:
        """Return the parent's arm in the child's axes, and its derivative by the child's angle."""
        start = rotation_matrix(self._reference()).transposed_times(self.arm_parent)
        quarter = self.arm_child.cross(start)
        c, s = cosine(angle), sine(angle)
        return start * c - quarter * s, -(start * s + quarter * c)

    def encode(self, relative: Relative) -> JointState:
        """Return the angles and their rates.

        The first angle is within (-pi, pi], the second within (-2 pi, 2 pi].
        """
        start, quarter = transverse_axes(self.arm_parent)
        arm = rotation_matrix(relative.orientation) @ self.arm_child
        first = polar_angle(arm.dot(quarter), arm.dot(start))
        reference = composed(self._about_parent(first), self._reference())
        second = self._about_child(reference).encode(relative)
        along, _ = self._parents_arm(second.position)
        return JointState(
            (first, second.position), (relative.twist.angular.dot(along), *second.speeds)
        )

    def orientation(self, position: Angles) -> EulerParameters:
        """Return the rotation about the parent's arm after the rotation about the child's."""
        reference = composed(self._about_parent(position[0]), self._reference())
        return self._about_child(reference).orientation(position[1])

    def columns(self, position: Angles) -> tuple[Twist, ...]:
        """Return rotations about the two arms at 1 rad/s."""
        return Twist(self._parents_arm(position[1])[0], ZERO), Twist(self.arm_child, ZERO)

    def bias(self, state: JointState) -> Twist:
        """Return the twist rate from the rotation of the parent's arm in the child's axes."""
        _, change = self._parents_arm(state.position[1])
        return Twist(change * (state.speeds[0] * state.speeds[1]), ZERO)

    def rates(self, state: JointState) -> Angles:
        """Return the rates of the angles, rad/s."""
        first, second = state.speeds
        return first, second

    def after_displacement(self, position: Angles, changes: tuple[Scalar, ...]) -> Angles:
        """Return the angles plus the changes, rad."""
        first, second = map(add, position, changes)
        return first, second

    def without_drift(self, position: Angles) -> Angles:
        """Return the angles within two revolutions."""
        return within_two_turns(position[0]), within_two_turns(position[1])


class UniversalJoint(AbstractPairJoint):
    r"""A Hooke or Cardan joint: keeps two points together and two axes perpendicular; four rows.

    $$\frac{\omega_2}{\omega_1} = \frac{\cos \beta}{1 - \sin^2 \beta \cos^2 \theta}$$

    The axes are the arms of a massless cross. Between two shafts at the angle b, the ratio of the
    second shaft's speed to the first's is cos b / (1 - sin^2 b cos^2 th). Here th is the first
    shaft's angle, zero where its arm lies in the plane of the shafts (C. E. Wilson, J. P. Sadler,
    Kinematics and Dynamics of Machinery, 1993).

    **Arguments:** as for `SphericalJoint`, and `axis_first`, `axis_second`: the arms of the cross,
    each (3,) in the axes of its body, any length.

    **Raises:** `ValueError` if a point or axis is invalid.

    >>> still = testing.moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> motions = {"ground": still, "arm": still}
    >>> joint = cj.UniversalJoint("ground", "arm", (0, 0, 0), (0, 0, 0), (0, 0, 1), (1, 0, 0))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['translation x', 'translation y', 'translation z', 'cross']
    """

    axis_first: Triple = quantity("1", check=require_axis)
    axis_second: Triple = quantity("1", check=require_axis)

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return three translations, m, and the cosine of the angle between the arms."""
        del t
        arms = self._perpendicular(motions, unit(self.axis_first), unit(self.axis_second))
        return self._coincidence(motions) | {"cross": arms}

    def motion_subspace(self, parent: str) -> UniversalMotion:
        """Return rotation about the two arms of the cross."""
        points = self._ordered(parent, self.point_first, self.point_second)
        arms = self._ordered(parent, unit(self.axis_first), unit(self.axis_second))
        return UniversalMotion(*points, *arms)

    def draw(self, pen: AbstractPen) -> None:
        """Draw a cross."""
        pen.cross(*self.ends(self.axis_first, self.axis_second))
