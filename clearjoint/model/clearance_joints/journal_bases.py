"""Position and velocity of the journal's two bases in the bearing."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from ...fields.types import Single
from ...math.functions import where
from ...math.vectors import Scalar, Vector
from ..bodies import Motion
from ..joints.base import Motions

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
