"""Ideal joints that hold a point, a line or a plane of one body in a plane of another."""

from ...fields.checks import require_axis
from ...fields.declarations import quantity
from ...fields.types import Triple
from ...math.rotations import transverse_axes, unit
from ...math.vectors import ZERO, EulerParameters, Matrix, Scalar, Vector
from ..pen import AbstractPen
from .base import Motions, Row
from .ideal import AbstractAxisJoint, AbstractPairJoint
from .motion_subspaces import AbstractMotionAtPoints, Hinge, JointState, Relative, Twist, aligning


class PointInPlaneJoint(AbstractPairJoint):
    """Keeps a point of the second body in a plane of the first; one constraint row.

    It models a pin in a slot without clearance, with walls parallel to the plane.

    **Arguments:**

    - `first`, `second`: names of the bodies; one may be the ground.
    - `point_first`: a point of the plane, (3,) m in the first body's axes.
    - `point_second`: the point that stays in the plane, (3,) m in the second body's axes.
    - `normal`: normal of the plane, (3,) in the first body's axes, any length.

    **Raises:** `ValueError` if the bodies are the same, or a point or the normal is invalid.

    >>> joint = cj.PointInPlaneJoint("ground", "arm", (0, 0, 0), (0, 0.1, 0), normal=(0, 1, 0))
    >>> rows = extend.unpack(joint).rows(motions, 0.0)
    >>> {name: float(row.value) for name, row in rows.items()}  # m off the plane
    {'height': 0.1}
    """

    normal: Triple = quantity("1", check=require_axis)

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return one row: the height of the second body's point above the plane, m."""
        return self._height(motions, self.normal)

    def draw(self, pen: AbstractPen) -> None:
        """Draw the plane."""
        pen.plane(*self.ends(self.normal))


class LineInPlaneJoint(AbstractPairJoint):
    """Keeps a line of the second body in a plane of the first; two constraint rows.

    It models a slider between two walls without clearance, which slides freely along them.

    **Arguments:**

    - `first`, `second`: names of the bodies; one may be the ground.
    - `point_first`: a point of the plane, (3,) m in the first body's axes.
    - `point_second`: a point of the line, (3,) m in the second body's axes.
    - `normal`: normal of the plane, (3,) in the first body's axes, any length.
    - `axis`: direction of the line, (3,) in the second body's axes, any length.

    **Raises:** `ValueError` if the bodies are the same, or a point or direction is invalid.

    >>> points = (0, 0, 0), (0, 0, 0)
    >>> joint = cj.LineInPlaneJoint("ground", "arm", *points, normal=(0, 1, 0), axis=(1, 0, 0))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['height', 'tilt']
    """

    normal: Triple = quantity("1", check=require_axis)
    axis: Triple = quantity("1", check=require_axis)

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return the "height" of the point above the plane, m, and "tilt", the sine of the angle
        between the line and the plane."""
        tilt = self._perpendicular(motions, unit(self.normal), unit(self.axis))
        return self._height(motions, self.normal) | {"tilt": tilt}

    def draw(self, pen: AbstractPen) -> None:
        """Draw the plane through the first body's point."""
        pen.plane(*self.ends(self.normal))


Position = tuple[Scalar, Scalar, Scalar]
"""Coordinates of a planar joint: distances along the two transverse axes of the parent's normal, m,
and the angle about the normal, rad."""


class PlanarMotion(AbstractMotionAtPoints):
    """Translation by two distances (m) in a plane of the parent, and rotation by an angle (rad).

    It is the motion that a `PlanarJoint` allows a child body relative to its parent body. The
    position consists of the two distances and the angle; the speeds are their rates.

    - `point_parent`, `point_child`: points of the joint, m in each body's axes.
    - `normal_parent`, `normal_child`: the plane's normal, a unit vector in each body's axes.
    - `reference`: Euler parameters that transform the child's components to the parent's at angle
      zero.

    The distances are along the two transverse axes of `normal_parent`, unit vectors across it that
    are fixed to the parent. Along axes of the child, the directions of motion would be constant,
    but the distances would oscillate as the child rotates.
    """

    normal_parent: Vector
    normal_child: Vector
    reference: EulerParameters

    def encode(self, relative: Relative) -> JointState:
        """Return the joint coordinates of a relative motion of the child.

        The position consists of the two distances, m, and the angle, rad within (-2 pi, 2 pi], and
        the speeds are their rates.
        """
        # The vectors of `relative` are in the child's axes, the distances along those of the
        # parent. In the parent's axes the displacement also changes because the child rotates.
        hinge = self._hinge().encode(relative)
        rotation = self.rotation((0.0, 0.0, hinge.position))
        apart, spin = relative.displacement, relative.twist.angular
        offset = rotation @ apart
        velocity = rotation @ (relative.twist.linear + spin.cross(apart))
        first, second = transverse_axes(self.normal_parent)
        return JointState(
            (offset.dot(first), offset.dot(second), hinge.position),
            (velocity.dot(first), velocity.dot(second), *hinge.speeds),
        )

    def orientation(self, position: Position) -> EulerParameters:
        """Return Euler parameters that transform the child's components to the parent's."""
        return self._hinge().orientation(position[2])

    def rotation(self, position: Position) -> Matrix:
        """Return the matrix that transforms the child's components to the parent's.

        The angle gives it with less arithmetic than the Euler parameters do.
        """
        return self._hinge().rotation(position[2])

    def displacement(self, position: Position) -> Vector:
        """Return the vector from the parent's point to the child's, m in the child's axes."""
        return self._in_child(position[:2], position)

    def columns(self, position: Position) -> tuple[Twist, ...]:
        """Return translations at 1 m/s along the two transverse axes of the parent's normal, and a
        rotation at 1 rad/s about the normal; all in the child's axes.
        """
        directions = (self._in_child(axis, position) for axis in ((1.0, 0.0), (0.0, 1.0)))
        apart = self.displacement(position)
        rotation = Twist(self.normal_child, apart.cross(self.normal_child))
        return (*(Twist(ZERO, direction) for direction in directions), rotation)

    def bias(self, state: JointState) -> Twist:
        """Return the rate of the relative twist at constant speeds, in the child's axes.

        Its unit is rad/s^2 and m/s^2. It isn't zero, because the parent's axes rotate as seen from
        the child.
        """
        first, second, speed = state.speeds
        spin = self.normal_child * speed
        velocity = self._in_child((first, second), state.position)
        apart = self.displacement(state.position)
        return Twist(ZERO, spin.cross(spin.cross(apart) - velocity * 2.0))

    def without_drift(self, position: Position) -> Position:
        """Return the position with the angle within (-2 pi, 2 pi], without further revolutions."""
        return position[0], position[1], self._hinge().without_drift(position[2])

    def _hinge(self) -> Hinge:
        return Hinge(self.point_parent, self.point_child, self.normal_child, self.reference)

    def _in_child(self, across: tuple[Scalar, Scalar], position: Position) -> Vector:
        """Return a vector in the child's axes from its two components along the transverse axes of
        the parent's normal."""
        first, second = transverse_axes(self.normal_parent)
        vector = first * across[0] + second * across[1]
        return self.rotation(position).transposed_times(vector)


class PlanarJoint(AbstractAxisJoint):
    """Allows sliding in a plane and rotation about its normal, like a plate on a table; three rows.

    **Arguments:**

    - `first`, `second`: names of the bodies; one may be the ground.
    - `point_first`, `point_second`: a point of the plane on each body, (3,) m in body axes.
    - `axis_first`, `axis_second`: the plane's normal on each body, (3,) in body axes, any length.

    **Raises:** `ValueError` if the bodies are the same, or a point or axis is invalid.

    >>> joint = cj.PlanarJoint("ground", "arm", (0, 0, 0), (0, 0, 0), (0, 0, 1), (0, 0, 1))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['height', 'tilt 1', 'tilt 2']
    """

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return the "height" of the second point above the plane, m, and "tilt 1" and "tilt 2".

        The tilts are the cosines of the angles between the first body's normal and two directions
        across the second body's normal.
        """
        return self._height(motions, self.axis_first) | self._tilts(motions)

    def motion_subspace(self, parent: str) -> PlanarMotion:
        """Return the subspace of two distances in the plane and an angle about its normal."""
        points = self._ordered(parent, self.point_first, self.point_second)
        in_parent, in_child = self._ordered(parent, unit(self.axis_first), unit(self.axis_second))
        return PlanarMotion(*points, in_parent, in_child, aligning(in_parent, in_child))

    def draw(self, pen: AbstractPen) -> None:
        """Draw the plane through the first body's point."""
        pen.plane(*self.ends(self.axis_first, self.axis_second))
