"""Ideal joints that hold a point or a line of one body in a plane of another.

They model a pin in a slot and a slider in a guide without clearance. Other joints of the mechanism
have to hold the bodies perpendicular to the plane of motion.
"""

from ...fields.checks import require_axis
from ...fields.declarations import quantity
from ...fields.types import Triple
from ...math.rotations import unit
from ...math.vectors import Scalar
from ..pen import AbstractPen
from .base import Motions, Row
from .constraint_rows import point_in_plane
from .ideal import AbstractPairJoint


class PointInPlaneJoint(AbstractPairJoint):
    """Keeps a point of the second body in a plane of the first; one row.

    It models a pin in a slot without clearance, with walls parallel to the plane.

    **Arguments:**

    - `first`, `second`: names of the bodies; one may be the ground.
    - `point_first`: a point of the plane, (3,) m in the first body's axes.
    - `point_second`: the point that stays in the plane, (3,) m in the second body's axes.
    - `normal`: normal of the plane, (3,) in the first body's axes, any length.

    >>> still = testing.moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> motions = {"ground": still, "arm": still}
    >>> joint = cj.PointInPlaneJoint("ground", "arm", (0, 0, 0), (0, 0.1, 0), normal=(0, 1, 0))
    >>> rows = extend.unpack(joint).rows(motions, 0.0)
    >>> {name: float(row.value) for name, row in rows.items()}  # m off the plane
    {'height': 0.1}
    """

    normal: Triple = quantity("1", check=require_axis)

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return one row: the height of the second body's point above the plane, m."""
        del t
        return {"height": _height(self, motions)}

    def draw(self, pen: AbstractPen) -> None:
        """Draw the plane."""
        pen.plane(*self.ends(self.normal))


class LineInPlaneJoint(AbstractPairJoint):
    """Keeps a line of the second body in a plane of the first; two rows.

    It models a slider between two walls without clearance, which slides freely along them.

    **Arguments:**

    - `first`, `second`: names of the bodies; one may be the ground.
    - `point_first`: a point of the plane, (3,) m in the first body's axes.
    - `point_second`: a point of the line, (3,) m in the second body's axes.
    - `normal`: normal of the plane, (3,) in the first body's axes, any length.
    - `axis`: direction of the line, (3,) in the second body's axes, any length.

    >>> still = testing.moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> motions = {"ground": still, "arm": still}
    >>> points = (0, 0, 0), (0, 0, 0)
    >>> joint = cj.LineInPlaneJoint("ground", "arm", *points, normal=(0, 1, 0), axis=(1, 0, 0))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['height', 'tilt']
    """

    normal: Triple = quantity("1", check=require_axis)
    axis: Triple = quantity("1", check=require_axis)

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return two rows: the height of the second body's point above the plane, m; and the tilt.

        The tilt is the sine of the angle between the line and the plane.
        """
        del t
        tilt = self._perpendicular(motions, unit(self.normal), unit(self.axis))
        return {"height": _height(self, motions), "tilt": tilt}

    def draw(self, pen: AbstractPen) -> None:
        """Draw the plane through the first body's point."""
        pen.plane(*self.ends(self.normal))


def _height(joint: PointInPlaneJoint | LineInPlaneJoint, motions: Motions) -> Row:
    names = joint.first, joint.second
    first, second = (motions[name] for name in names)
    normal = unit(joint.normal)
    return point_in_plane(names, first, second, joint.point_first, normal, joint.point_second)
