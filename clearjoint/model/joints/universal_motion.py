"""The motion that a universal joint leaves free."""

from ...math.functions import cosine, polar_angle, sine
from ...math.rotations import composed, rotation_matrix, transverse_axes, within_two_turns
from ...math.vectors import ZERO, EulerParameters, Scalar, Vector, add
from .motion_subspaces import AbstractMotionSubspace, Hinge, JointState, Relative, Twist, aligning

Angles = tuple[Scalar, Scalar]
"""Of the cross about the parent's arm, and of the child about its own, rad."""


class UniversalMotion(AbstractMotionSubspace):
    """Turning about an arm of the parent, and about one of the child, by two angles (rad).

    `arm_parent` and `arm_child` are unit vectors, each in the axes of its body.
    """

    point_parent: Vector
    point_child: Vector
    arm_parent: Vector
    arm_child: Vector

    def _reference(self) -> EulerParameters:
        """What turns the child's components into the parent's where both angles are zero."""
        return aligning(transverse_axes(self.arm_parent)[0], self.arm_child)

    def _about_child(self, reference: EulerParameters) -> Hinge:
        return Hinge(self.point_parent, self.point_child, self.arm_child, reference)

    def _about_parent(self, angle: Scalar) -> EulerParameters:
        vector = self.arm_parent * sine(0.5 * angle)
        return EulerParameters(cosine(0.5 * angle), vector.x, vector.y, vector.z)

    def _parents_arm(self, angle: Scalar) -> tuple[Vector, Vector]:
        """The parent's arm in the child's axes, and its derivative by the child's angle."""
        start = rotation_matrix(self._reference()).transposed_times(self.arm_parent)
        quarter = self.arm_child.cross(start)
        c, s = cosine(angle), sine(angle)
        return start * c - quarter * s, -(start * s + quarter * c)

    def encode(self, relative: Relative) -> JointState:
        """The angles, the first within (-pi, pi] and the second within (-2 pi, 2 pi], and their
        rates."""
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
        """The turn about the parent's arm after that about the child's."""
        reference = composed(self._about_parent(position[0]), self._reference())
        return self._about_child(reference).orientation(position[1])

    def columns(self, position: Angles) -> tuple[Twist, ...]:
        """Turns about the two arms at 1 rad/s."""
        return Twist(self._parents_arm(position[1])[0], ZERO), Twist(self.arm_child, ZERO)

    def bias(self, state: JointState) -> Twist:
        """What the parent's arm, as it turns in the child's axes, adds."""
        _, change = self._parents_arm(state.position[1])
        return Twist(change * (state.speeds[0] * state.speeds[1]), ZERO)

    def rates(self, state: JointState) -> Angles:
        """Rates of the angles, rad/s."""
        first, second = state.speeds
        return first, second

    def after_displacement(self, position: Angles, changes: tuple[Scalar, ...]) -> Angles:
        """The angles plus the changes, rad."""
        first, second = map(add, position, changes)
        return first, second

    def without_drift(self, position: Angles) -> Angles:
        """The angles within two turns."""
        return within_two_turns(position[0]), within_two_turns(position[1])
