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
