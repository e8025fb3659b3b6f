"""The motion that a planar joint leaves free."""

from ...math.rotations import transverse_axes
from ...math.vectors import ZERO, EulerParameters, Matrix, Scalar, Vector, add
from .motion_subspaces import AbstractMotionSubspace, Hinge, JointState, Relative, Twist

Place = tuple[Scalar, Scalar, Scalar]
"""Two distances, m, and an angle, rad."""


class PlanarMotion(AbstractMotionSubspace):
    """Sliding in a plane of the parent by two distances (m) in its axes, and turning about the
    normal by an angle (rad).

    `normal_parent` and `normal_child` are unit vectors, each in the axes of its body; `reference`
    turns the child's components into the parent's at angle zero. Distances in the child's axes
    would have constant columns, but would run round and round as it turns.
    """

    point_parent: Vector
    point_child: Vector
    normal_parent: Vector
    normal_child: Vector
    reference: EulerParameters

    def encode(self, relative: Relative) -> JointState:
        """The distances and the angle, within (-2 pi, 2 pi], and their rates."""
        turning = self._hinge().encode(relative)
        rotation = self.rotation((0.0, 0.0, turning.position))
        apart, turn = relative.displacement, relative.twist.angular
        place = rotation @ apart
        velocity = rotation @ (relative.twist.linear + turn.cross(apart))
        first, second = transverse_axes(self.normal_parent)
        return JointState(
            (place.dot(first), place.dot(second), turning.position),
            (velocity.dot(first), velocity.dot(second), *turning.speeds),
        )

    def orientation(self, position: Place) -> EulerParameters:
        """The reference, turned by the angle about the normal."""
        return self._hinge().orientation(position[2])

    def rotation(self, position: Place) -> Matrix:
        """That of the hinge, which costs less than the one of Euler parameters."""
        return self._hinge().rotation(position[2])

    def displacement(self, position: Place) -> Vector:
        """From the parent's point to the child's, child's axes, m."""
        return self._in_child(position[:2], position)

    def columns(self, position: Place) -> tuple[Twist, ...]:
        """Motions along two axes of the parent at 1 m/s, and a turn at 1 rad/s."""
        sliding = (self._in_child(axis, position) for axis in ((1.0, 0.0), (0.0, 1.0)))
        apart = self.displacement(position)
        turning = Twist(self.normal_child, apart.cross(self.normal_child))
        return (*(Twist(ZERO, slide) for slide in sliding), turning)

    def bias(self, state: JointState) -> Twist:
        """What the directions of the sliding, as they turn in the child's axes, add."""
        first, second, speed = state.speeds
        turn = self.normal_child * speed
        velocity = self._in_child((first, second), state.position)
        apart = self.displacement(state.position)
        return Twist(ZERO, turn.cross(turn.cross(apart) - velocity * 2.0))

    def rates(self, state: JointState) -> Place:
        """Rates of the distances, m/s, and of the angle, rad/s."""
        first, second, turn = state.speeds
        return first, second, turn

    def after_displacement(self, position: Place, changes: tuple[Scalar, ...]) -> Place:
        """The position plus the changes."""
        first, second, turn = map(add, position, changes)
        return first, second, turn

    def without_drift(self, position: Place) -> Place:
        """The angle within two turns, as `encode` gives it."""
        return position[0], position[1], self._hinge().without_drift(position[2])

    def _hinge(self) -> Hinge:
        return Hinge(self.point_parent, self.point_child, self.normal_child, self.reference)

    def _in_child(self, across: tuple[Scalar, Scalar], position: Place) -> Vector:
        """A vector of the plane in the child's axes."""
        first, second = transverse_axes(self.normal_parent)
        vector = first * across[0] + second * across[1]
        return self.rotation(position).transposed_times(vector)
