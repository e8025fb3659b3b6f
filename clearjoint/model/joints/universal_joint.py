"""The universal joint."""

import equinox as eqx

from ...fields.checks import require_axis, require_point
from ...fields.declarations import quantity
from ...fields.types import Triple
from ...math.rotations import unit
from ...math.vectors import Scalar
from ..pen import AbstractPen
from .base import Motions, Row
from .ideal import AbstractPairJoint
from .universal_motion import UniversalMotion


class UniversalJoint(AbstractPairJoint):
    r"""A Hooke's or Cardan joint: points coincide, and an axis of each body, an arm of a cross
    without mass, keeps at a right angle to that of the other; four rows.

    $$\frac{\omega_2}{\omega_1} = \frac{\cos \beta}{1 - \sin^2 \beta \cos^2 \theta}$$

    Between two shafts whose axes have the angle b, the speed of the second over that of the first
    is cos b / (1 - sin^2 b cos^2 th), where th is the first shaft's angle from where its arm lies
    in the plane of the shafts (C. E. Wilson, J. P. Sadler, Kinematics and Dynamics of Machinery,
    1993).

    **Arguments:** as `SphericalJoint`, and `axis_first`, `axis_second`: the arms of the cross, each
    (3,) in the axes of its body, any length.

    **Raises:** `ValueError` for points and axes that no joint can have.

    >>> still = testing.moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> motions = {"ground": still, "arm": still}
    >>> joint = cj.UniversalJoint("ground", "arm", (0, 0, 0), (0, 0, 0), (0, 0, 1), (1, 0, 0))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['translation x', 'translation y', 'translation z', 'cross']
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    point_first: Triple = quantity("m", check=require_point)
    point_second: Triple = quantity("m", check=require_point)
    axis_first: Triple = quantity("1", check=require_axis)
    axis_second: Triple = quantity("1", check=require_axis)

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Three translations, m, and the cosine of the angle between the arms."""
        del t
        arms = self._perpendicular(motions, unit(self.axis_first), unit(self.axis_second))
        return self._coincidence(motions) | {"cross": arms}

    def motion_subspace(self, parent: str) -> UniversalMotion:
        """The bodies turn about the two arms of the cross."""
        points = self._ordered(parent, self.point_first, self.point_second)
        arms = self._ordered(parent, unit(self.axis_first), unit(self.axis_second))
        return UniversalMotion(*points, *arms)

    def draw(self, pen: AbstractPen) -> None:
        """A cross."""
        pen.cross(*self.ends(self.axis_first, self.axis_second))
