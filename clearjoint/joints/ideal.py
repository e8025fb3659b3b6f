"""Ideal joints as constraints: spherical (eq. 25), revolute (eq. 26) and fixed."""

from typing import Any

import equinox as eqx

from ..fields import (
    quantity,
    require,
    require_axis,
    require_euler_parameters,
    require_point,
)
from ..rotations import conjugate, rotation_matrix, transverse_axes, unit
from ..vectors import UNIT_X, UNIT_Y, UNIT_Z, Scalar, Vector
from .base import AbstractConstraint, Motions, Row
from .freedoms import Ball, Hinge, Weld, aligning
from .primitives import coincident_points, perpendicular


class AbstractPairJoint(AbstractConstraint):
    """An ideal joint between two bodies at a point of each."""

    first: eqx.AbstractVar[str]
    second: eqx.AbstractVar[str]
    point_first: eqx.AbstractVar[Any]
    point_second: eqx.AbstractVar[Any]

    def __check_init__(self):
        require_distinct(self.first, self.second)
        require_point("point_first", self.point_first)
        require_point("point_second", self.point_second)

    def body_names(self) -> tuple[str, ...]:
        """The two bodies."""
        return self.first, self.second

    def _ordered(self, parent: str, of_first: Any, of_second: Any) -> tuple[Any, Any]:
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


def require_distinct(first: str, second: str) -> None:
    """Check that a joint connects two different bodies by name."""
    for argument, name in (("first", first), ("second", second)):
        require(isinstance(name, str), argument, name, "the name of a body", "pass the body's name")
    require(first != second, "second", second, "another body than `first`", "name two bodies")


class SphericalJoint(AbstractPairJoint):
    """A point of each body coincide; three rows (eq. 25).

    **Arguments:** names of the bodies, and the joint's point on each, (3,) m in body axes.
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    point_first: Any = quantity("m")
    point_second: Any = quantity("m")

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Three translations."""
        del t
        return self._coincidence(motions)

    def freedom(self, parent: str) -> Ball:
        """Turning freely."""
        return Ball(*self._ordered(parent, self.point_first, self.point_second))


class RevoluteJoint(AbstractPairJoint):
    """Points coincide and axes stay parallel; five rows.

    The cross product of eq. (26) has three rows of rank two. Here the first body's axis is kept at
    a right angle to two directions across the second body's axis: independent in every orientation.

    **Arguments:** as `SphericalJoint`, and the axis on each body, (3,) in body axes, any length.
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    point_first: Any = quantity("m")
    point_second: Any = quantity("m")
    axis_first: Any = quantity("1")
    axis_second: Any = quantity("1")

    def __check_init__(self):
        require_axis("axis_first", self.axis_first)
        require_axis("axis_second", self.axis_second)

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Three translations and two tilts."""
        del t
        rows = self._coincidence(motions)
        across = transverse_axes(unit(self.axis_second))
        for label, direction in zip(("tilt 1", "tilt 2"), across, strict=True):
            rows[label] = self._perpendicular(motions, unit(self.axis_first), direction)
        return rows

    def freedom(self, parent: str) -> Hinge:
        """Turning about the axis."""
        points = self._ordered(parent, self.point_first, self.point_second)
        there, here = self._ordered(parent, unit(self.axis_first), unit(self.axis_second))
        return Hinge(*points, here, aligning(there, here))


class FixedJoint(AbstractPairJoint):
    """Two bodies that move as one; six rows.

    **Arguments:** as `SphericalJoint`, and `orientation`: (4,) Euler parameters, scalar first, that
    turn components in the second body's frame into the first body's; parallel frames by default.
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    point_first: Any = quantity("m")
    point_second: Any = quantity("m")
    orientation: Any = quantity("1", default=(1.0, 0.0, 0.0, 0.0))

    def __check_init__(self):
        require_euler_parameters("orientation", self.orientation)

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Three translations and three rotations."""
        del t
        rows = self._coincidence(motions)
        relative = rotation_matrix(self.orientation)
        for label, a, b in (
            ("rotation x", UNIT_Y, UNIT_Z),
            ("rotation y", UNIT_Z, UNIT_X),
            ("rotation z", UNIT_X, UNIT_Y),
        ):
            rows[label] = self._perpendicular(motions, a, relative.transposed_times(b))
        return rows

    def freedom(self, parent: str) -> Weld:
        """None."""
        points = self._ordered(parent, self.point_first, self.point_second)
        turn, _ = self._ordered(parent, self.orientation, conjugate(self.orientation))
        return Weld(*points, turn)
