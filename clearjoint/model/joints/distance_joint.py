"""A rod without mass."""

import equinox as eqx

from ...fields.checks import require_point
from ...fields.declarations import quantity
from ...fields.types import Single, Triple
from ...math.vectors import Scalar
from ..pen import AbstractPen
from .base import Motions, Row
from .ideal import AbstractPairJoint
from .row_combinations import distance_row


class DistanceJoint(AbstractPairJoint):
    """A rod without mass between a point of each of two bodies, hinged at both ends; one row.

    The multiplier is the force in the rod in N, positive where it pushes.

    **Arguments:** as `SphericalJoint`, and the rod's `length`, m. `MasslessLink` holds a journal
    at the wall of its bearing in this way.

    **Raises:** `ValueError` for a length that is not positive.

    >>> still = testing.moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> motions = {"ground": still, "arm": still}
    >>> rod = cj.DistanceJoint("ground", "arm", (0, 0, 0), (0.5, 0, 0), length=0.5)
    >>> rows = extend.unpack(rod).rows(motions, 0.0)
    >>> {name: float(row.value) for name, row in rows.items()}
    {'length': 0.0}
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    point_first: Triple = quantity("m", check=require_point)
    point_second: Triple = quantity("m", check=require_point)
    length: Single = quantity("m", shape=(), positive=True, remedy="give the rod's length in m")

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Half the difference of the squares of distance and length, over the length, m."""
        del t
        apart = self._coincidence(motions).values()
        return {"length": distance_row(apart, self.length, motions)}

    def draw(self, pen: AbstractPen) -> None:
        """A rod."""
        pen.rod(*self.ends())
