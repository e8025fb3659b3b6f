"""Clearance modelled as a massless link: the journal stays in contact with the wall."""

import equinox as eqx
from typing_extensions import override

from ..._fields.checks import require, require_axis, require_point
from ..._fields.objects import quantity
from ..._fields.types import Single, Triple
from ..._math.rotations import transverse_axes, unit
from ..._math.vectors import Scalar, Vector
from ..contact.laws import require_instance
from ..joints.base import AbstractConstraint, Motions, Row, require_distinct
from ..joints.constraint_rows import distance_row, point_in_plane
from ..pen import AbstractPen, Marker
from .clearance import AbstractAxialPolicy, FreeAxially
from .journal_bases import BASES


class MasslessLink(AbstractConstraint):
    """A `ClearanceJoint` in permanent contact: the eccentricity of both bases equals the clearance.

    At each base (end of the journal) the eccentricity vector acts as a massless rod between the
    axes, which is one constraint (S. W. E. Earles, C. L. S. Wu 1973; R. S. Haines 1985). There are
    no impacts and no separation. The wall pushes the journal towards the bearing's axis, as a rod
    in tension does. At a positive Lagrange multiplier, a rod in compression, the journal would
    leave the wall, and the model is invalid.

    **Arguments:**

    - `bearing_body`, `journal_body`: names of the bodies; one may be the ground.
    - `clearance`: radius of the bearing less that of the journal, m.
    - `journal_length`: distance between the bases, m.
    - `bearing_point`, `journal_point`: centres of bearing and journal, (3,) m from each body's
      centre of mass in its axes; on the ground from the origin. `bearing_axis`, `journal_axis`:
      axes of bearing and journal, (3,) in each body's axes, any length.
    - `axial`: `FreeAxially()`, the default, or `FixedAxially()`.

    The journal must start at the wall: call `assemble`, which corrects initial states, with a state
    in which the journal is displaced towards the intended side of the bearing.

    **Raises:** `ValueError` if a value is outside its range, both bodies are the same, or `axial`
    is of another class or has shoulders.

    >>> link = cj.MasslessLink("ground", "arm", clearance=0.5e-3, journal_length=20e-3)
    >>> link.body_names(), float(link.clearance)
    (('ground', 'arm'), 0.0005)
    """

    bearing_body: str = eqx.field(static=True)
    journal_body: str = eqx.field(static=True)
    clearance: Single = quantity("m", positive=True, remedy="give the radial clearance in m")
    journal_length: Single = quantity("m", positive=True, remedy="give the distance of the bases")
    bearing_point: Triple = quantity("m", check=require_point, default=(0.0, 0.0, 0.0))
    bearing_axis: Triple = quantity("1", check=require_axis, default=(0.0, 0.0, 1.0))
    journal_point: Triple = quantity("m", check=require_point, default=(0.0, 0.0, 0.0))
    journal_axis: Triple = quantity("1", check=require_axis, default=(0.0, 0.0, 1.0))
    axial: AbstractAxialPolicy = eqx.field(default_factory=FreeAxially)
    point_fields = {"bearing_point": "bearing_body", "journal_point": "journal_body"}

    @override
    def __check_init__(self):
        require_distinct(self.bearing_body, self.journal_body)
        require_instance("axial", self.axial, AbstractAxialPolicy)
        has_none, expected = self.axial.shoulder_law() is None, "FreeAxially() or FixedAxially()"
        remedy = "use a ClearanceJoint for shoulders, which are contacts"
        require(has_none, "axial", type(self.axial).__name__, expected, remedy)

    @override
    def body_names(self) -> tuple[str, ...]:
        return self.bearing_body, self.journal_body

    @override
    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return the rows (e^2 - c^2)/(2 c), m, of the bases' eccentricities e and clearance c."""
        names = self.bearing_body, self.journal_body
        bearing, journal = (motions[name] for name in names)

        # The coordinate of a point of the journal along a direction of the bearing's body, measured
        # from the bearing's centre.
        def coordinate(direction: Vector, local: Vector) -> Row:
            return point_in_plane(names, bearing, journal, self.bearing_point, direction, local)

        axis, half = unit(self.bearing_axis), unit(self.journal_axis) * (0.5 * self.journal_length)
        ends = self.journal_point - half, self.journal_point + half
        rows = {}
        for base, end in zip(BASES, ends, strict=True):
            across = [coordinate(direction, end) for direction in transverse_axes(axis)]
            rows[base] = distance_row(across, self.clearance, motions)
        if self.axial.holds_centre:
            rows["axial"] = coordinate(axis, self.journal_point)
        return rows

    @override
    def draw(self, pen: AbstractPen) -> None:
        pen.bearing(
            Marker(self.bearing_body, self.bearing_point, self.bearing_axis),
            Marker(self.journal_body, self.journal_point, self.journal_axis),
            radius=None,
            clearance=self.clearance,
            length=self.journal_length,
        )
