"""Contacts of a journal's base with the bearing's wall and shoulders."""

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
"""Contact labels of the shoulders: at the lower and at the upper end of the bearing's axis."""


@dataclass(frozen=True)
class BearingWall:
    """The cylindrical wall of a bearing.

    `centre`, m, and `axis`, of any length, are in the axes of the bearing's body; `radius` and
    radial `clearance` are in m.
    """

    centre: Vector
    axis: Vector
    radius: Scalar
    clearance: Scalar

    def contact(
        self, bearing: Motion, journal: Motion, base: JournalBase, has_friction: bool
    ) -> Contact:
        """Return the contact of a base with the wall, from the eccentricity vector (eqs 10-21)."""
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
        """Return eccentricity minus clearance, from the difference of their squares.

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

    `side` is -1 for the lower end of the bearing's axis and 1 for the upper; `journal_length` is in
    m.
    """
    outward = base.axis * side
    offset = side * base.height - 0.5 * journal_length
    gap = axial.shoulder_gap(side, offset, base.velocity.dot(outward))
    return Contact(gap, outward, base.on_bearing, base.local, None)
