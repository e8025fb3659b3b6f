"""The motion that a planar joint leaves free."""

from ...math.rotations import transverse_axes
from ...math.vectors import ZERO, EulerParameters, Matrix, Scalar, Vector, add
from .motion_subspaces import AbstractFreedom, Hinge, JointState, Relative, Twist

Place = tuple[Scalar, Scalar, Scalar]
"""Two distances, m, and an angle, rad."""


class PlanarMotion(AbstractFreedom):
    """Sliding across the axis of a hinge, by two distances (m) in the child's axes, and turning
    about it by an angle (rad)."""

    point_parent: Vector
    point_child: Vector
    axis: Vector
    reference: EulerParameters

    def _hinge(self) -> Hinge:
        return Hinge(self.point_parent, self.point_child, self.axis, self.reference)

    def encode(self, relative: Relative) -> JointState:
        """The distances and the angle, within (-2 pi, 2 pi], and their rates."""
        turning, across = self._hinge().encode(relative), transverse_axes(self.axis)
        distances = (relative.displacement.dot(direction) for direction in across)
        rates = (relative.twist.slide.dot(direction) for direction in across)
        return JointState((*distances, turning.position), (*rates, *turning.speeds))

    def orientation(self, position: Place) -> EulerParameters:
        """The reference, turned by the angle about the axis."""
        return self._hinge().orientation(position[2])

    def rotation(self, position: Place) -> Matrix:
        """That of the hinge, which costs less than the one of Euler parameters."""
        return self._hinge().rotation(position[2])

    def displacement(self, position: Place) -> Vector:
        """The distances along the two axes across, as a vector in m."""
        first, second = transverse_axes(self.axis)
        return first * position[0] + second * position[1]

    def columns(self, position: Place) -> tuple[Twist, ...]:
        """Motions across the axis at 1 m/s, and a turn about it at 1 rad/s."""
        del position
        across = transverse_axes(self.axis)
        return (*(Twist(ZERO, direction) for direction in across), Twist(self.axis, ZERO))

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
