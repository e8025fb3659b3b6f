"""Position and velocity of the journal's two bases in the bearing, and of points between them.

The bases are the circles at the two ends of the journal. Each can touch the bearing's wall.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.polynomial import Legendre

from ..._fields.checks import require
from ..._fields.types import Single
from ..._math.vectors import Scalar, Vector
from ..joints.base import Motions

BASES = ("V", "W")
"""Names of the bases: V at the end of the journal against the direction of its axis, W at the other
end."""
SIDES = (-1.0, 1.0)
"""Signs of the two ends of a journal or bearing: -1 for the end against the direction of its axis,
1 for the end in this direction."""
BETWEEN = "point "
"""Start of the labels "point 2", "point 3" and so on of contacts between the bases."""


@dataclass(frozen=True)
class AxialPoint:
    """A point of a Gauss-Lobatto rule of quadrature along a journal.

    - `position`: on the journal's axis, -1 at base V and 1 at base W.
    - `weight`: share of the journal's length; all weights of a rule add up to 1.
    """

    position: float
    weight: float


@cache
def axial_points(count: int) -> dict[str, AxialPoint]:
    """Return the points of the Gauss-Lobatto rule with `count` points, 2 or more, by the contact's
    label: "V", "point 2", "point 3" and so on, and "W".
    """
    # The rule includes the ends: the eccentricity of a straight axis is largest at an end, so that
    # no contact is missed. The other points are the extrema of the Legendre polynomial.
    polynomial = Legendre.basis(count - 1)
    positions = np.array([-1.0, *polynomial.deriv().roots(), 1.0])
    # The rule is symmetric, which rounding of the roots must not change.
    positions = 0.5 * (positions - positions[::-1])
    # Half of the usual weights, which add up to 2, the length of the interval from -1 to 1.
    weights = 1.0 / (count * (count - 1) * polynomial(positions) ** 2)
    labels = (BASES[0], *(f"{BETWEEN}{k}" for k in range(2, count)), BASES[1])
    numbers = zip(positions.tolist(), weights.tolist(), strict=True)
    return {label: AxialPoint(*pair) for label, pair in zip(labels, numbers, strict=True)}


def axial_positions(labels: Iterable[str]) -> dict[str, float]:
    """Return the position of each contact of a joint on the journal's axis, by label: -1 for base
    V, 1 for base W, and a number between -1 and 1 for a point between the bases.

    **Arguments:** `labels`: of all contacts of the joint. Those that are not on the journal's axis,
    such as shoulders, are left out; without a journal the result is empty.
    """
    on_axis = [label for label in labels if label in BASES or label.startswith(BETWEEN)]
    points = axial_points(len(on_axis)) if len(on_axis) >= len(BASES) else {}
    return {label: point.position for label, point in points.items()}


def require_bases_only(argument: str, name: str, labels: Iterable[str]) -> None:
    """Check that the journal of the joint `name` has no contacts between its bases. Models of wear
    need this, because they know the two bases only.

    **Arguments:** `argument`: name of the argument in the message. `labels`: of all contacts of the
    joint.

    **Raises:** `ValueError`, which names `argument` and the joint, if there are such contacts.
    """
    between = sorted(axial_positions(labels).keys() - {*BASES})
    reason = "wear along the axis is not resolved"
    expected = f"a joint whose journal touches at its bases, not at {between} too ({reason})"
    require(not between, argument, name, expected, "give the joint no `line_points`")


@runtime_checkable
class HasJournal(Protocol):
    """Interface of a joint with a journal in a bearing.

    Between circular surfaces, a base touches the wall when the distance of its centre from the
    bearing's axis equals the radial clearance.

    Functions that need the journal's offset test by ``isinstance`` whether a joint has a journal,
    so that they accept joints of several classes, dry and lubricated.
    """

    @property
    def clearance(self) -> Single:
        """Radial clearance, m."""
        ...

    def journal_offset(self, motions: Motions, base: str | None = None) -> Vector:
        """Return the vector from the bearing's centre to the journal's centre or to a base, m.

        Components are in the bearing's frame: x and y along the `transverse_axes` of the bearing's
        axis, z along this axis. `motions` has the motion of each body by name. `base` is "V" or
        "W", or ``None`` for the journal's centre.
        """
        ...


@dataclass(frozen=True)
class JournalBase:
    """Position and velocity of one base of the journal, or of a point between the bases, relative
    to the bearing.

    Below, "base" stands for this point too.

    - `axis`: of the bearing, a global unit vector.
    - `height`: of the base above the bearing's centre along the axis, m.
    - `centre`: from the bearing's axis to the journal's centre, perpendicular to the axis, m in
      global axes.
    - `arm`: component, perpendicular to the axis, of the vector from the journal's centre to the
      base, m in global axes. The eccentricity vector of the base is ``centre + arm``.
    - `local`: the base's centre, from the centre of mass of the journal's body, m in its axes.
    - `on_bearing`: the point of the bearing's body at the base's centre, from that body's centre of
      mass, m in its axes.
    - `velocity`: of the base's centre relative to the point `on_bearing`, m/s in global axes.
    """

    axis: Vector
    height: Scalar
    centre: Vector
    arm: Vector
    local: Vector
    on_bearing: Vector
    velocity: Vector
