"""Ideal joints that hold points, lines or planes of two bodies together, and a massless rod.

A joint is defined by its rows: scalar constraint equations Phi = 0. The methods `rows` say what the
value Phi of each row is. In joint coordinates, a motion subspace replaces the rows. It describes
the motion that the joint allows one body, the child, relative to the other, the parent. Joints
without a method `motion_subspace`, and joints that close a loop, keep their rows.

Equation numbers are those of P. Flores, J. Ambrosio, J. C. P. Claro, H. M. Lankarani, Spatial
revolute joints with clearances for dynamic analysis of multi-body systems, 2006.
"""

from typing import TypeVar

from ..._fields.checks import require_axis, require_euler_parameters
from ..._fields.objects import quantity
from ..._fields.types import Quadruple, Single, Triple
from ..._math.rotations import conjugate, rotation_matrix, transverse_axes, unit, within_two_turns
from ..._math.vectors import UNIT_X, UNIT_Y, UNIT_Z, ZERO, EulerParameters, Matrix, Scalar, Vector
from ..pen import AbstractPen
from .base import PARALLEL, AbstractConstraint, AbstractPairAtPoints, Motions, Row
from .constraint_rows import (
    coincident_points,
    distance_row,
    perpendicular,
    point_in_plane,
    relative_angle_row,
)
from .motion_subspaces import (
    AbstractTurning,
    Ball,
    Hinge,
    JointState,
    Relative,
    Slider,
    Twist,
    Weld,
    aligning,
)

T = TypeVar("T")


class AbstractPairJoint(AbstractPairAtPoints, AbstractConstraint):
    """Base class of ideal joints between a point of one body and a point of another.

    Its private methods return the constraint rows of which the joints are composed, and order
    values as the motion subspaces need them.
    """

    def _ordered(self, parent: str, of_first: T, of_second: T) -> tuple[T, T]:
        """Return two values, one of each body, in the order parent, child.

        Motion subspaces need this order. `parent` is the name of one of the two bodies.
        """
        return (of_first, of_second) if parent == self.first else (of_second, of_first)

    def _points(self, parent: str) -> tuple[Vector, Vector]:
        """Return the joint's points on the parent and on the child, m in each body's axes."""
        return self._ordered(parent, self.point_first, self.point_second)

    def _coincidence(self, motions: Motions) -> dict[str, Row]:
        """Return three rows for coincident points: the components of the vector from the second
        point to the first, m."""
        return coincident_points(*self._between(motions), self.point_first, self.point_second)

    def _perpendicular(self, motions: Motions, a: Vector, b: Vector) -> Row:
        """Return the row that keeps unit vector `a` of the first body perpendicular to unit vector
        `b` of the second, each in its body's axes. Its value is their scalar product."""
        return perpendicular(*self._between(motions), a, b)

    def _in_plane(self, motions: Motions, normal: Vector) -> Row:
        """Return the row that keeps the second body's point in a plane through the first body's.

        Its value is the point's distance from the plane, m, positive on the side of `normal`, the
        plane's unit normal in the first body's axes.
        """
        points = self.point_first, normal, self.point_second
        return point_in_plane(*self._between(motions), *points)

    def _height(self, motions: Motions, normal: Vector) -> dict[str, Row]:
        return {"height": self._in_plane(motions, unit(normal))}

    def _point_on_line(self, motions: Motions, axis: Vector) -> dict[str, Row]:
        """Return the rows "offset 1" and "offset 2", which keep the second body's point on a line.

        The line goes through the first body's point and has the direction `axis` in the first
        body's axes. The values of the rows are the distances, m, of the second body's point from
        the line along two directions across it.
        """
        first, second = transverse_axes(unit(axis))
        return {
            "offset 1": self._in_plane(motions, first),
            "offset 2": self._in_plane(motions, second),
        }

    def _same_orientation(self, motions: Motions, orientation: EulerParameters) -> dict[str, Row]:
        """Return the rows "rotation x", "rotation y" and "rotation z", which keep the two bodies'
        relative orientation constant.

        `orientation` are Euler parameters that transform components in the second body's axes to a
        frame F, which moves with the second body. The rows keep F parallel to the first body's
        frame. The value of "rotation x" is the scalar product of the first body's y axis and the z
        axis of F; the other values follow by cyclic permutation. The values are also zero at a few
        other orientations, such as after half a revolution about one of the axes. `assemble` and
        the check of an initial state refuse these orientations.
        """
        relative = rotation_matrix(orientation)
        # Parallel frames have y perpendicular to z, z to x, and x to y. A small rotation about x
        # changes only the first of these products, and so on.
        return {
            label: self._perpendicular(motions, a, relative.transposed_times(b))
            for label, a, b in (
                ("rotation x", UNIT_Y, UNIT_Z),
                ("rotation y", UNIT_Z, UNIT_X),
                ("rotation z", UNIT_X, UNIT_Y),
            )
        }


class AbstractAxisJoint(AbstractPairJoint):
    """Base class of ideal joints that keep an axis of one body parallel to an axis of another.

    `axis_first` and `axis_second` are the axes, (3,) in each body's axes, any length.
    """

    axis_first: Triple = quantity("1", check=require_axis)
    axis_second: Triple = quantity("1", check=require_axis)

    def _tilts(self, motions: Motions) -> dict[str, Row]:
        """Return the rows "tilt 1" and "tilt 2", which keep the two axes parallel.

        Their values are the cosines of the angles between the first body's axis and two directions
        across the second body's axis.
        """
        axis, (first, second) = unit(self.axis_first), transverse_axes(unit(self.axis_second))
        return {
            "tilt 1": self._perpendicular(motions, axis, first),
            "tilt 2": self._perpendicular(motions, axis, second),
        }

    def relative_angle(self, motions: Motions) -> Row:
        """Return a row whose value is the second body's angle about the first's axis, rad in
        [-pi, pi], right-handed.

        The angle is zero if the bodies' frames differ by the shortest rotation that makes the two
        axes parallel. The row's Jacobian gives the rate of the angle.
        """
        return relative_angle_row(*self._between(motions), self.axis_first, self.axis_second)


class SphericalJoint(AbstractPairJoint):
    """Keeps a point of one body at a point of the other; three rows (Flores et al. 2006, eq. 25).

    **Arguments:**

    - `first`, `second`: names of the bodies; one may be the ground.
    - `point_first`, `point_second`: the joint's point on each body, (3,) m from the centre of mass
      in body axes.

    **Raises:** `ValueError` if the bodies are the same, or a point is invalid.

    >>> joint = cj.SphericalJoint("ground", "arm", (0, 0, 0), (-0.5, 0, 0))
    >>> rows = extend.unpack(joint).rows(motions, 0.0)
    >>> {name: float(row.value) for name, row in rows.items()}  # m, components of the distance
    {'translation x': 0.5, 'translation y': 0.0, 'translation z': 0.0}
    """

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return the components of the vector from the second point to the first, m."""
        return self._coincidence(motions)

    def motion_subspace(self, parent: str) -> Ball:
        """Return the subspace of free rotation about the joint's point."""
        return Ball(*self._points(parent))

    def draw(self, pen: AbstractPen) -> None:
        """Draw a ball."""
        pen.ball(*self.ends())


class RevoluteJoint(AbstractAxisJoint):
    """Keeps two points together and two axes parallel: a hinge; five rows.

    Eq. 26 of Flores et al. 2006 is the cross product of the two axes, whose three rows are linearly
    dependent. Instead, two rows keep the first body's axis perpendicular to two directions across
    the second body's axis. They are linearly independent while the axes are parallel.

    **Arguments:**

    - `first`, `second`: names of the bodies; one may be the ground.
    - `point_first`, `point_second`: the joint's point on each body, (3,) m from the centre of mass
      in body axes.
    - `axis_first`, `axis_second`: the axis of rotation on each body, (3,) in body axes, any length.

    **Raises:** `ValueError` if the bodies are the same, or a point or axis is invalid.

    >>> joint = cj.RevoluteJoint("ground", "arm", (0, 0, 0), (0, 0, 0), (0, 0, 1), (0, 0, 1))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['translation x', 'translation y', 'translation z', 'tilt 1', 'tilt 2']
    """

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return three components of the vector between the two points, m, and two tilts, which are
        scalar products of unit vectors."""
        return self._coincidence(motions) | self._tilts(motions)

    def motion_subspace(self, parent: str) -> Hinge:
        """Return the subspace of rotation about the axis.

        In it the two axes have the same direction. A state with opposite axes satisfies the rows
        too, but can only be simulated in `AbsoluteCoordinates`.
        """
        in_parent, in_child = self._ordered(parent, unit(self.axis_first), unit(self.axis_second))
        return Hinge(*self._points(parent), in_child, aligning(in_parent, in_child))

    def draw(self, pen: AbstractPen) -> None:
        """Draw a pin."""
        pen.pin(*self.ends(self.axis_first, self.axis_second))


class FixedJoint(AbstractPairJoint):
    """Holds two bodies rigidly together; six rows.

    **Arguments:**

    - `first`, `second`: names of the bodies; one may be the ground.
    - `point_first`, `point_second`: the joint's point on each body, (3,) m from the centre of mass
      in body axes.
    - `orientation`: (4,) Euler parameters, scalar first, that transform components in the second
      body's frame to the first body's frame; parallel frames by default.

    **Raises:** `ValueError` if the bodies are the same, or a point or the orientation is invalid.

    >>> joint = cj.FixedJoint("ground", "arm", (0, 0, 0), (0, 0, 0))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['translation x', 'translation y', 'translation z', 'rotation x', 'rotation y', 'rotation z']
    """

    orientation: Quadruple = quantity("1", check=require_euler_parameters, default=PARALLEL)

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return three components of the vector between the two points, m, and three rotations,
        which are scalar products of unit vectors."""
        return self._coincidence(motions) | self._same_orientation(motions, self.orientation)

    def motion_subspace(self, parent: str) -> Weld:
        """Return a subspace without motion."""
        # From the child's axes to the parent's: the inverse if the second body is the parent.
        orientation, _ = self._ordered(parent, self.orientation, conjugate(self.orientation))
        return Weld(*self._points(parent), orientation)

    def draw(self, pen: AbstractPen) -> None:
        """Draw a weld."""
        pen.weld(*self.ends())


class InlineJoint(AbstractPairJoint):
    """Keeps a point of the second body on a line of the first; two rows.

    If its axis is perpendicular to the plane of a planar mechanism, and other joints hold the
    bodies in the plane, it acts as a pin without redundant constraints.

    **Arguments:**

    - `first`, `second`: names of the bodies; one may be the ground.
    - `point_first`: a point of the line, (3,) m from the first body's centre of mass in its axes.
    - `point_second`: the point that stays on the line, (3,) m from the second body's centre of mass
      in its axes.
    - `axis`: direction of the line, (3,) in the first body's axes, any length.

    **Raises:** `ValueError` if the bodies are the same, or a point or the axis is invalid.

    >>> joint = cj.InlineJoint("ground", "arm", (0, 0, 0), (0, 0, 0), axis=(1, 0, 0))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['offset 1', 'offset 2']
    """

    axis: Triple = quantity("1", check=require_axis)

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return two components of the point's distance from the line, m."""
        return self._point_on_line(motions, self.axis)

    def draw(self, pen: AbstractPen) -> None:
        """Draw a sleeve on a rail."""
        pen.slide(*self.ends(self.axis), turning=True)


class CylindricalJoint(AbstractAxisJoint):
    """Allows rotation about a common axis and sliding along it; four rows.

    **Arguments:**

    - `first`, `second`: names of the bodies; one may be the ground.
    - `point_first`, `point_second`: a point of the axis on each body, (3,) m from the centre of
      mass in body axes.
    - `axis_first`, `axis_second`: the axis on each body, (3,) in body axes, any length.

    **Raises:** `ValueError` if the bodies are the same, or a point or axis is invalid.

    >>> joint = cj.CylindricalJoint("ground", "arm", (0, 0, 0), (0, 0, 0), (0, 0, 1), (0, 0, 1))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['offset 1', 'offset 2', 'tilt 1', 'tilt 2']
    """

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return two components of the second point's distance from the axis, m, and two tilts,
        which are scalar products of unit vectors."""
        return self._point_on_line(motions, self.axis_first) | self._tilts(motions)

    def draw(self, pen: AbstractPen) -> None:
        """Draw a sleeve on a rail."""
        pen.slide(*self.ends(self.axis_first, self.axis_second), turning=True)


class PrismaticJoint(AbstractPairJoint):
    """Allows sliding along an axis of the first body without rotation; five rows.

    **Arguments:**

    - `first`, `second`: names of the bodies; one may be the ground.
    - `point_first`, `point_second`: a point of each body, (3,) m from the centre of mass in body
      axes. The second point stays on the line through the first point along the axis.
    - `axis`: direction of sliding, (3,) in the first body's axes, any length.
    - `orientation`: (4,) Euler parameters, scalar first, that transform components in the second
      body's frame to the first body's frame; parallel frames by default.

    **Raises:** `ValueError` if the bodies are the same, or a point, the axis or the orientation is
    invalid.

    >>> joint = cj.PrismaticJoint("ground", "arm", (0, 0, 0), (0, 0, 0), axis=(1, 0, 0))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['offset 1', 'offset 2', 'rotation x', 'rotation y', 'rotation z']
    """

    axis: Triple = quantity("1", check=require_axis)
    orientation: Quadruple = quantity("1", check=require_euler_parameters, default=PARALLEL)

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return two components of the second point's distance from the axis, m, and three scalar
        products of unit vectors."""
        rotations = self._same_orientation(motions, self.orientation)
        return self._point_on_line(motions, self.axis) | rotations

    def motion_subspace(self, parent: str) -> Slider:
        """Return the subspace of sliding along the axis."""
        # From the child's axes to the parent's: the inverse if the second body is the parent.
        orientation, _ = self._ordered(parent, self.orientation, conjugate(self.orientation))
        axis = unit(self.axis)
        in_second = rotation_matrix(self.orientation).transposed_times(axis)
        _, in_child = self._ordered(parent, axis, in_second)
        return Slider(*self._points(parent), in_child, orientation)

    def draw(self, pen: AbstractPen) -> None:
        """Draw a block on a rail."""
        pen.slide(*self.ends(self.axis), turning=False)


class DistanceJoint(AbstractPairJoint):
    """A massless rod between a point of one body and a point of another; one row.

    The row's Lagrange multiplier is the force in the rod in N, positive in compression.
    `MasslessLink` uses the same constraint for a journal that stays in contact with its bearing.

    **Arguments:**

    - `first`, `second`: names of the bodies; one may be the ground.
    - `point_first`, `point_second`: the end of the rod on each body, (3,) m from the centre of mass
      in body axes.
    - `length`: length of the rod, m, positive.

    **Raises:** `ValueError` if the bodies are the same, a point is invalid, or the length is not
    positive.

    >>> rod = cj.DistanceJoint("ground", "arm", (0, 0, 0), (0.5, 0, 0), length=0.5)
    >>> rows = extend.unpack(rod).rows(motions, 0.0)
    >>> {name: float(row.value) for name, row in rows.items()}
    {'length': 0.0}
    """

    length: Single = quantity("m", shape=(), positive=True, remedy="give the rod's length in m")

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return the row "length": (d^2 - l^2)/(2 l), m, for the distance d of the points and the
        length l of the rod."""
        apart = self._coincidence(motions).values()
        return {"length": distance_row(apart, self.length, motions)}

    def draw(self, pen: AbstractPen) -> None:
        """Draw a rod."""
        pen.rod(*self.ends())


class PointInPlaneJoint(AbstractPairJoint):
    """Keeps a point of the second body in a plane of the first; one constraint row.

    It models a pin in a slot without clearance, with walls parallel to the plane.

    **Arguments:**

    - `first`, `second`: names of the bodies; one may be the ground.
    - `point_first`: a point of the plane, (3,) m from the first body's centre of mass in its axes.
    - `point_second`: the point that stays in the plane, (3,) m from the second body's centre of
      mass in its axes.
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

    It models a slider that slides freely, without clearance, between two walls parallel to the
    plane.

    **Arguments:**

    - `first`, `second`: names of the bodies; one may be the ground.
    - `point_first`: a point of the plane, (3,) m from the first body's centre of mass in its axes.
    - `point_second`: a point of the line, (3,) m from the second body's centre of mass in its axes.
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
"""Coordinates of a planar joint: distances, m, along two axes of the parent in the plane (the
`transverse_axes` of the normal), and the angle about the normal, rad."""


class PlanarMotion(AbstractTurning):
    """Translation by two distances (m) in a plane of the parent, and rotation by an angle (rad).

    It is the motion that a `PlanarJoint` allows a child body relative to its parent body. The
    position consists of the two distances and the angle; the speeds are their rates.

    - `point_parent`, `point_child`: points of the joint, m from each body's centre of mass in its
      axes.
    - `axis`, `normal_parent`: the plane's normal, a unit vector in the axes of the child and in
      those of the parent.
    - `reference`: Euler parameters that transform the child's components to the parent's at angle
      zero.

    The distances are along the two transverse axes of `normal_parent`, unit vectors across it that
    are fixed to the parent. Along axes of the child, the directions of motion would be constant in
    the child's axes, but the distances would oscillate as the child rotates.
    """

    normal_parent: Vector

    def encode(self, relative: Relative) -> JointState:
        """Return the joint coordinates of a relative motion of the child.

        The position consists of the two distances, m, and the angle, rad in [-2 pi, 2 pi], and the
        speeds are their rates.
        """
        # The vectors of `relative` have components in the child's axes, but the distances are along
        # axes of the parent. In these the displacement also changes because the child rotates.
        angle = self.angle(relative)
        rotation = super().rotation(angle)
        apart, spin = relative.displacement, relative.twist.angular
        offset = rotation @ apart
        velocity = rotation @ (relative.twist.linear + spin.cross(apart))
        first, second = transverse_axes(self.normal_parent)
        return JointState(
            (offset.dot(first), offset.dot(second), angle),
            (velocity.dot(first), velocity.dot(second), spin.dot(self.axis)),
        )

    def orientation(self, position: Position) -> EulerParameters:
        """Return Euler parameters that transform the child's components to the parent's."""
        return super().orientation(position[2])

    def rotation(self, position: Position) -> Matrix:
        """Return the matrix that transforms the child's components to the parent's.

        The angle gives it with less arithmetic than the Euler parameters do.
        """
        return super().rotation(position[2])

    def displacement(self, position: Position) -> Vector:
        """Return the vector from the parent's point to the child's, m in the child's axes."""
        return self._in_child(position[:2], position)

    def columns(self, position: Position) -> tuple[Twist, ...]:
        """Return the columns of the motion subspace: the relative twist, in the child's axes, for
        each speed equal to one and the others zero.

        They are translations at 1 m/s along the two transverse axes of the parent's normal, and a
        rotation at 1 rad/s about the normal through the child's point. The linear part of a twist
        is the rate of the components of `displacement` in the child's axes, so that it is not zero
        for the rotation.
        """
        directions = (self._in_child(axis, position) for axis in ((1.0, 0.0), (0.0, 1.0)))
        apart = self.displacement(position)
        # While the child rotates at spin = axis, a displacement that is constant in the parent has
        # the rate -(spin x displacement) in the child's axes.
        rotation = Twist(self.axis, apart.cross(self.axis))
        return (*(Twist(ZERO, direction) for direction in directions), rotation)

    def bias(self, state: JointState) -> Twist:
        """Return the rate of the relative twist at constant speeds, in the child's axes.

        Its unit is rad/s^2 and m/s^2. It isn't zero, because the parent's axes rotate as seen from
        the child.
        """
        first, second, speed = state.speeds
        spin = self.axis * speed
        velocity = self._in_child((first, second), state.position)
        apart = self.displacement(state.position)
        # The twist's linear part is velocity - spin x apart. In the child's axes, the rate of
        # velocity is -(spin x velocity), and the rate of apart is the linear part itself.
        return Twist(ZERO, spin.cross(spin.cross(apart) - velocity * 2.0))

    def without_drift(self, position: Position) -> Position:
        """Return the position with the angle less a multiple of 4 pi, within [-2 pi, 2 pi]."""
        return position[0], position[1], within_two_turns(position[2])

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
    - `point_first`, `point_second`: a point of the plane on each body, (3,) m from the centre of
      mass in body axes.
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
        """Return the subspace of two distances in the plane and an angle about its normal.

        In it the two normals have the same direction. A state with opposite normals satisfies the
        rows too, but can only be simulated in `AbsoluteCoordinates`.
        """
        in_parent, in_child = self._ordered(parent, unit(self.axis_first), unit(self.axis_second))
        return PlanarMotion(
            *self._points(parent), in_child, aligning(in_parent, in_child), in_parent
        )

    def draw(self, pen: AbstractPen) -> None:
        """Draw the plane through the first body's point."""
        pen.plane(*self.ends(self.axis_first, self.axis_second))
