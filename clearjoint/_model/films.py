"""Film laws: the force of a lubricant on a journal, from the journal's position and its rate."""

import abc
import math
from collections.abc import Sequence
from functools import reduce

import equinox as eqx
import jax.numpy as jnp
from typing_extensions import override

from .._fields.objects import AbstractConverting, quantity
from .._fields.types import Single
from .._math.smoothing import norm_and_direction, polar_angle
from .._math.vectors import Scalar, Vector, square_root
from .contact.laws import Limit
from .tree_dataclass import tree_dataclass


@tree_dataclass
class FilmGap:
    """Position and motion of a journal in its bearing, as inputs of a film law.

    All vectors, and the force that the law returns, are in the same axes.

    - `axis`: of the bearing, a unit vector. `offset` and `rate` are perpendicular to it.
    - `offset`: vector from the bearing's axis to the journal's, divided by the clearance; its
      length is the eccentricity ratio, below 1.
    - `rate`: of the offset, 1/s, in axes that rotate at half the sum of the spins of journal and
      bearing; the pressure depends on the spins only through this rate (O. Reynolds 1886).
    - `spin`: of the journal relative to the bearing about the axis, rad/s.
    - `bearing_radius`, radial `clearance`, and `length` of the film along the axis: m.

    >>> offset, rate = extend.Vector(0.5, 0.0, 0.0), extend.Vector(0.0, -100.0, 0.0)
    >>> gap = extend.FilmGap(extend.UNIT_Z, offset, rate, 200.0, 25e-3, 50e-6, length=12.5e-3)
    >>> print(f"{gap.offset.dot(gap.offset) ** 0.5}")  # the eccentricity ratio
    0.5
    """

    axis: Vector
    offset: Vector
    rate: Vector
    spin: Scalar
    bearing_radius: Scalar
    clearance: Scalar
    length: Scalar


class AbstractFilm(AbstractConverting):
    """Base class of lubricant films with a positive dynamic `viscosity`, Pa s.

    A subclass declares this field and defines `force`. The force and its derivatives must be finite
    at zero offset and at zero rate, where these vectors have no direction.

    ```python
    import math

    import clearjoint as cj
    import jax.numpy as jnp
    from clearjoint.testing import check_film

    class LongFullFilm(cj.extend.AbstractFilm):
        viscosity: float  # Pa s

        def force(self, gap):
            square = gap.offset.dot(gap.offset)
            root = jnp.sqrt(1.0 - square)
            rotation = gap.rate * (2.0 / root)
            squeeze = gap.offset * (3.0 * gap.offset.dot(gap.rate) / root**3)
            scale = self.viscosity * gap.length * gap.bearing_radius**3 / gap.clearance**2
            return (rotation + squeeze) * (-12.0 * math.pi * scale / (2.0 + square))

    check_film(LongFullFilm(viscosity=0.02))
    ```
    """

    viscosity: eqx.AbstractVar[Single]

    @abc.abstractmethod
    def force(self, gap: FilmGap) -> Vector:
        """Return the force on the journal, N, perpendicular to the axis. Its scalar product with
        ``gap.rate`` must not be positive, because a film dissipates energy."""

    def drag(self, gap: FilmGap) -> Scalar:
        """Return the moment on the journal about the bearing's axis, N m; it opposes the spin. The
        default is that of a film around the whole circumference without cavitation, -2 pi mu R^3 L
        spin/(c sqrt(1 - eps^2)), with the eccentricity ratio eps (A. Sommerfeld 1904)."""
        # The viscous stress mu R spin/h acts on the journal's surface. The film's height is
        # h = c (1 + eps cos angle). The mean of 1/h around the bearing is 1/(c sqrt(1 - eps^2)).
        height = gap.clearance * square_root(1.0 - gap.offset.dot(gap.offset))
        scale = -2.0 * math.pi * self.viscosity * gap.bearing_radius**3 * gap.length
        return scale * (gap.spin / height)

    def limits(self, bearing_radius: Scalar, length: Scalar) -> tuple[Limit, ...]:
        """Return limits of validity for a bearing's radius and a film's length, m; none by default.
        A joint with values beyond them warns when it is made."""
        return ()


class CaponeFilm(AbstractFilm):
    r"""Film of a short bearing with rotation and squeeze, without tension (G. Capone 1986, 1991).

    $$F = -\frac{\mu R L^3}{2 c^2 \rho} (3 V |u| x + G u + 2 Q\, n \times u)$$

    With x = `FilmGap.offset`, u = `FilmGap.rate`, the unit vector e along u and the axis n: rho = 1
    - x.x, d = x.e, q = n.(x cross e), G = 2/sqrt(rho) (pi/2 + atan(d/sqrt(rho))), V = (2 + d G)/rho
    and Q = q/(1 - q^2). mu is the viscosity, R the bearing's radius, L the film's length and c the
    clearance. G. Adiletta, A. R. Guido, C. Rossi 1996 give the force's components along fixed axes.

    Choose it for short bearings: it is exact in the limit of small L/D, with the diameter D = 2R.
    At an eccentricity ratio of 0.5 the force is too large by 6 % for L/D = 1/4, by 69 % for 1.

    >>> offset, rate = extend.Vector(0.5, 0.0, 0.0), extend.Vector(0.0, -100.0, 0.0)
    >>> gap = extend.FilmGap(extend.UNIT_Z, offset, rate, 200.0, 25e-3, 50e-6, length=12.5e-3)
    >>> force = cj.films.CaponeFilm(viscosity=0.02).force(gap)
    >>> print(f"{force.x:.1f} N, {force.y:.1f} N")
    -69.4 N, 94.5 N
    """

    viscosity: Single = quantity("Pa s", positive=True, remedy="give mu in Pa s")

    @override
    def force(self, gap: FilmGap) -> Vector:
        offset, rate = gap.offset, gap.rate
        # In the formula above, `direction` is e, `along` d, `across` q, `wedge` G, `squeeze` V and
        # `transverse` Q.
        speed, direction = norm_and_direction(rate)
        rho = 1.0 - offset.dot(offset)
        root = jnp.sqrt(rho)
        along = offset.dot(direction)
        across = gap.axis.dot(offset.cross(direction))
        wedge = 2.0 / root * (0.5 * math.pi + polar_angle(along, root))
        squeeze = (2.0 + along * wedge) / rho
        transverse = across / (1.0 - across * across)
        scale = self.viscosity * gap.bearing_radius * gap.length**3 / (2.0 * gap.clearance**2)
        flow = offset * (3.0 * squeeze * speed) + rate * wedge
        return (flow + gap.axis.cross(rate) * (2.0 * transverse)) * (-scale / rho)


class PinkusSternlichtFilm(AbstractFilm):
    """Film of an infinitely long bearing with squeeze; use it only to reproduce published results.

    With the eccentricity ratio e, its rate e', and w, the sum of the spins of journal and bearing
    minus twice the rate of the offset's angle, let k^2 = (1 - e^2) ((w/(2 e'))^2 + 1/e^2). The
    radial force on the journal is positive along the offset, and the tangential force is positive a
    quarter revolution ahead of the offset about the axis. For e' > 0 these two forces, over mu L
    R^3/c^2 (viscosity mu, film length L, bearing radius R, clearance c), are in this order

        -6 e' (4 k e^2 + (2 + e^2) pi) (k + 3)/((2 + e^2) (1 - e^2)^1.5 (k + 3/2)),
        6 pi e w (k + 3)/((2 + e^2) (1 - e^2)^0.5 (k + 3/2)).

    For e' < 0, k replaces k + 3 in both forces, and the radial force begins with 6 e' (4 k e^2 - (2
    + e^2) pi) instead. At e' = 0 both cases have the same limit, which is the force there. The
    cited papers print the leading sign of the radial force for e' < 0 wrongly: with their sign, the
    force would jump at e' = 0.

    The formula is approximate: its error is 1 to 23 % for moderate squeeze and 34 % where squeeze
    dominates. An infinitely long bearing carries far more than a short one.

    **Source:** O. Pinkus, B. Sternlicht 1961, as in P. Ravn, S. Shivaswamy, B. J. Alshaer, H. M.
    Lankarani 2000 and P. Flores, J. Ambrosio, J. C. P. Claro, H. M. Lankarani, C. S. Koshy 2006.

    >>> offset, rate = extend.Vector(0.5, 0.0, 0.0), extend.Vector(0.0, -100.0, 0.0)
    >>> gap = extend.FilmGap(extend.UNIT_Z, offset, rate, 200.0, 25e-3, 50e-6, length=12.5e-3)
    >>> force = cj.films.PinkusSternlichtFilm(viscosity=0.02).force(gap)
    >>> print(f"{force.x:.1f} N, {force.y:.1f} N")
    -1111.1 N, 3023.0 N
    """

    viscosity: Single = quantity("Pa s", positive=True, remedy="give mu in Pa s")

    @override
    def force(self, gap: FilmGap) -> Vector:
        offset, rate = gap.offset, gap.rate
        square = offset.dot(offset)
        rho = 1.0 - square
        root = jnp.sqrt(rho)
        speed, _ = norm_and_direction(rate)
        # e e', positive while the film closes, and its absolute value.
        closing, size = offset.dot(rate), jnp.abs(offset.dot(rate))
        # All terms are multiplied by e |e'|, so that nothing is divided by e or e'. In the product
        # k e |e'| = sqrt(rho (e'^2 + (e w/2)^2)), e' and -e w/2 are the components of the rate.
        k_product = speed * root
        # The factor is (k + 3)/(k + 3/2) while the film closes, and k/(k + 3/2) while it opens.
        # At rest the factor would be 0/0; any finite number will do, since the force is then zero.
        moves = speed > 0.0
        numerator = k_product + jnp.where(closing > 0.0, 3.0, 0.0) * size
        factor = jnp.where(moves, numerator / jnp.where(moves, k_product + 1.5 * size, 1.0), 1.0)
        # The component of the rate along the offset is e', the one across it -e w/2. A force along
        # the rate thus contains the whole tangential force, and `squeeze` adds the rest of the
        # radial force.
        rotation = rate * (12.0 * math.pi / root)
        squeeze = offset * ((18.0 * math.pi * closing + 24.0 * k_product) / (rho * root))
        scale = self.viscosity * gap.length * gap.bearing_radius**3 / gap.clearance**2
        return (rotation + squeeze) * (-scale * factor / (2.0 + square))


NEARLY_CENTRED = 1e-3
"""Eccentricity ratio at which the vector along the line of centres, which `ButenschoenFilm` fades
to zero for a centred journal, has the length 0.71 instead of 1."""
LOAD = (
    (1.1642, -1.9456, 7.1161, -10.1073, 5.0141),
    (-1.000026, -0.023634, -0.4215, -0.038817, -0.090551),
)
"""Coefficients of the source's a1 and a2, for the load that rotation carries. Each row, also in
`ATTITUDE` and `SQUEEZE`, is a polynomial of the width-to-diameter ratio, lowest power first."""
ATTITUDE = (
    (1.152624, -0.104565),
    (-2.5905, 0.798745),
    (8.73393, -2.3291),
    (-13.3414, 3.424337),
    (6.6294, -1.591732),
)
"""Coefficients of a3 to a7, for the angle between load and line of centres; a3 is the first row."""
SQUEEZE = (
    (0.70038, 3.2415, -12.2486, 18.895, -9.3561),
    (-0.999935, 0.0157434, -0.74224, 0.42278, -0.368928),
)
"""Coefficients of a8 and a9, for the load that squeeze carries."""


class ButenschoenFilm(AbstractFilm):
    """Film of finite width: fits to solutions of Reynolds' equation for rotation and for squeeze.

    Let B be the width of the film along the axis, D the bearing's diameter, psi = 2c/D with the
    radial clearance c, mu the viscosity, eps the eccentricity ratio, delta the angle of the line of
    centres, eps' and delta' their rates, and Omega the sum of the spins of journal and bearing
    minus 2 delta'. The line of centres is along the offset of the journal. Rotation carries the
    load So_D B D mu |Omega|/psi^2 at the angle beta from the line of centres, against the sense of
    Omega, and squeeze carries the load So_V B D mu eps'/psi^2 along this line. The load numbers
    So_D and So_V and the angle beta are fitted functions of B/D and eps; So_V also depends on the
    sign of eps'. So_D deviates by -3.3 to 6.8 % from tabulated values.

    Choose it for B/D from 1/8 to 1; a joint with the film warns of others with a `LawRangeWarning`.
    The two solutions are added: above an eccentricity ratio of 0.5, an opening film may supply
    power. For simultaneous rotation and squeeze in a short bearing use `CaponeFilm`. The load along
    the line of centres falls smoothly to zero at eccentricity ratios of about 0.001 and less.

    **Source:** H.-J. Butenschoen 1976 (thesis, Karlsruhe), "Das hydrodynamische, zylindrische
    Gleitlager endlicher Breite unter instationaerer Belastung"; as in MBDyn's module
    `hydrodynamic_plain_bearing`.

    >>> offset, rate = extend.Vector(0.5, 0.0, 0.0), extend.Vector(0.0, -100.0, 0.0)
    >>> gap = extend.FilmGap(extend.UNIT_Z, offset, rate, 200.0, 25e-3, 50e-6, length=12.5e-3)
    >>> force = cj.films.ButenschoenFilm(viscosity=0.02).force(gap)
    >>> print(f"{force.x:.1f} N, {force.y:.1f} N")
    -61.0 N, 89.4 N
    """

    viscosity: Single = quantity("Pa s", positive=True, remedy="give mu in Pa s")

    @override
    def force(self, gap: FilmGap) -> Vector:
        width = gap.length / (2.0 * gap.bearing_radius)  # B/D
        ratio, _ = norm_and_direction(gap.offset)
        # The unit vector along the line of centres; it tends to zero for a centred journal.
        centres = gap.offset * (1.0 / jnp.sqrt(ratio * ratio + NEARLY_CENTRED**2))
        closing = gap.rate.dot(centres)
        rotation = gap.rate - centres * closing
        # The part of the rate across the line of centres is eps |Omega|/2, so So_D |Omega| is this
        # rate times twice So_D/eps, which is finite for a centred journal.
        slope, angle = 2.0 * load_slope(width, ratio), attitude(width, ratio)
        tangential = slope * jnp.sin(angle)
        radial = slope * jnp.cos(angle) * jnp.abs(gap.axis.dot(centres.cross(gap.rate)))
        # An opening film acts like a closing one on the other side of the bearing.
        squeeze = squeeze_load(width, jnp.where(closing < 0.0, -ratio, ratio)) * closing
        # B D mu/psi^2, with D = 2R and psi = c/R.
        scale = 2.0 * self.viscosity * gap.length * gap.bearing_radius**3 / gap.clearance**2
        # The film pushes the journal back, against the load that it carries.
        return (rotation * tangential + centres * (radial + squeeze)) * -scale

    @override
    def limits(self, bearing_radius: Scalar, length: Scalar) -> tuple[Limit, ...]:
        # The range of the solutions to which the coefficients were fitted.
        width, least, most = length / (2.0 * bearing_radius), 0.125, 1.0
        return (Limit(type(self).__name__, "width over diameter", "", width, least, most),)


def load_slope(width: Scalar, ratio: Scalar) -> Scalar:
    """Return the load number of rotation So_D of `ButenschoenFilm`, divided by the eccentricity
    `ratio`. It is finite for a centred journal, for which So_D is zero. `width` is B/D."""
    numerator, shift = (polynomial(fit, width) for fit in LOAD)  # a1 and a2
    square = ratio * ratio
    # The closed form for a short bearing, which the fit corrects for a finite width.
    short = jnp.sqrt(math.pi**2 * (1.0 - square) + 16.0 * square) / (2.0 * (1.0 - square) ** 2)
    return width * width * short * numerator * (ratio - 1.0) / (shift + ratio)


def attitude(width: Scalar, ratio: Scalar) -> Scalar:
    """Return the angle beta, rad, of `ButenschoenFilm` by `width` B/D and eccentricity ratio."""
    # The angle for an infinitely long bearing, which the fit corrects for a finite width.
    long = jnp.arctan2(math.pi * jnp.sqrt(1.0 - ratio * ratio), 2.0 * ratio)
    return long * polynomial([polynomial(fit, width) for fit in ATTITUDE], ratio)


def squeeze_load(width: Scalar, ratio: Scalar) -> Scalar:
    """Return the load number So_V of `ButenschoenFilm`. `width` is B/D, `ratio` the eccentricity
    ratio, with a minus sign if the eccentricity decreases."""
    numerator, shift = (polynomial(fit, width) for fit in SQUEEZE)  # a8 and a9
    square = ratio * ratio
    # The closed form for a short bearing, which the fit corrects for a finite width.
    arc = 0.5 * math.pi - 0.5 * jnp.arccos(ratio)
    short = arc * (1.0 + 2.0 * square) + 1.5 * ratio * jnp.sqrt(1.0 - square)
    short = 4.0 * width * width * short * (1.0 - square) ** -2.5
    return short * numerator * (1.0 - ratio) / (-shift - ratio)


def polynomial(coefficients: Sequence[Scalar], x: Scalar) -> Scalar:
    """Return the value at x of a polynomial whose coefficients are given lowest power first."""
    return reduce(lambda value, coefficient: value * x + coefficient, reversed(coefficients))
