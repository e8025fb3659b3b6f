"""Film of a bearing of finite width."""

import math
from collections.abc import Sequence
from functools import reduce

import jax.numpy as jnp

from ...fields.declarations import quantity
from ...fields.types import Single
from ...math.smoothing import norm_and_direction
from ...math.vectors import Scalar, Vector
from ..contact.limits import Limit
from .laws import AbstractFilm, FilmGap

NARROWEST, WIDEST = 0.125, 1.0
"""Range of the width-to-diameter ratio for which the coefficients were fitted."""
NEARLY_CENTRED = 1e-3
"""Eccentricity ratio below which the direction of the line of centres fades out."""
LOAD = (
    (1.1642, -1.9456, 7.1161, -10.1073, 5.0141),
    (-1.000026, -0.023634, -0.4215, -0.038817, -0.090551),
)
"""Coefficients of the polynomials a1 and a2 of the width-to-diameter ratio, lowest power first, for
the load that rotation carries."""
ATTITUDE = (
    (1.152624, -0.104565),
    (-2.5905, 0.798745),
    (8.73393, -2.3291),
    (-13.3414, 3.424337),
    (6.6294, -1.591732),
)
"""Coefficients of the polynomials a3 to a7 of the width-to-diameter ratio, lowest power first, for
the angle between the load and the line of centres."""
SQUEEZE = (
    (0.70038, 3.2415, -12.2486, 18.895, -9.3561),
    (-0.999935, 0.0157434, -0.74224, 0.42278, -0.368928),
)
"""Coefficients of the polynomials a8 and a9 of the width-to-diameter ratio, lowest power first, for
the load that squeeze carries."""


class ButenschoenFilm(AbstractFilm):
    """Film of finite width: fits to solutions of Reynolds' equation for rotation and for squeeze.

    With b = B/D of the film's width and the bearing's diameter, psi = 2c/D, the eccentricity ratio
    eps at the angle delta, and Omega the sum of the spins minus 2 delta', rotation carries So_D B D
    mu |Omega|/psi^2 at the angle beta from the line of centres, and squeeze carries So_V B D mu
    eps'/psi^2 along it. So_D deviates from tabulated values by -3.3 to 6.8 %.

    The two solutions are added, which is an approximation; for simultaneous rotation and squeeze in
    a short bearing use `CaponeFilm`. A centred journal has no line of centres: its direction fades
    out below an eccentricity ratio of 0.001.

    **Arguments:** `viscosity`: mu, Pa s. **Warns:** `LawRangeWarning` if B/D is outside 1/8 to 1.

    **Source:** H.-J. Butenschoen 1976 (thesis, Karlsruhe), "Das hydrodynamische, zylindrische
    Gleitlager endlicher Breite unter instationaerer Belastung"; as in MBDyn's module
    `hydrodynamic_plain_bearing`.

    >>> gap = extend.FilmGap(
    ...     axis=extend.UNIT_Z,
    ...     offset=extend.Vector(0.5, 0.0, 0.0),
    ...     rate=extend.Vector(0.0, -100.0, 0.0),
    ...     spin=200.0,
    ...     bearing_radius=25e-3,
    ...     clearance=50e-6,
    ...     length=12.5e-3,
    ... )
    >>> force = cj.films.ButenschoenFilm(viscosity=0.02).force(gap)
    >>> print(f"{force.x:.1f} N, {force.y:.1f} N")
    -61.0 N, 89.4 N
    """

    viscosity: Single = quantity("Pa s", positive=True, remedy="give mu in Pa s")

    def force(self, gap: FilmGap) -> Vector:
        """Return the force on the journal, N: the sum of the forces of rotation and squeeze."""
        width = gap.length / (2.0 * gap.bearing_radius)
        ratio, _ = norm_and_direction(gap.offset)
        # The unit vector along the line of centres, which fades out for a centred journal.
        centres = gap.offset * (1.0 / jnp.sqrt(ratio * ratio + NEARLY_CENTRED**2))
        closing = gap.rate.dot(centres)
        rotation = gap.rate - centres * closing
        slope, angle = 2.0 * load_slope(width, ratio), attitude(width, ratio)
        tangential = slope * jnp.sin(angle)
        radial = slope * jnp.cos(angle) * jnp.abs(gap.axis.dot(centres.cross(gap.rate)))
        # An opening film acts like a closing one on the other side of the bearing.
        squeeze = squeeze_load(width, jnp.where(closing < 0.0, -ratio, ratio)) * closing
        scale = 2.0 * self.viscosity * gap.length * gap.bearing_radius**3 / gap.clearance**2
        return (rotation * tangential + centres * (radial + squeeze)) * -scale

    def limits(self, bearing_radius: Scalar, length: Scalar) -> tuple[Limit, ...]:
        """Return the range of width-to-diameter ratios for which the film law is valid.

        **Arguments:** `bearing_radius`, `length`: of the bearing and the film, m.
        """
        width = length / (2.0 * bearing_radius)
        name = type(self).__name__
        return (Limit(name, "width over diameter", "", width, NARROWEST, WIDEST),)


def load_slope(width: Scalar, ratio: Scalar) -> Scalar:
    """Return the load number So_D of steady rotation divided by the eccentricity ratio.

    `width` is the width-to-diameter ratio B/D, `ratio` the eccentricity ratio.
    """
    numerator, shift = (polynomial(fit, width) for fit in LOAD)
    square = ratio * ratio
    short = jnp.sqrt(math.pi**2 * (1.0 - square) + 16.0 * square) / (2.0 * (1.0 - square) ** 2)
    return width * width * short * numerator * (ratio - 1.0) / (shift + ratio)


def attitude(width: Scalar, ratio: Scalar) -> Scalar:
    """Return the angle beta, rad, from the line of centres to the load that rotation carries.

    `width` is the width-to-diameter ratio B/D, `ratio` the eccentricity ratio.
    """
    short = jnp.arctan2(math.pi * jnp.sqrt(1.0 - ratio * ratio), 2.0 * ratio)
    return short * polynomial([polynomial(fit, width) for fit in ATTITUDE], ratio)


def squeeze_load(width: Scalar, ratio: Scalar) -> Scalar:
    """Return the load number So_V of squeeze.

    `width` is the width-to-diameter ratio B/D. `ratio` is the eccentricity ratio, with a negative
    sign if the eccentricity decreases.
    """
    numerator, shift = (polynomial(fit, width) for fit in SQUEEZE)
    square = ratio * ratio
    arc = 0.5 * math.pi - 0.5 * jnp.arccos(ratio)
    short = arc * (1.0 + 2.0 * square) + 1.5 * ratio * jnp.sqrt(1.0 - square)
    short = 4.0 * width * width * short * (1.0 - square) ** -2.5
    return short * numerator * (1.0 - ratio) / (-shift - ratio)


def polynomial(coefficients: Sequence[Scalar], x: Scalar) -> Scalar:
    """Return the value of a polynomial at x, from its coefficients, lowest power first."""
    return reduce(lambda value, coefficient: value * x + coefficient, reversed(coefficients))
