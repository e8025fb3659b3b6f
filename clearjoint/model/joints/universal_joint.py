"""The universal joint and its motion subspace."""

from ...fields.checks import require_axis
from ...fields.declarations import quantity
from ...fields.types import Triple
from ...math.functions import cosine, polar_angle, sine
from ...math.rotations import composed, rotation_matrix, transverse_axes, unit, within_two_turns
from ...math.vectors import ZERO, EulerParameters, Scalar, Vector
from ..pen import AbstractPen
from .base import Motions, Row
from .ideal import AbstractPairJoint
from .motion_subspaces import (
    AbstractMotionAtPoints,
    Hinge,
    JointState,
    Relative,
    Twist,
    aligning,
)

Angles = tuple[Scalar, Scalar]
"""Angle of the cross about the parent's arm, and of the child about its own arm, rad."""


class UniversalMotion(AbstractMotionAtPoints):
    """Rotation by two angles (rad), about an arm of the parent and about an arm of the child.

    The position consists of the two angles; the speeds are their rates, rad/s.

    - `point_parent`, `point_child`: points of the joint, m in each body's axes.
    - `arm_parent`, `arm_child`: arms of the cross, unit vectors in each body's axes.
    """

    arm_parent: Vector
    arm_child: Vector

    def _reference(self) -> EulerParameters:
        """Return the orientation if both angles are zero."""
        return aligning(transverse_axes(self.arm_parent)[0], self.arm_child)

    def _about_child(self, reference: EulerParameters) -> Hinge:
        return Hinge(self.point_parent, self.point_child, self.arm_child, reference)

    def _about_parent(self, angle: Scalar) -> EulerParameters:
        vector = self.arm_parent * sine(0.5 * angle)
        return EulerParameters(cosine(0.5 * angle), vector.x, vector.y, vector.z)

    def _parents_arm(self, angle: Scalar) -> tuple[Vector, Vector]:
        """Return the parent's arm, a unit vector in the child's axes, and its derivative by the
        second angle, 1/rad.

        `angle` is the second angle, rad, about the child's arm.
        """
        start = rotation_matrix(self._reference()).transposed_times(self.arm_parent)
        quarter = self.arm_child.cross(start)
        c, s = cosine(angle), sine(angle)
        return start * c - quarter * s, -(start * s + quarter * c)

    def encode(self, relative: Relative) -> JointState:
        """Return both angles, rad in (-pi, pi] and (-2 pi, 2 pi], and their rates, rad/s."""
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
        """Return Euler parameters that transform components in the child's axes to the parent's."""
        reference = composed(self._about_parent(position[0]), self._reference())
        return self._about_child(reference).orientation(position[1])

    def columns(self, position: Angles) -> tuple[Twist, ...]:
        """Return rotations at 1 rad/s about both arms, in the child's axes."""
        return Twist(self._parents_arm(position[1])[0], ZERO), Twist(self.arm_child, ZERO)

    def bias(self, state: JointState) -> Twist:
        """Return the rate of the relative twist at constant speeds, in the child's axes.

        It isn't zero, because the parent's arm rotates as seen from the child.
        """
        _, change = self._parents_arm(state.position[1])
        return Twist(change * (state.speeds[0] * state.speeds[1]), ZERO)

    def without_drift(self, position: Angles) -> Angles:
        """Return the angles within (-2 pi, 2 pi]."""
        return within_two_turns(position[0]), within_two_turns(position[1])


class UniversalJoint(AbstractPairJoint):
    r"""A Hooke or Cardan joint: keeps two points together and two axes perpendicular; four rows.

    $$\frac{\omega_2}{\omega_1} = \frac{\cos \beta}{1 - \sin^2 \beta \cos^2 \theta}$$

    The axes are the arms of a massless cross. The equation is the ratio of the speeds omega of two
    shafts that enclose the angle beta. Here theta is the first shaft's angle of rotation, zero
    where its arm lies in the plane of the shafts (C. E. Wilson, J. P. Sadler, Kinematics and
    Dynamics of Machinery, 1993).

    **Arguments:**

    - `first`, `second`: names of the bodies; one may be the ground.
    - `point_first`, `point_second`: centre of the cross on each body, (3,) m in body axes.
    - `axis_first`, `axis_second`: arm of the cross on each body, (3,) in body axes, any length.

    **Raises:** `ValueError` if a point or axis is invalid.

    >>> joint = cj.UniversalJoint("ground", "arm", (0, 0, 0), (0, 0, 0), (0, 0, 1), (1, 0, 0))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['translation x', 'translation y', 'translation z', 'cross']
    """

    axis_first: Triple = quantity("1", check=require_axis)
    axis_second: Triple = quantity("1", check=require_axis)

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return three translations, m, and "cross", the cosine of the angle between the arms."""
        del t
        arms = self._perpendicular(motions, unit(self.axis_first), unit(self.axis_second))
        return self._coincidence(motions) | {"cross": arms}

    def motion_subspace(self, parent: str) -> UniversalMotion:
        """Return the subspace of rotation about the two arms of the cross."""
        points = self._ordered(parent, self.point_first, self.point_second)
        arms = self._ordered(parent, unit(self.axis_first), unit(self.axis_second))
        return UniversalMotion(*points, *arms)

    def draw(self, pen: AbstractPen) -> None:
        """Draw a cross."""
        pen.cross(*self.ends(self.axis_first, self.axis_second))
