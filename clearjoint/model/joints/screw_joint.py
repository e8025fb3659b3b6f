"""The screw joint."""

import math
from dataclasses import replace

import equinox as eqx

from ...fields.checks import checkable, require, require_axis, require_point, require_shape
from ...fields.declarations import quantity
from ...fields.types import ArrayLike, Single, Triple
from ...math.functions import where, wrapped
from ...math.rotations import unit
from ...math.vectors import EulerParameters, Matrix, Scalar, Vector, add
from ..pen import AbstractPen
from .base import Motions, Row
from .constraint_rows import point_in_plane
from .ideal import AbstractAxisJoint
from .motion_subspaces import AbstractMotionSubspace, Hinge, JointState, Relative, Twist
from .row_combinations import scaled_row, sum_of_rows


class ScrewMotion(AbstractMotionSubspace):
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


def _require_lead(argument: str, value: ArrayLike) -> None:
    """Check a lead to be one number that is not zero."""
    require_shape(argument, value, (), "pass a single number in m")
    if (known := checkable(value)) is not None:
        (number,) = known
        remedy = "give the advance in a turn in m; a RevoluteJoint has none"
        require(number != 0.0, argument, number, "other than zero", remedy)


class ScrewJoint(AbstractAxisJoint):
    r"""A body that advances along an axis of another as it turns about it; five rows.

    $$a = \frac{g}{1 + \frac{J}{m} \left(\frac{2 \pi}{l}\right)^2}$$

    A nut of mass m and moment of inertia J on a screw that stands upright comes down at
    g/(1 + J (2 pi/lead)^2/m). The advance counts modulo the lead, so that the number of turns is
    unlimited: of the positions at an angle the joint holds the nearest.

    **Arguments:** as `RevoluteJoint`, and `lead`: the second body's advance in a turn, m, positive
    of a right-handed thread and negative of a left-handed one. The points coincide where the angle
    is zero: where the bodies' frames differ by the shortest turn between the axes' components.

    **Raises:** `ValueError` for a lead of zero, and for points and axes that no joint can have.

    >>> still = testing.moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> motions = {"ground": still, "arm": still}
    >>> axes = (0, 0, 1), (0, 0, 1)
    >>> joint = cj.ScrewJoint("ground", "arm", (0, 0, 0), (0, 0, 0), *axes, lead=5e-3)
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['offset 1', 'offset 2', 'tilt 1', 'tilt 2', 'thread']
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    point_first: Triple = quantity("m", check=require_point)
    point_second: Triple = quantity("m", check=require_point)
    axis_first: Triple = quantity("1", check=require_axis)
    axis_second: Triple = quantity("1", check=require_axis)
    lead: Single = quantity("m", check=_require_lead)

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Two translations across the axis, two tilts, and the thread: the advance less that by
        the angle, m."""
        del t
        held = self._point_on_line(motions, self.axis_first) | self._tilts(motions)
        return held | {"thread": self._thread(motions)}

    def _thread(self, motions: Motions) -> Row:
        names, pair = (self.first, self.second), (motions[self.first], motions[self.second])
        axis = unit(self.axis_first)
        advance = point_in_plane(names, *pair, self.point_first, axis, self.point_second)
        by_angle = scaled_row(self.relative_angle(motions), self.lead * (-0.5 / math.pi))
        row = sum_of_rows((advance, by_angle))
        return replace(row, value=wrapped(row.value, self.lead))

    def motion_subspace(self, parent: str) -> ScrewMotion:
        """The second body turns about the axis and advances."""
        points = self._ordered(parent, self.point_first, self.point_second)
        axis = unit(self.axis_first)
        there, here = self._ordered(parent, axis, along(unit(self.axis_second), axis))
        pitch = self.lead * (0.5 / math.pi)
        return ScrewMotion(*points, here, shortest_turn(there, here), pitch)

    def draw(self, pen: AbstractPen) -> None:
        """A sleeve on a rail."""
        pen.slide(*self.ends(self.axis_first, self.axis_second), turning=True)
