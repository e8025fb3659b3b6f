"""The surfaces of a bearing that a base of the journal may touch: its wall, and its shoulders."""

from dataclasses import dataclass

from ...math.rotations import unit
from ...math.smoothing import norm_and_direction
from ...math.vectors import Scalar, Vector, add, subtract
from ..bodies import Motion
from ..contact.gap import Gap, slip_velocity
from ..joints.base import Contact
from .axial import AbstractAxialPolicy
from .journal_bases import JournalBase

SHOULDERS = ("lower shoulder", "upper shoulder")
"""At the ends of the bearing: against its axis, and along it."""


@dataclass(frozen=True)
class BearingWall:
    """A cylinder about a bearing's axis.

    `centre`, m, and `axis`, of any length, are in the bearing's body axes; `radius` and radial
    `clearance` in m.
    """

    centre: Vector
    axis: Vector
    radius: Scalar
    clearance: Scalar

    def contact(
        self, bearing: Motion, journal: Motion, base: JournalBase, has_friction: bool
    ) -> Contact:
        """Contact of a base with the wall, from the eccentricity vector (eqs 10-21)."""
        eccentricity, normal = norm_and_direction(base.centre + base.reach)
        depth = self._depth(base, eccentricity)
        gap = Gap(depth, base.velocity.dot(normal), self.radius, self.clearance)
        along = base.axis * base.height
        # Friction acts on both bodies at one point between the surfaces: at the points of eqs
        # (15)-(16), a penetration apart, it would leave a moment.
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
        """Eccentricity less clearance, by the difference of their squares.

        Subtracting the two themselves leaves each base a rounding of its own, from which impacts
        grow a misalignment. Here what rounds most is common to both.
        """
        common = base.centre.dot(base.centre) - self.clearance * self.clearance
        own = base.reach.dot(base.centre * 2.0 + base.reach)
        return (common + own) / (eccentricity + self.clearance)


def shoulder_contact(
    axial: AbstractAxialPolicy, journal_length: Scalar, side: float, base: JournalBase
) -> Contact:
    """Contact of a base with the shoulder at one end of the bearing, that on the `side` against the
    bearing's axis, -1, or along it, 1; `journal_length` in m."""
    outward = base.axis * side
    offset = side * base.height - 0.5 * journal_length
    gap = axial.shoulder_gap(side, offset, base.velocity.dot(outward))
    return Contact(gap, outward, base.on_bearing, base.local, None)
