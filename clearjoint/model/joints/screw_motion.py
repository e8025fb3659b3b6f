"""The motion that a screw joint leaves free."""

import math

from ...math.functions import where
from ...math.periodic import wrapped
from ...math.vectors import EulerParameters, Matrix, Scalar, Vector, add
from .motion_subspaces import AbstractFreedom, Hinge, JointState, Relative, Twist


class ScrewMotion(AbstractFreedom):
    """Turning by an angle (rad) about `axis`, a unit vector in the child's axes, and advancing
    along it by `pitch` (m/rad) as much.

    `reference` turns the child's components into the parent's at angle zero; see `shortest_turn`.
    """

    point_parent: Vector
    point_child: Vector
    axis: Vector
    reference: EulerParameters
    pitch: Scalar

    def encode(self, relative: Relative) -> JointState:
        """The angle, with the whole turns that the advance tells, and its rate."""
        turning = self._hinge().encode(relative)
        by_advance = relative.displacement.dot(self.axis) / self.pitch
        off = wrapped(by_advance - turning.position, 2.0 * math.pi)
        return JointState(by_advance - off, turning.speeds)

    def orientation(self, position: Scalar) -> EulerParameters:
        """The reference, turned by the angle about the axis."""
        return self._hinge().orientation(position)

    def rotation(self, position: Scalar) -> Matrix:
        """That of the hinge, which costs less than the one of Euler parameters."""
        return self._hinge().rotation(position)

    def displacement(self, position: Scalar) -> Vector:
        """The advance along the axis, m."""
        return self.axis * (self.pitch * position)

    def columns(self, position: Scalar) -> tuple[Twist, ...]:
        """A turn at 1 rad/s and the advance by it."""
        del position
        return (Twist(self.axis, self.axis * self.pitch),)

    def rates(self, state: JointState) -> Scalar:
        """Rate of the angle, rad/s."""
        return state.speeds[0]

    def after_displacement(self, position: Scalar, changes: tuple[Scalar, ...]) -> Scalar:
        """The angle plus the change, rad."""
        return add(position, changes[0])

    def _hinge(self) -> Hinge:
        return Hinge(self.point_parent, self.point_child, self.axis, self.reference)


def along(direction: Vector, axis: Vector) -> Vector:
    """The direction or its opposite, whichever is nearer to an axis."""
    return direction * where(axis.dot(direction) < 0.0, -1.0, 1.0)


def shortest_turn(first: Vector, second: Vector) -> EulerParameters:
    """Euler parameters, not normalised, of the shortest turn that takes the second direction to the
    first, which must not be its opposite."""
    vector = second.cross(first)
    return EulerParameters(1.0 + first.dot(second), vector.x, vector.y, vector.z)
