"""The bases of a journal, and their contacts with the wall and the shoulders of a bearing."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from ...fields.types import Single
from ...math.functions import where
from ...math.rotations import unit
from ...math.smoothing import norm_and_direction
from ...math.vectors import Scalar, Vector, add, subtract
from ..bodies import Motion
from ..contact.gap import Gap, slip_velocity
from ..joints.base import Contact, Motions
from .axial import AbstractAxialPolicy

BASES = ("V", "W")
"""Names of the bases at the lower and the upper end of the journal's axis."""
SIDES = (-1.0, 1.0)
"""Signs of the two ends of a journal or bearing: against its axis, and along it."""


@runtime_checkable
class HasJournal(Protocol):
    """Interface of a joint with a journal whose bases touch the wall at the radial clearance."""

    @property
    def clearance(self) -> Single:
        """Radial clearance, m."""
        ...

    def journal_offset(self, motions: Motions, base: str | None = None) -> Vector:
        """Return the vector from the bearing's centre to the journal's centre or to a base, m.

        Components are in the bearing's frame, whose z axis is the bearing's axis. `base` is "V" or
        "W", or ``None`` for the journal's centre.
        """
        ...


@dataclass(frozen=True)
class JournalBase:
    """Position and velocity of one base of the journal relative to the bearing.

    - `axis`: of the bearing, a global unit vector.
    - `height`: of the base above the bearing's centre along the axis, m.
    - `centre`: from the bearing's axis to the journal's centre, perpendicular to the axis, m in
      global axes.
    - `arm`: from the journal's centre to the base, its part perpendicular to the axis, m in global
      axes. The eccentricity vector of the base is ``centre + arm``.
    - `local`: the base's centre, m in the axes of the journal's body.
    - `on_bearing`: the point of the bearing's body at the base's centre, m in that body's axes.
    - `velocity`: of the base's centre relative to that point, m/s in global axes.
    """

    axis: Vector
    height: Scalar
    centre: Vector
    arm: Vector
    local: Vector
    on_bearing: Vector
    velocity: Vector


class JournalBases:
    """Position and velocity of the two bases of a journal, from the motions of both bodies.

    **Arguments:**

    - `bearing`, `journal`: motions of the two bodies.
    - `bearing_point`, `journal_point`: centre of the bearing and of the journal, m in body axes.
    - `axis`: of the bearing, a global unit vector.
    - `half`: from the journal's centre to base W, m in the axes of the journal's body.
    - `centre`: from the bearing's centre to the journal's, m, global axes (eq. 8).
    """

    def __init__(
        self,
        bearing: Motion,
        journal: Motion,
        bearing_point: Vector,
        journal_point: Vector,
        axis: Vector,
        half: Vector,
        centre: Vector,
    ):
        self._bearing, self._axis, self._centre, self._half = bearing, axis, centre, half
        self._bearing_point, self._journal_point = bearing_point, journal_point
        self._arm = journal.direction(half)
        self._arm_velocity = journal.direction(journal.spin.cross(half))
        self._centre_velocity = journal.velocity_at(journal_point)

    def at(self, sign: Scalar) -> JournalBase:
        """Return position and velocity of base V for a `sign` of -1, of base W for 1."""
        local, arm = self._journal_point + self._half * sign, self._arm * sign
        offset = self._centre + arm
        on_bearing = self._bearing_point + self._bearing.components(offset)
        base_velocity = self._centre_velocity + self._arm_velocity * sign
        velocity = base_velocity - self._bearing.velocity_at(on_bearing)
        across = _across(self._centre, self._axis), _across(arm, self._axis)
        height = offset.dot(self._axis)
        return JournalBase(self._axis, height, *across, local, on_bearing, velocity)

    def facing(self) -> Scalar:
        """Return 1 if the journal's axis points along the bearing's, -1 if it points against it."""
        return where(self._arm.dot(self._axis) < 0.0, -1.0, 1.0)


def _across(vector: Vector, axis: Vector) -> Vector:
    """Return the component of a vector perpendicular to an axis."""
    return vector - axis * vector.dot(axis)


SHOULDERS = ("lower shoulder", "upper shoulder")
"""Contact labels of the shoulders: at the lower and at the upper end of the bearing's axis."""


@dataclass(frozen=True)
class BearingWall:
    """The cylindrical wall of a bearing.

    - `centre`: of the bearing, m in the axes of the bearing's body.
    - `axis`: of the bearing, in the axes of the bearing's body, any length.
    - `radius`: of the bearing, m.
    - `clearance`: radius of the bearing less that of the journal, m.
    """

    centre: Vector
    axis: Vector
    radius: Scalar
    clearance: Scalar

    def contact(
        self, bearing: Motion, journal: Motion, base: JournalBase, has_friction: bool
    ) -> Contact:
        """Return the contact of one base with the wall (Flores et al. 2006, eqs 10-21).

        Vectors are global unless they are points of a body, which are in the body's axes.

        **Arguments:** `bearing`, `journal`: motions of the two bodies. `base`: position and
        velocity of the base. `has_friction`: whether the contact needs a slip.
        """
        # From the bearing's axis to the journal's centre, and from there to the base.
        eccentricity, normal = norm_and_direction(base.centre + base.arm)
        depth = self._depth(base, eccentricity)
        gap = Gap(depth, base.velocity.dot(normal), self.radius, self.clearance)
        along = base.axis * base.height
        # The points of eqs (15)-(16) are a penetration apart, so that friction there would leave a
        # net moment. It acts on both bodies at the point midway between the surfaces.
        shift = 0.5 * gap.depth if has_friction else 0.0
        to_wall = along + normal * add(self.radius, shift)
        on_bearing = self.centre + bearing.components(to_wall)
        on_journal = base.local + journal.components(normal * subtract(gap.journal_radius, shift))
        slip = None
        if has_friction:
            sliding = journal.velocity_at(on_journal) - bearing.velocity_at(on_bearing)
            slip = slip_velocity(sliding, normal, sliding.dot(normal))
        on_axis = self.centre + unit(self.axis) * base.height
        return Contact(gap, normal, on_bearing, on_journal, slip, on_axis, base.local)

    def _depth(self, base: JournalBase, eccentricity: Scalar) -> Scalar:
        """Return the penetration, m: eccentricity minus clearance, from the difference of their
        squares.

        A direct subtraction would round differently at the two bases, and repeated impacts amplify
        the difference to a misalignment. Here the term with the largest rounding error is the same
        for both bases.
        """
        common = base.centre.dot(base.centre) - self.clearance * self.clearance
        difference = base.arm.dot(base.centre * 2.0 + base.arm)
        return (common + difference) / (eccentricity + self.clearance)


def shoulder_contact(
    axial: AbstractAxialPolicy, journal_length: Scalar, side: float, base: JournalBase
) -> Contact:
    """Return the contact of a base with the shoulder at one end of the bearing.

    **Arguments:**

    - `axial`: defines the shoulder's gap.
    - `journal_length`: distance of the journal's bases, m.
    - `side`: -1.0 for the shoulder at the lower end of the bearing's axis, 1.0 for the upper end.
    - `base`: position and velocity of the base that faces this shoulder.
    """
    outward = base.axis * side
    offset = side * base.height - 0.5 * journal_length
    gap = axial.shoulder_gap(side, offset, base.velocity.dot(outward))
    return Contact(gap, outward, base.on_bearing, base.local, None)
