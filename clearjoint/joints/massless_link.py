"""The journal that never leaves the wall: clearance as a massless link."""

from typing import Any

import equinox as eqx

from ..fields import quantity, require, require_axis, require_point, require_positive
from ..rotations import unit
from ..vectors import Scalar, Vector
from .axial import AbstractAxialPolicy, FixedAxially, FreeAxially
from .base import AbstractConstraint, Motions, Row
from .clearance import BASES
from .ideal import require_distinct
from .primitives import Pose, point_in_plane, rows_from_residual


class MasslessLink(AbstractConstraint):
    """A `ClearanceJoint` in continuous contact: both bases at the distance of the clearance.

    Two rows. The eccentricity vector is then a rod without mass between the axes (S. W. E. Earles,
    C. L. S. Wu 1973; R. S. Haines 1985). There are no impacts, and the wall holds the journal where
    it would have parted: a reaction that pulls tells that the model fails there.

    **Arguments:** as of `ClearanceJoint`; `axial` is `FreeAxially()`, the default, or
    `FixedAxially()`. The journal must start at the wall: call `assemble` on a state in which it is
    nearer to the side meant.

    **Raises:** `ValueError` for values that no joint can have.
    """

    bearing_body: str = eqx.field(static=True)
    journal_body: str = eqx.field(static=True)
    clearance: Any = quantity("m")
    journal_length: Any = quantity("m")
    bearing_point: Any = quantity("m", default=(0.0, 0.0, 0.0))
    bearing_axis: Any = quantity("1", default=(0.0, 0.0, 1.0))
    journal_point: Any = quantity("m", default=(0.0, 0.0, 0.0))
    journal_axis: Any = quantity("1", default=(0.0, 0.0, 1.0))
    axial: AbstractAxialPolicy = eqx.field(default_factory=FreeAxially)

    def __check_init__(self):
        require_distinct(self.bearing_body, self.journal_body)
        require_positive("clearance", self.clearance, "give the radial clearance in m")
        require_positive("journal_length", self.journal_length, "give the distance of the bases")
        for name in ("bearing_point", "journal_point"):
            require_point(name, getattr(self, name))
        for name in ("bearing_axis", "journal_axis"):
            require_axis(name, getattr(self, name))
        require(
            isinstance(self.axial, FreeAxially | FixedAxially),
            "axial",
            type(self.axial).__name__,
            "FreeAxially() or FixedAxially()",
            "shoulders are contacts, which a ClearanceJoint has",
        )

    def body_names(self) -> tuple[str, ...]:
        """The bearing's body and the journal's."""
        return self.bearing_body, self.journal_body

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Half the difference of the squares of eccentricity and clearance, over the clearance, of
        each base; and the axial constraint of `FixedAxially`."""
        del t
        names = self.body_names()
        pair = motions[self.bearing_body], motions[self.journal_body]
        rows = rows_from_residual(names, BASES, self._residual, *pair)
        if isinstance(self.axial, FixedAxially):
            ends = self.bearing_point, unit(self.bearing_axis), self.journal_point
            rows["axial"] = point_in_plane(names, *pair, *ends)
        return rows

    def _residual(self, bearing: Pose, journal: Pose) -> list[Scalar]:
        axis = bearing[1] @ unit(self.bearing_axis)
        centre = bearing[0] + bearing[1] @ self.bearing_point
        half = unit(self.journal_axis) * (0.5 * self.journal_length)

        def row(local: Vector) -> Scalar:
            offset = (journal[0] + journal[1] @ local) - centre
            across = offset - axis * offset.dot(axis)
            return 0.5 * (across.dot(across) / self.clearance - self.clearance)

        return [row(self.journal_point - half), row(self.journal_point + half)]
