"""Ideal joints as constraints: spherical (eq. 25), revolute (eq. 26), fixed, and sliding ones."""

from typing import TypeVar

import equinox as eqx

from ...fields.checks import require_axis, require_euler_parameters, require_point
from ...fields.declarations import quantity
from ...fields.types import Quadruple, Triple
from ...math.rotations import conjugate, rotation_matrix, transverse_axes, unit
from ...math.vectors import UNIT_X, UNIT_Y, UNIT_Z, EulerParameters, Scalar, Vector
from ..pen import AbstractPen
from .base import AbstractConstraint, Motions, Row
from .constraint_rows import (
    coincident_points,
    perpendicular,
    point_in_plane,
    turning_about_axes,
)
from .motion_subspaces import Ball, Hinge, Slider, Weld, aligning
from .pairs import AbstractPairAtPoints

T = TypeVar("T")


class AbstractPairJoint(AbstractPairAtPoints, AbstractConstraint):
    """An ideal joint between two bodies at a point of each."""

    def _ordered(self, parent: str, of_first: T, of_second: T) -> tuple[T, T]:
        """What belongs to the first and the second body, the parent's before the child's."""
        return (of_first, of_second) if parent == self.first else (of_second, of_first)

    def _coincidence(self, motions: Motions) -> dict[str, Row]:
        first, second = motions[self.first], motions[self.second]
        return coincident_points(
            (self.first, self.second), first, second, self.point_first, self.point_second
        )

    def _perpendicular(self, motions: Motions, a: Vector, b: Vector) -> Row:
        names = (self.first, self.second)
        return perpendicular(names, motions[self.first], motions[self.second], a, b)

    def _point_on_line(self, motions: Motions, axis: Vector) -> dict[str, Row]:
        names, pair = (self.first, self.second), (motions[self.first], motions[self.second])
        across = transverse_axes(unit(axis))
        return {
            label: point_in_plane(names, *pair, self.point_first, normal, self.point_second)
            for label, normal in zip(("offset 1", "offset 2"), across, strict=True)
        }

    def _same_orientation(self, motions: Motions, orientation: EulerParameters) -> dict[str, Row]:
        relative = rotation_matrix(orientation)
        return {
            label: self._perpendicular(motions, a, relative.transposed_times(b))
            for label, a, b in (
                ("rotation x", UNIT_Y, UNIT_Z),
                ("rotation y", UNIT_Z, UNIT_X),
                ("rotation z", UNIT_X, UNIT_Y),
            )
        }


class AbstractAxisJoint(AbstractPairJoint):
    """An ideal joint that keeps an axis of each body parallel."""

    axis_first: eqx.AbstractVar[Triple]
    axis_second: eqx.AbstractVar[Triple]

    def _tilts(self, motions: Motions) -> dict[str, Row]:
        """Two rows that keep the first body's axis at a right angle to two directions across the
        second's."""
        across = transverse_axes(unit(self.axis_second))
        return {
            label: self._perpendicular(motions, unit(self.axis_first), direction)
            for label, direction in zip(("tilt 1", "tilt 2"), across, strict=True)
        }

    def relative_angle(self, motions: Motions) -> Row:
        """The angle in rad, within (-pi, pi], as a row."""
        names = (self.first, self.second)
        first, second = motions[self.first], motions[self.second]
        return turning_about_axes(names, first, second, self.axis_first, self.axis_second)


class SphericalJoint(AbstractPairJoint):
    """A point of each body coincide; three rows (eq. 25).

    **Arguments:** names of the bodies, and the joint's point on each, (3,) m in body axes.

    >>> still = testing.moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> motions = {"ground": still, "arm": still}
    >>> joint = cj.SphericalJoint("ground", "arm", (0, 0, 0), (-0.5, 0, 0))
    >>> rows = extend.unpack(joint).rows(motions, 0.0)
    >>> {name: float(row.value) for name, row in rows.items()}  # m, by which the points are apart
    {'translation x': 0.5, 'translation y': 0.0, 'translation z': 0.0}
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    point_first: Triple = quantity("m", check=require_point)
    point_second: Triple = quantity("m", check=require_point)

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Three translations that are held, in m."""
        del t
        return self._coincidence(motions)

    def motion_subspace(self, parent: str) -> Ball:
        """The second body turns freely about the joint's point."""
        return Ball(*self._ordered(parent, self.point_first, self.point_second))

    def draw(self, pen: AbstractPen) -> None:
        """A ball."""
        pen.ball(*self.ends())


class RevoluteJoint(AbstractAxisJoint):
    """Points coincide and axes stay parallel; five rows.

    The cross product of eq. (26) has three rows of rank two. Here the first body's axis is kept at
    a right angle to two directions across the second body's axis: independent in every orientation.

    **Arguments:** as `SphericalJoint`, and the axis on each body, (3,) in body axes, any length.

    >>> still = testing.moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> motions = {"ground": still, "arm": still}
    >>> joint = cj.RevoluteJoint("ground", "arm", (0, 0, 0), (0, 0, 0), (0, 0, 1), (0, 0, 1))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['translation x', 'translation y', 'translation z', 'tilt 1', 'tilt 2']
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    point_first: Triple = quantity("m", check=require_point)
    point_second: Triple = quantity("m", check=require_point)
    axis_first: Triple = quantity("1", check=require_axis)
    axis_second: Triple = quantity("1", check=require_axis)

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Three translations and two tilts."""
        del t
        return self._coincidence(motions) | self._tilts(motions)

    def motion_subspace(self, parent: str) -> Hinge:
        """The second body turns about the axis."""
        points = self._ordered(parent, self.point_first, self.point_second)
        there, here = self._ordered(parent, unit(self.axis_first), unit(self.axis_second))
        return Hinge(*points, here, aligning(there, here))

    def draw(self, pen: AbstractPen) -> None:
        """A pin."""
        pen.pin(*self.ends(self.axis_first, self.axis_second))


class FixedJoint(AbstractPairJoint):
    """Two bodies that move as one; six rows.

    **Arguments:** as `SphericalJoint`, and `orientation`: (4,) Euler parameters, scalar first, that
    turn components in the second body's frame into the first body's; parallel frames by default.

    >>> still = testing.moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> motions = {"ground": still, "arm": still}
    >>> joint = cj.FixedJoint("ground", "arm", (0, 0, 0), (0, 0, 0))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['translation x', 'translation y', 'translation z', 'rotation x', 'rotation y', 'rotation z']
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    point_first: Triple = quantity("m", check=require_point)
    point_second: Triple = quantity("m", check=require_point)
    orientation: Quadruple = quantity(
        "1", check=require_euler_parameters, default=(1.0, 0.0, 0.0, 0.0)
    )

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Three translations and three rotations."""
        del t
        return self._coincidence(motions) | self._same_orientation(motions, self.orientation)

    def motion_subspace(self, parent: str) -> Weld:
        """No motion at all: the bodies are one."""
        points = self._ordered(parent, self.point_first, self.point_second)
        turn, _ = self._ordered(parent, self.orientation, conjugate(self.orientation))
        return Weld(*points, turn)

    def draw(self, pen: AbstractPen) -> None:
        """A weld."""
        pen.weld(*self.ends())


class InlineJoint(AbstractPairJoint):
    """A point of the second body stays on a line of the first; two rows.

    **Arguments:** as `SphericalJoint`, and the line's `axis` on the first body, (3,) in its axes,
    any length. With the axis across a planar mechanism it is a pin that adds no redundant
    constraint to those that already hold the bodies in the plane.

    >>> still = testing.moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> motions = {"ground": still, "arm": still}
    >>> joint = cj.InlineJoint("ground", "arm", (0, 0, 0), (0, 0, 0), axis=(1, 0, 0))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['offset 1', 'offset 2']
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    point_first: Triple = quantity("m", check=require_point)
    point_second: Triple = quantity("m", check=require_point)
    axis: Triple = quantity("1", check=require_axis)

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Two translations across the line."""
        del t
        return self._point_on_line(motions, self.axis)

    def draw(self, pen: AbstractPen) -> None:
        """A sleeve on a rail."""
        pen.slide(*self.ends(self.axis), turning=True)


class CylindricalJoint(AbstractAxisJoint):
    """Bodies that turn about a common axis and slide along it; four rows.

    **Arguments:** as `RevoluteJoint`.

    >>> still = testing.moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> motions = {"ground": still, "arm": still}
    >>> joint = cj.CylindricalJoint("ground", "arm", (0, 0, 0), (0, 0, 0), (0, 0, 1), (0, 0, 1))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['offset 1', 'offset 2', 'tilt 1', 'tilt 2']
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    point_first: Triple = quantity("m", check=require_point)
    point_second: Triple = quantity("m", check=require_point)
    axis_first: Triple = quantity("1", check=require_axis)
    axis_second: Triple = quantity("1", check=require_axis)

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Two translations and two tilts."""
        del t
        return self._point_on_line(motions, self.axis_first) | self._tilts(motions)

    def draw(self, pen: AbstractPen) -> None:
        """A sleeve on a rail."""
        pen.slide(*self.ends(self.axis_first, self.axis_second), turning=True)


class PrismaticJoint(AbstractPairJoint):
    """The second body slides along an axis of the first without turning; five rows.

    **Arguments:** as `FixedJoint`, and the `axis` on the first body, (3,) in its axes, any length;
    the joint's point on the second body stays on the line along it through that on the first.

    >>> still = testing.moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> motions = {"ground": still, "arm": still}
    >>> joint = cj.PrismaticJoint("ground", "arm", (0, 0, 0), (0, 0, 0), axis=(1, 0, 0))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['offset 1', 'offset 2', 'rotation x', 'rotation y', 'rotation z']
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    point_first: Triple = quantity("m", check=require_point)
    point_second: Triple = quantity("m", check=require_point)
    axis: Triple = quantity("1", check=require_axis)
    orientation: Quadruple = quantity(
        "1", check=require_euler_parameters, default=(1.0, 0.0, 0.0, 0.0)
    )

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Two translations across the axis and three rotations."""
        del t
        held = self._same_orientation(motions, self.orientation)
        return self._point_on_line(motions, self.axis) | held

    def motion_subspace(self, parent: str) -> Slider:
        """The second body slides along the axis."""
        points = self._ordered(parent, self.point_first, self.point_second)
        turn, _ = self._ordered(parent, self.orientation, conjugate(self.orientation))
        axis = unit(self.axis)
        in_second = rotation_matrix(self.orientation).transposed_times(axis)
        _, here = self._ordered(parent, axis, in_second)
        return Slider(*points, here, turn)

    def draw(self, pen: AbstractPen) -> None:
        """A block on a rail."""
        pen.slide(*self.ends(self.axis), turning=False)
