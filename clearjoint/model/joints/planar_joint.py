"""The planar joint."""

import equinox as eqx

from ...fields.checks import require_axis, require_point
from ...fields.declarations import quantity
from ...fields.types import Triple
from ...math.rotations import unit
from ...math.vectors import Scalar
from ..pen import AbstractPen
from .base import Motions, Row
from .constraint_rows import point_in_plane
from .ideal import AbstractAxisJoint
from .motion_subspaces import aligning
from .planar_motion import PlanarMotion


class PlanarJoint(AbstractAxisJoint):
    """A body that slides on a plane of another and turns about its normal, as a plate on a table;
    three rows.

    **Arguments:** as `SphericalJoint`, and `axis_first`, `axis_second`: the plane's normal, (3,) in
    the axes of each body, any length. The plane goes through the point of each body.

    **Raises:** `ValueError` for points and axes that no joint can have.

    >>> still = testing.moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> motions = {"ground": still, "arm": still}
    >>> joint = cj.PlanarJoint("ground", "arm", (0, 0, 0), (0, 0, 0), (0, 0, 1), (0, 0, 1))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['height', 'tilt 1', 'tilt 2']
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    point_first: Triple = quantity("m", check=require_point)
    point_second: Triple = quantity("m", check=require_point)
    axis_first: Triple = quantity("1", check=require_axis)
    axis_second: Triple = quantity("1", check=require_axis)

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """The height above the plane, m, and two tilts."""
        del t
        names, pair = (self.first, self.second), (motions[self.first], motions[self.second])
        normal = unit(self.axis_first)
        height = point_in_plane(names, *pair, self.point_first, normal, self.point_second)
        return {"height": height} | self._tilts(motions)

    def motion_subspace(self, parent: str) -> PlanarMotion:
        """The second body slides along the plane and turns about its normal."""
        points = self._ordered(parent, self.point_first, self.point_second)
        there, here = self._ordered(parent, unit(self.axis_first), unit(self.axis_second))
        return PlanarMotion(*points, there, here, aligning(there, here))

    def draw(self, pen: AbstractPen) -> None:
        """A plane."""
        pen.plane(*self.ends(self.axis_first, self.axis_second))
