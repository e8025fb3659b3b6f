"""Line contact of a journal along its bearing, smooth or rough, by length, radii and material.

The subclasses of `AbstractCylinder` give the elastic force as a function of the penetration. They
take the place of the stiffness in a law of the Hunt-Crossley family and can be combined with any of
its damping factors. The delivered restitution, the ratio of rebound speed to entry speed in a free
impact, stays the same, because it doesn't depend on the elastic force. In the formulas F is the
force, delta the penetration, L the length, dR the radial clearance, and 1/E* the sum of
(1 - nu^2)/E of both materials.

The pressure between two rough planes depends on the ratio of their distance to their roughness (J.
A. Greenwood, J. H. Tripp 1970). Around a journal that is nearly as large as its bearing, a fit of
this pressure integrates to a force that is a power of the depth by which the asperities overlap.
`GreenwoodTripp` computes this force, and `RoughCylinders` is the contact law that uses it.
"""

import abc
import math
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from ..._fields.checks import require
from ..._fields.objects import AbstractConverting, quantity
from ..._fields.types import Single
from ..._math.smoothing import positive_power
from ..._math.vectors import Scalar, add, square_root
from .laws import (
    AbstractContactLaw,
    AbstractElasticity,
    AbstractMaterialPair,
    Gap,
    Limit,
    radii_of,
    require_instance,
)

_GAUSS = np.polynomial.legendre.leggauss(24)
_NODES, _WEIGHTS = 0.5 * (_GAUSS[0] + 1.0), 0.5 * _GAUSS[1]
"""Nodes and weights of Gauss quadrature over [0, 1], (24,) each. Smooth formulas would need fewer
points."""
_STRAIGHT_FROM = 0.99
"""Fraction of a formula's largest penetration above which the force is extrapolated linearly: at
the largest penetration itself, some formulas have an infinite stiffness."""


class AbstractCylinder(AbstractMaterialPair, AbstractElasticity):
    """Base class of elasticities for a journal that touches its bearing along a line.

    An elasticity is the elastic force of a contact law as a function of the penetration. A subclass
    defines `line_force`, for which `compliance()` gives 1/E*; the energy is integrated numerically
    by default. The surfaces must have radii: the formulas of this module raise a `ValueError` for a
    `Gap` without `bearing_radius` or `clearance`.

    **Arguments:**

    - `young_modulus`, `poisson_ratio`: of the bearing, Pa and dimensionless.
    - `journal_young_modulus`, `journal_poisson_ratio`: of the journal; the bearing's by default.
    - `length`: of the line, m. Each base of a `ClearanceJoint` (the journal's two end circles)
      applies the full law: use half the journal's length, or the whole length with `line_points`.

    **Raises:** `ValueError` if a modulus or the length is not positive, or a Poisson's ratio is
    outside [-1, 0.5]. **Warns:** `UnusualValueWarning` for moduli outside 1e9 to 2e12 Pa, or a
    length outside 1e-5 to 10 m.

    ```python
    import clearjoint as cj
    import jax.numpy as jnp

    class Foundation(cj.extend.AbstractCylinder):
        def line_force(self, gap, depth):
            return depth * jnp.sqrt(depth / gap.clearance) / self.compliance()

    law = cj.laws.LankaraniNikravesh(0.9, Foundation(207e9, 0.3, length=10e-3))
    ```
    """

    length: Single = quantity(
        "m", positive=True, usual=(1e-5, 10.0), remedy="give it in m; 1 mm is 1e-3 m", kw_only=True
    )

    @abc.abstractmethod
    def line_force(self, gap: Gap, depth: Scalar) -> Scalar:
        """Return the force per length, N/m.

        **Arguments:** `gap`: gives the radii, m; its depth is not used. `depth`: penetration, m,
        positive.
        """

    def line_energy(self, gap: Gap, depth: Scalar) -> Scalar:
        """Return the integral of `line_force` over the penetration, from zero to `depth`, J/m.

        **Arguments:** `gap`: gives the radii, m. `depth`: penetration, m, positive.
        """
        # The force is a smooth function of the square root of the depth, but not of the depth:
        # Gauss quadrature in the root is accurate. The substitution depth * node^2 gives the factor
        # 2 node depth.
        depths = [depth * node**2 for node in _NODES]
        forces = [self.line_force(gap, at) for at in depths]
        parts = zip(_WEIGHTS, _NODES, forces, strict=True)
        return sum(weight * 2.0 * node * force for weight, node, force in parts) * depth

    def deepest(self, gap: Gap) -> Scalar | None:
        """Return the largest penetration for which the formula is valid, m; ``None``, the default,
        for no limit."""
        return None

    def limits(self, gap: Gap) -> tuple[Limit, ...]:
        """Return a tuple with one `Limit`, the penetration and its valid range, m; an empty tuple
        if the formula has no limit.

        A run that records impacts warns of penetrations outside this range.
        """
        deepest = self.deepest(gap)
        if deepest is None:
            return ()
        return (Limit(type(self).__name__, "penetration", "m", gap.depth, 0.0, deepest),)

    def force(self, gap: Gap, exponent: float) -> Scalar:
        """Return the elastic force, N, zero without penetration.

        If the formula has a largest penetration, the force continues along its tangent from 0.99
        of this penetration on. The exponent is not used.
        """
        depth, beyond, _ = self._parts(gap)
        load = add(self.line_force(gap, depth), beyond)
        return jnp.where(gap.depth > 0.0, self.length * load, 0.0)

    def energy(self, gap: Gap, exponent: float) -> Scalar:
        """Return the integral of the force over the penetration, J; the exponent is not used."""
        depth, _, beyond = self._parts(gap)
        energy = add(self.line_energy(gap, depth), beyond)
        return jnp.where(gap.depth > 0.0, self.length * energy, 0.0)

    def _parts(self, gap: Gap) -> tuple[Scalar, Scalar, Scalar]:
        """Return the depth at which to evaluate the formula, m, and what to add to its force per
        length, N/m, and to its energy per length, J/m.

        The depth is the penetration, but at most 0.99 of the largest valid penetration. Beyond this
        bound the force continues along its tangent at the bound, which gives the two numbers to
        add. They are zero at smaller penetrations and for formulas without a largest penetration.
        """
        # Without contact the formulas are evaluated too; a positive depth keeps derivatives finite.
        depth = jnp.where(gap.depth > 0.0, gap.depth, 1e-6)
        deepest = self.deepest(gap)
        if deepest is None:
            return depth, 0.0, 0.0
        end = jnp.asarray(_STRAIGHT_FROM * deepest)
        along = jnp.ones_like(end)
        load, slope = jax.jvp(lambda depth: self.line_force(gap, depth), (end,), (along,))
        beyond = jnp.maximum(depth - end, 0.0)
        return jnp.minimum(depth, end), slope * beyond, beyond * (load + 0.5 * slope * beyond)


class LiuCylinder(AbstractCylinder):
    r"""Line contact with F = pi/2 E* L delta sqrt(delta/(2 (dR + delta))) (C. Liu et al. 2007).

    $$F = \frac{\pi}{2} E^* L \delta \sqrt{\frac{\delta}{2 (\Delta R + \delta)}}$$

    dR is the clearance, and 1/E* the sum of (1 - nu^2)/E of both materials. The formula is valid
    for conformal contact too. The arguments are those of `AbstractCylinder`. Source: C. Liu,
    K. Zhang, R. Yang 2007.

    >>> cylinder = cj.laws.LiuCylinder(207e9, 0.3, length=20e-3)
    >>> gap = extend.Gap(depth=1e-6, rate=0.0, bearing_radius=10e-3, clearance=0.1e-3)
    >>> print(f"{cj.laws.Hertz(cylinder).elastic_force(gap):.0f} N")
    251 N
    """

    def line_force(self, gap: Gap, depth: Scalar) -> Scalar:
        """Return the force per length, N/m."""
        clearance = radii_of(gap)[2]
        root = jnp.sqrt(depth / (2.0 * (clearance + depth)))
        return 0.5 * jnp.pi / self.compliance() * depth * root


class PereiraCylinder(AbstractCylinder):
    r"""Internal line contact with F = (0.965 dR + 0.0965) L E*/dR delta^n (C. Pereira et al. 2011).

    $$F = \frac{(0.965 \Delta R + 0.0965) L E^*}{\Delta R} \delta^n$$

    dR is the clearance, and 1/E* the sum of (1 - nu^2)/E of both materials. The formula is in mm, N
    and MPa, but all arguments are in SI units. The exponent is n = Y dR^-0.005, with
    Y = 1.51 (ln(1000 dR))^-0.151 for clearances dR below 0.34954 mm and Y = 0.0151 dR + 1.151
    above. The formula is valid for clearances from 0.005 to 10 mm. The authors use the damping of
    `LankaraniNikravesh`. The arguments are those of `AbstractCylinder`. Source: C. Pereira et al.
    2011, 2014.

    >>> cylinder = cj.laws.PereiraCylinder(207e9, 0.3, length=20e-3)
    >>> gap = extend.Gap(depth=1e-6, rate=0.0, bearing_radius=10e-3, clearance=0.1e-3)
    >>> print(f"{cj.laws.Hertz(cylinder).elastic_force(gap):.0f} N")
    1009 N
    """

    def line_force(self, gap: Gap, depth: Scalar) -> Scalar:
        """Return the force per length, N/m, which is a thousand times the formula's N/mm."""
        clearance = 1e3 * radii_of(gap)[2]
        # The clip keeps the logarithm positive: it vanishes at a clearance of 0.001 mm, which is
        # below the valid range.
        narrow = 1.51 * jnp.log(1e3 * jnp.clip(clearance, 5e-3, 0.34954)) ** -0.151
        slope = jnp.where(clearance < 0.34954, narrow, 0.0151 * clearance + 1.151)
        exponent = slope * clearance**-0.005
        modulus = 1e-6 / self.compliance()
        factor = (0.965 * clearance + 0.0965) * modulus / clearance
        return 1e3 * factor * (1e3 * depth) ** exponent

    def limits(self, gap: Gap) -> tuple[Limit, ...]:
        """Return a tuple with one `Limit`, the clearance and its valid range, m."""
        clearance = radii_of(gap)[2]
        return (Limit(type(self).__name__, "clearance", "m", clearance, 5e-6, 10e-3),)


_MOST_CONTACT = 0.8
"""Largest b^2 = tan^2(half-angle/2) for which the formula of `PerssonCylinder` counts as valid; at
0.8346 the force is infinite."""


class PerssonCylinder(AbstractCylinder):
    r"""Conformal contact of equal materials, exact for a given half-angle (A. Persson 1964).

    $$\frac{E' \Delta R}{P} = \frac{2 - \ln(b^2 + 1) - 2 b^4}{\pi b^2 (b^2 + 1)}, \quad b =
    \tan\frac{\varepsilon}{2}$$

    P = F/L is the load per length, dR the clearance, epsilon the half-angle of the contact, and
    E' = E/(1 - nu^2). Persson's theory doesn't give the penetration delta. Here the half-angle
    follows from the overlap of the undeformed circles as in `LiuCylinder`, cos(half-angle) =
    dR/(dR + delta). For small penetrations the force is then several times that of the other
    formulas for line contacts. `half_angle` and `load` show where a contact is too conformal for
    formulas that assume a small half-angle. For different materials, E' is replaced by 2 E*, where
    1/E* is the sum of (1 - nu^2)/E of both. The arguments are those of `AbstractCylinder`.

    >>> cylinder = cj.laws.PerssonCylinder(207e9, 0.3, length=20e-3)
    >>> load = cylinder.load(np.pi / 4, clearance=0.1e-3)  # of a half-angle of 45 degrees
    >>> print(f"{load:.3e} N")
    1.611e+05 N
    """

    def line_force(self, gap: Gap, depth: Scalar) -> Scalar:
        """Return the force per length, N/m."""
        clearance = radii_of(gap)[2]
        # b^2 = tan^2(half-angle/2) = (1 - cos)/(1 + cos) for the cosine dR/(dR + delta).
        return self._line_load(depth / (2.0 * clearance + depth), clearance)

    def half_angle(self, gap: Gap) -> Scalar:
        """Return the half-angle of the contact at the penetration of a gap, rad."""
        clearance = radii_of(gap)[2]
        return jnp.arccos(clearance / (clearance + jnp.maximum(gap.depth, 0.0)))

    def load(self, half_angle: Scalar, clearance: Scalar) -> Scalar:
        """Return the force in N for a contact half-angle, rad, and a radial clearance, m.

        The formula holds only for half-angles below 84.8 degrees: at 84.8 degrees the force is
        infinite, and beyond, the result is negative.
        """
        return self.length * self._line_load(jnp.tan(0.5 * half_angle) ** 2, clearance)

    def _line_load(self, square: Scalar, clearance: Scalar) -> Scalar:
        """Return the force per length, N/m.

        **Arguments:** `square`: b^2; `clearance`: m.
        """
        numerator = 2.0 - jnp.log1p(square) - 2.0 * square**2
        # For equal materials E' is twice E*.
        modulus = 2.0 / self.compliance()
        return modulus * clearance * jnp.pi * square * (square + 1.0) / numerator

    def deepest(self, gap: Gap) -> Scalar:
        """Return the largest penetration for which the formula counts as valid, m.

        It is eight clearances, where nearly half of the bearing's circumference is in contact.
        """
        return 2.0 * _MOST_CONTACT / (1.0 - _MOST_CONTACT) * radii_of(gap)[2]


_STEPS = 5
"""Number of steps of Newton's method in `inverse_of_load`; four reach rounding accuracy."""


@jax.custom_jvp
def inverse_of_load(ratio: Scalar) -> Scalar:
    """Return the solution u > 1 of u exp(1 - u) = ratio, for a ratio between zero and one.

    It inverts the formula of `AbstractLogarithmicCylinder`: the ratio is the penetration divided by
    the largest valid one, and u is ln(A/P) + k, which gives the load P per length.
    """
    q = -jnp.log(ratio)
    # Newton's method for u - 1 - ln u = q, started from an upper bound.
    u = 1.0 + jnp.sqrt(2.0 * q) + q
    for _ in range(_STEPS):
        u = u * (q + jnp.log(u)) / (u - 1.0)
    return u


@inverse_of_load.defjvp
def _inverse_along(primals: tuple[Scalar], tangents: tuple[Scalar]) -> tuple[Scalar, Scalar]:
    # The derivative of ln u + 1 - u = ln ratio: du (1/u - 1) = d(ratio)/ratio.
    (ratio,), (tangent,) = primals, tangents
    u = inverse_of_load(ratio)
    return u, -u / ((u - 1.0) * ratio) * tangent


class AbstractLogarithmicCylinder(AbstractCylinder):
    """Base class of line contacts with delta = P S [ln(A/P) + k] for the load P per length, N/m.

    delta is the penetration, m, and S = 1/(pi E*), 1/Pa.

    A subclass declares

    - `constant`: k, dimensionless;
    - `factor`: dimensionless, 4 pi by default, in the load A = factor E* dR for the clearance dR;
      for another A, the subclass defines `reference_load` instead.
    """

    constant: ClassVar[float]
    factor: ClassVar[float] = 4.0 * math.pi

    def reference_load(self, gap: Gap) -> Scalar:
        """Return the load A for the radii of a gap, N/m."""
        return self.factor * radii_of(gap)[2] / self.compliance()

    def _flatness(self) -> Scalar:
        """Return S = 1/(pi E*), 1/Pa."""
        return self.compliance() / jnp.pi

    def deepest(self, gap: Gap) -> Scalar:
        """Return the largest penetration for which the formula is valid, m."""
        return self.reference_load(gap) * np.exp(self.constant - 1.0) * self._flatness()

    def line_force(self, gap: Gap, depth: Scalar) -> Scalar:
        """Return the force per length, N/m, at a depth below the largest penetration."""
        return depth / (self._flatness() * inverse_of_load(depth / self.deepest(gap)))

    def line_energy(self, gap: Gap, depth: Scalar) -> Scalar:
        """Return the integral of the force per length over the penetration, J/m.

        It has a closed form: P delta minus the integral of delta with respect to P, from P = 0.
        """
        u = inverse_of_load(depth / self.deepest(gap))
        return (depth / u) ** 2 * (0.5 * u - 0.25) / self._flatness()


class JohnsonCylinder(AbstractLogarithmicCylinder):
    r"""Johnson's line contact, valid for penetrations up to 0.541 clearances (K. L. Johnson 1985).

    $$\delta = \frac{P}{\pi E^*} \left(\ln \frac{4 \pi E^* \Delta R}{P} - 1\right)$$

    P is the force per length, dR the clearance, and 1/E* the sum of (1 - nu^2)/E of both materials.
    The arguments are those of `AbstractCylinder`.

    >>> cylinder = cj.laws.JohnsonCylinder(207e9, 0.3, length=20e-3)
    >>> gap = extend.Gap(depth=1e-6, rate=0.0, bearing_radius=10e-3, clearance=0.1e-3)
    >>> print(f"{cj.laws.Hertz(cylinder).elastic_force(gap):.0f} N")
    1032 N
    """

    constant = -1.0


class EsduCylinder(AbstractLogarithmicCylinder):
    r"""Line contact of ESDU 78035, valid for penetrations up to four clearances.

    $$\delta = \frac{P}{\pi E^*} \left(\ln \frac{4 \pi E^* \Delta R}{P} + 1\right)$$

    P is the force per length, dR the clearance, and 1/E* the sum of (1 - nu^2)/E of both materials.
    The arguments are those of `AbstractCylinder`.

    >>> cylinder = cj.laws.EsduCylinder(207e9, 0.3, length=20e-3)
    >>> gap = extend.Gap(depth=1e-6, rate=0.0, bearing_radius=10e-3, clearance=0.1e-3)
    >>> print(f"{cj.laws.Hertz(cylinder).elastic_force(gap):.0f} N")
    776 N
    """

    constant = 1.0


class RadzimovskyCylinder(AbstractLogarithmicCylinder):
    r"""Radzimovsky's line contact (E. I. Radzimovsky 1953).

    $$\delta = \frac{P}{\pi E^*} \left(\frac{2}{3} + \ln \frac{4 R_i}{b} + \ln \frac{4
    R_j}{b}\right), \quad b = 1.60 \sqrt{\frac{P R}{E^*}}$$

    P is the force per length, b the width of the contact, R_i and R_j the radii of bearing and
    journal, R = R_i R_j/dR their relative radius, and 1/E* the sum of (1 - nu^2)/E of both
    materials. The formula is valid for penetrations up to 1.425 clearances. It is used as printed,
    although the factor 1.60 of Roark's handbook belongs to a formula with diameters, while R
    consists of radii. With the factor for radii, 2.26, the penetration would be smaller by
    P/(pi E*) ln 2. The arguments are those of `AbstractCylinder`.

    >>> cylinder = cj.laws.RadzimovskyCylinder(207e9, 0.3, length=20e-3)
    >>> gap = extend.Gap(depth=1e-6, rate=0.0, bearing_radius=10e-3, clearance=0.1e-3)
    >>> print(f"{cj.laws.Hertz(cylinder).elastic_force(gap):.0f} N")
    888 N
    """

    constant = 2.0 / 3.0
    # ln(4 R_i/b) + ln(4 R_j/b) = ln(16 R_i R_j/b^2) = ln(6.25 E* dR/P), since 16/1.6^2 = 6.25.
    factor = 6.25


class AbstractLoadByLength(AbstractLogarithmicCylinder):
    """Base class of line contacts with delta = P S [ln(A/P) + 1] and A = L^2 dR/(R_i R_j S), N/m.

    P is the load per length, N/m, S = 1/(pi E*), 1/Pa, L the length, R_i and R_j the radii of
    bearing and journal, and dR the clearance. This is the formula of `AbstractLogarithmicCylinder`
    with k = 1 and another A.
    """

    constant = 1.0

    def reference_load(self, gap: Gap) -> Scalar:
        """Return L^2 dR/(R_i R_j S), N/m."""
        bearing, journal, clearance = radii_of(gap)
        return self.length**2 * clearance / (bearing * journal * self._flatness())


class DubowskyFreudensteinCylinder(AbstractLoadByLength):
    r"""Line contact of S. Dubowsky and F. Freudenstein (1971).

    $$\delta = \frac{P}{\pi E^*} \left(\ln \frac{L^3 \Delta R}{F R_i R_j S} + 1\right)$$

    F = P L is the force, L the length, dR the clearance, R_i and R_j the radii of bearing and
    journal, S = 1/(pi E*), and 1/E* the sum of (1 - nu^2)/E of both materials. The formula is valid
    for penetrations up to L^2 dR/(R_i R_j). The arguments are those of `AbstractCylinder`.

    >>> cylinder = cj.laws.DubowskyFreudensteinCylinder(207e9, 0.3, length=20e-3)
    >>> gap = extend.Gap(depth=1e-6, rate=0.0, bearing_radius=10e-3, clearance=0.1e-3)
    >>> print(f"{cj.laws.Hertz(cylinder).elastic_force(gap):.0f} N")
    775 N
    """


class GoldsmithCylinder(AbstractLoadByLength):
    r"""Goldsmith's line contact (W. Goldsmith 1960).

    $$\delta = \frac{P}{\pi E^*} \left(\ln \frac{L^3}{F R S} + 1\right), \quad R = \frac{R_i
    R_j}{\Delta R}$$

    The symbols, the arguments and the valid penetrations are those of
    `DubowskyFreudensteinCylinder`. The exponent of L is printed as 1, which is dimensionally
    inconsistent. With 3, used here, the law equals that of Dubowsky and Freudenstein.

    >>> cylinder = cj.laws.GoldsmithCylinder(207e9, 0.3, length=20e-3)
    >>> gap = extend.Gap(depth=1e-6, rate=0.0, bearing_radius=10e-3, clearance=0.1e-3)
    >>> print(f"{cj.laws.Hertz(cylinder).elastic_force(gap):.0f} N")
    775 N
    """


REACH = 4.0
"""Ratio of the mean planes' distance to the roughness, below which asperities touch."""
FIT, EXPONENT = 4.4086e-5, 6.804
"""Constants of the fit F_5/2 = FIT (4 - ratio)^EXPONENT (Arcoumanis et al. 1997).

F_5/2 is the integral over the heights of the asperities in Greenwood and Tripp's pressure, and the
ratio is distance over roughness.
"""
AROUND = math.sqrt(math.pi) * math.gamma(EXPONENT + 1.0) / math.gamma(EXPONENT + 1.5)
"""Integral of (1 - x^2)^EXPONENT from -1 to 1.

The integrand is the pressure divided by its maximum. x is the angle from the closest point, divided
by the angle at the end of the arc of contact. The distance of the surfaces grows with x^2.
"""


class GreenwoodTripp(AbstractConverting):
    r"""Pressure of the asperities of two rough surfaces.

    $$p = \frac{16 \sqrt{2} \pi}{15} (\sigma \beta \eta)^2 \sqrt{\sigma/\beta}\, E'
    F_{5/2}(h/\sigma)$$

    Here h is the distance of the surfaces' mean planes, sigma the standard deviation of the sum of
    both profiles, beta the radius of curvature of the asperities, and eta their number per area.
    F_5/2 is 4.4086e-5 (4 - h/sigma)^6.804 below a distance of 4 sigma, and zero above. From 0 to 2
    sigma, this fit deviates by at most 11 % from the integral for a normal distribution of heights.
    At 2.5 sigma it is 35 % too small; the pressure there is 0.2 % of that at zero distance.

    **Arguments:**

    - `roughness`: sigma, m: the root of the sum of the squares of both surfaces' roughness (rms).
    - `modulus`: E', Pa, with 1/E' = (1 - nu1^2)/E1 + (1 - nu2^2)/E2; 1.14e11 Pa for steel on steel.
    - `density`: sigma beta eta, without unit; usually 0.03 to 0.05, by default 0.04.
    - `sharpness`: sigma/beta, without unit; usually 1e-4 to 1e-2, by default 1e-3.

    **Raises:** `ValueError` if a value is not positive.

    **Source:** J. A. Greenwood, J. H. Tripp 1970; C. Arcoumanis, P. Ostovar, R. Mortier 1997.

    >>> rough = cj.laws.GreenwoodTripp(roughness=0.5e-6, modulus=1.14e11)
    >>> print(f"{rough.pressure(1e-6) / 1e6:.2f} MPa")
    0.13 MPa
    """

    roughness: Single = quantity("m", positive=True, remedy="give the rms value in m")
    modulus: Single = quantity("Pa", positive=True, remedy="give E' in Pa; 1 GPa is 1e9 Pa")
    density: Single = quantity("1", default=0.04, positive=True)
    sharpness: Single = quantity("1", default=1e-3, positive=True)

    @property
    def reach(self) -> Scalar:
        """Distance of the mean planes below which asperities touch, 4 sigma, m."""
        return REACH * self.roughness

    def pressure(self, distance: Scalar) -> Scalar:
        """Return the mean pressure, Pa, at a distance of the mean planes, m.

        It is zero beyond `reach`.
        """
        return self._scale() * positive_power(REACH - distance / self.roughness, EXPONENT)

    def force(self, depth: Scalar, radius: Scalar, clearance: Scalar, length: Scalar) -> Scalar:
        """Return the force on a journal that touches its bearing with asperities, N.

        The pressure is integrated along the arc of contact. At an angle phi from the closest point,
        the distance of the surfaces is taken as the smallest distance plus clearance phi^2/2. The
        relative error of this approximation is of the order of roughness over clearance.

        **Arguments:** in m. `depth`: `reach` minus the smallest distance; the force is zero for a
        negative depth. `radius`: of the bearing. `clearance`: radial, between the mean surfaces.
        `length`: of the journal.
        """
        # At an angle phi from the closest point, 4 - distance/sigma is
        # (depth - clearance phi^2/2)/sigma, which is zero at phi = sqrt(2 depth/clearance), the end
        # of the arc. With x = phi over this angle it is (depth/sigma) (1 - x^2). So the integral is
        # `AROUND` times (depth/sigma)^EXPONENT times half the arc, radius sqrt(2 depth/clearance),
        # whose factor sqrt(depth/sigma) is contained in `ratio`.
        ratio = positive_power(depth / self.roughness, EXPONENT + 0.5)
        arc = radius * square_root(2.0 * self.roughness / clearance)
        return self._scale() * AROUND * length * arc * ratio

    def _scale(self) -> Scalar:
        """Return the pressure, Pa, at a distance of 3 sigma, where (4 - h/sigma)^6.804 is one."""
        factor = 16.0 * math.sqrt(2.0) * math.pi / 15.0 * FIT
        return factor * self.density**2 * square_root(self.sharpness) * self.modulus


class RoughCylinders(AbstractContactLaw):
    """Contact of a rough journal with its bearing: of asperities first, then of the walls.

    The force begins at a distance of four times the roughness, with the pressure of the asperities
    along the arc of contact. The force of the walls is added once the mean surfaces meet. A
    `LubricatedJoint` adds a fluid film. Film and asperities share the load if its `transition`, the
    depth over which contact replaces the film, is ``None``.

    **Arguments:**

    - `asperities`: a `GreenwoodTripp`.
    - `length`: of the part of the journal to which the contact belongs, m. A `ClearanceJoint` has a
      contact at each of the journal's two ends, and both apply the full law: pass half the
      journal's length. If the joint's argument `line_points` is given, the law is that of the whole
      journal: pass its length.
    - `law`: of the walls. Its force must begin with zero slope, as that of `Hertz` with an exponent
      above one does. If it has a `smoothing`, this width must be at most `asperities.reach`, which
      is not checked: otherwise the force of the walls would begin before that of the asperities.

    The surfaces must be cylinders: the force needs the bearing's radius and the clearance in `Gap`,
    and raises a `ValueError` without them.

    **Raises:** `ValueError` if the length is not positive, `asperities` or `law` is of another
    class, or the force of `law` may begin with a jump or a slope according to its `force_jumps` and
    `slope_jumps`.

    ```python
    import clearjoint as cj

    rough = cj.laws.GreenwoodTripp(roughness=0.5e-6, modulus=1.14e11)
    law = cj.laws.RoughCylinders(rough, length=10e-3, law=cj.laws.Hertz(1e10))
    dry = cj.ClearanceJoint(
        "ground", "rotor", bearing_radius=25e-3, clearance=50e-6, journal_length=20e-3,
        law=law, friction=cj.frictions.RegularisedCoulomb(0.1), axial=cj.FixedAxially(),
    )
    joint = cj.LubricatedJoint(dry, cj.films.CaponeFilm(viscosity=0.02), transition=None)
    ```
    """

    asperities: GreenwoodTripp
    length: Single = quantity("m", positive=True, remedy="give the length of the contact in m")
    law: AbstractContactLaw  # pyright: ignore[reportGeneralTypeIssues]
    force_jumps = False

    @property
    def uses_entry_speed(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Whether the law of the walls uses the entry speed."""
        return self.law.uses_entry_speed

    def __check_init__(self):
        require_instance("asperities", self.asperities, GreenwoodTripp)
        require_instance("law", self.law, AbstractContactLaw)
        # The mean surfaces meet while asperities are already in contact. This is no event, so that
        # steps don't end there, and a jump of the force or its slope would be inside of a step.
        fine = not (self.law.force_jumps or self.law.slope_jumps())
        given, remedy = type(self.law).__name__, "pass for example Hertz(1e10)"
        require(fine, "law", given, "a law whose force begins with zero slope", remedy)

    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        """Return the normal force of asperities and walls, N."""
        return self._of_asperities(gap) + self.law.force(gap, entry_speed)

    def elastic_force(self, gap: Gap) -> Scalar:
        """Return the elastic force of asperities and walls, N."""
        return self._of_asperities(gap) + self.law.elastic_force(gap)

    def stored_energy(self, gap: Gap) -> Scalar:
        """Return the integral of the elastic force over the penetration, J."""
        depth = gap.depth + self.asperities.reach
        # The force of the asperities is proportional to depth^(EXPONENT + 0.5).
        of_asperities = self._of_asperities(gap) * depth / (EXPONENT + 1.5)
        return of_asperities + self.law.stored_energy(gap)

    def onset_offset(self) -> Scalar:
        """Return the distance of the mean surfaces at which the force begins, m: the `reach` of the
        asperities or, if larger, the distance at which a smoothed law of the walls begins."""
        return jnp.maximum(self.asperities.reach, self.law.onset_offset())

    def slope_jumps(self) -> bool:
        """Return ``False``: the force of asperities begins with zero slope."""
        return False

    def limits(self, gap: Gap) -> tuple[Limit, ...]:
        """Return the validity limits of the law of the walls at a gap."""
        return self.law.limits(gap)

    def _of_asperities(self, gap: Gap) -> Scalar:
        """Return the force of the asperities, N."""
        radius, _, clearance = radii_of(gap)
        depth = gap.depth + self.asperities.reach
        return self.asperities.force(depth, radius, clearance, self.length)
