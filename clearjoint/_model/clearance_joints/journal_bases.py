"""Position and velocity of a journal's bases, the circles at its ends, and of points between."""

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
"""Names of a journal's bases; its axis points from V to W."""
SIDES = (-1.0, 1.0)
"""Signs of the two ends of a journal or bearing: 1 for the end in the direction of its axis."""
BETWEEN = "point "
"""Start of the labels "point 2", "point 3" and so on of contacts between the bases."""


@dataclass(frozen=True)
class AxialPoint:
    """A point of a Gauss-Lobatto rule of quadrature along a journal. `position` is -1 at base V and
    1 at base W, and `weight` the share of the journal's length."""

    position: float
    weight: float


@cache
def axial_points(count: int) -> dict[str, AxialPoint]:
    """Return the points of the Gauss-Lobatto rule with `count` points, 2 or more, by label."""
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
    """Return the position on the journal's axis, -1 at base V to 1 at base W, of each contact with
    the wall, by label. `labels`: of all contacts of a joint; empty for one without a journal."""
    on_axis = [label for label in labels if label in BASES or label.startswith(BETWEEN)]
    points = axial_points(len(on_axis)) if len(on_axis) >= len(BASES) else {}
    return {label: point.position for label, point in points.items()}


def require_bases_only(argument: str, name: str, labels: Iterable[str]) -> None:
    """Raise a `ValueError` if the journal of the joint `name` has contacts between its bases, for
    models of wear that support contacts at the bases only. `labels` are those of all contacts of
    the joint; the message blames `argument`, through which the user chose the joint."""
    between = sorted(axial_positions(labels).keys() - {*BASES})
    reason = "wear along the axis is not resolved"
    expected = f"a joint whose journal touches at its bases, not at {between} too ({reason})"
    require(not between, argument, name, expected, "give the joint no `line_points`")


@runtime_checkable
class HasJournal(Protocol):
    """Interface of a joint with a journal in a bearing, for tests by ``isinstance``."""

    @property
    def clearance(self) -> Single:
        """Radial clearance, m."""
        ...

    def journal_offset(self, motions: Motions, base: str | None = None) -> Vector:
        """Return the vector from the bearing's centre to a base or, for ``None``, to the journal's
        centre, m, in the bearing's frame (see `clearjoint.quantities.JournalOffset`)."""
        ...


@dataclass(frozen=True)
class JournalBase:
    """Position and velocity, relative to the bearing, of the journal's base or a point between.

    - `axis`: of the bearing, a global unit vector.
    - `height`: of the base above the bearing's centre along the axis, m.
    - `centre`: from the axis to the journal's centre, perpendicular to the axis, m, global.
    - `arm`: from the journal's centre to the base, without its component along the axis, m, global.
      The eccentricity vector of the base is ``centre + arm``.
    - `local`, `on_bearing`: the base's centre on the journal's and on the bearing's body, m from
      the centre of mass in body axes.
    - `velocity`: of the base's centre relative to the point `on_bearing`, m/s, global.
    """

    axis: Vector
    height: Scalar
    centre: Vector
    arm: Vector
    local: Vector
    on_bearing: Vector
    velocity: Vector
