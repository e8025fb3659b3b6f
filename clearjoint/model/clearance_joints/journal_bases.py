"""The two bases of a journal: where they are in the bearing, and how they move there."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from ...fields.types import Single
from ...math.functions import where
from ...math.vectors import Scalar, Vector
from ..bodies import Motion
from ..joints.base import Motions

BASES = ("V", "W")
"""A base is at each end of the journal: against the journal's axis, and along it."""
SIDES = (-1.0, 1.0)
"""Signs of the two ends, of a journal or of a bearing: against its axis, and along it."""


@runtime_checkable
class HasJournal(Protocol):
    """A joint with a journal whose bases touch a wall at the radial clearance, m."""

    @property
    def clearance(self) -> Single:
        """Radial, m."""
        ...

    def journal_offset(self, motions: Motions, base: str | None = None) -> Vector:
        """From the bearing's centre to the journal's, or to that of a base, m, in the bearing's
        frame."""
        ...


@dataclass(frozen=True)
class JournalBase:
    """Where a base is, in m, and how it moves.

    `local` is its centre in the journal's body axes. Along the bearing's `axis`, a global unit
    vector, it is at a `height` from the bearing's centre; across it, the journal's `centre` and the
    `onset_offset` from there lead to it. There is the point `on_bearing` of the bearing, in that
    body's axes; `velocity`, m/s, is relative to that point.
    """

    axis: Vector
    height: Scalar
    centre: Vector
    reach: Vector
    local: Vector
    on_bearing: Vector
    velocity: Vector


class JournalBases:
    """The bases of a journal in its bearing at a configuration.

    **Arguments:**

    - `bearing`, `journal`: motions of the two bodies.
    - `bearing_point`, `journal_point`: their centres, m, in body axes.
    - `axis`: of the bearing, a global unit vector.
    - `half`: from the journal's centre to its base W, m, in the journal's body axes.
    - `centre`: from the bearing's centre to the journal's, m, global (eq. 8).
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
        self._turning = journal.direction(journal.spin.cross(half))
        self._middle = journal.velocity_at(journal_point)

    def at(self, sign: Scalar) -> JournalBase:
        """Base V for -1, base W for 1."""
        local, reach = self._journal_point + self._half * sign, self._arm * sign
        offset = self._centre + reach
        on_bearing = self._bearing_point + self._bearing.components(offset)
        moving = self._middle + self._turning * sign
        velocity = moving - self._bearing.velocity_at(on_bearing)
        across = _across(self._centre, self._axis), _across(reach, self._axis)
        height = offset.dot(self._axis)
        return JournalBase(self._axis, height, *across, local, on_bearing, velocity)

    def facing(self) -> Scalar:
        """1 where the journal's axis points along the bearing's, -1 where against it."""
        return where(self._arm.dot(self._axis) < 0.0, -1.0, 1.0)


def _across(vector: Vector, axis: Vector) -> Vector:
    """The part of a vector at a right angle to an axis."""
    return vector - axis * vector.dot(axis)
