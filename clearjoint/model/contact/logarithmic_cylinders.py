"""Line contacts whose penetration is a function of the load: delta = P S [ln(A/P) + k].

delta is the penetration, P the force per length, and S = 1/(pi E*) with the contact modulus E*,
whose inverse is the sum of (1 - nu^2)/E of both materials. The laws differ in the load A and the
number k. The penetration has a maximum at the load A exp(k - 1), beyond which the formula is
invalid. With u = ln(A/P) + k and the length L the force F = P L is L delta/(S u). u follows from
the ratio d of the penetration to its maximum: u - 1 - ln u = -ln d, for all laws. In the formulas
dR is the clearance, and R_i and R_j are the radii of bearing and journal.

The arguments of all classes are those of `AbstractCylinder`: `young_modulus`, Pa, and
`poisson_ratio` of the bearing, those of the journal (`journal_young_modulus`,
`journal_poisson_ratio`; the bearing's by default), and the `length` L of the line, m. Beyond the
largest penetration, and from 99 % of it, the force continues along its tangent.
"""

import math
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from ...math.vectors import Scalar
from .cylinders import AbstractCylinder, radii_of
from .gap import Gap

_STEPS = 5
"""Number of steps of Newton's method in `inverse_of_load`; four reach rounding accuracy."""


@jax.custom_jvp
def inverse_of_load(ratio: Scalar) -> Scalar:
    """Return the solution u > 1 of u exp(1 - u) = ratio, for a ratio between zero and one.

    It inverts the law of a line contact: the ratio is that of the penetration to its maximum, and u
    is ln(A/P) + k, which gives the load P per length.
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

        It has a closed form: P delta minus the integral of the penetration delta over the load P.
        """
        u = inverse_of_load(depth / self.deepest(gap))
        return (depth / u) ** 2 * (0.5 * u - 0.25) / self._flatness()


class JohnsonCylinder(AbstractLogarithmicCylinder):
    r"""Johnson's line contact, valid for penetrations up to 0.541 clearances (K. L. Johnson 1985).

    $$\delta = \frac{P}{\pi E^*} \left(\ln \frac{4 \pi E^* \Delta R}{P} - 1\right)$$

    >>> cylinder = cj.laws.JohnsonCylinder(207e9, 0.3, length=20e-3)
    >>> gap = extend.Gap(depth=1e-6, rate=0.0, bearing_radius=10e-3, clearance=0.1e-3)
    >>> print(f"{cj.laws.Hertz(cylinder).elastic_force(gap):.0f} N")
    1032 N
    """

    constant = -1.0


class EsduCylinder(AbstractLogarithmicCylinder):
    r"""Line contact of ESDU 78035, valid for penetrations up to four clearances.

    $$\delta = \frac{P}{\pi E^*} \left(\ln \frac{4 \pi E^* \Delta R}{P} + 1\right)$$

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

    P is the force per length, and R = R_i R_j/dR the relative radius of bearing and journal. The
    formula is used as printed. The factor 1.60 in Roark's handbook refers to diameters; with 2.26
    the penetration would be smaller by P/(pi E*) ln 2.

    >>> cylinder = cj.laws.RadzimovskyCylinder(207e9, 0.3, length=20e-3)
    >>> gap = extend.Gap(depth=1e-6, rate=0.0, bearing_radius=10e-3, clearance=0.1e-3)
    >>> print(f"{cj.laws.Hertz(cylinder).elastic_force(gap):.0f} N")
    888 N
    """

    constant = 2.0 / 3.0
    # ln(4 R_i/b) + ln(4 R_j/b) = ln(16 R_i R_j/b^2) = ln(6.25 E* dR/P), since 16/1.6^2 = 6.25.
    factor = 6.25


class AbstractLoadByLength(AbstractLogarithmicCylinder):
    """Base class of formulas with the load A = L^2 dR/(R_i R_j S), for the length L, and k = 1."""

    constant = 1.0

    def reference_load(self, gap: Gap) -> Scalar:
        """Return L^2 dR/(R_i R_j S), N/m."""
        bearing, journal, clearance = radii_of(gap)
        return self.length**2 * clearance / (bearing * journal * self._flatness())


class DubowskyFreudensteinCylinder(AbstractLoadByLength):
    r"""Line contact of S. Dubowsky and F. Freudenstein (1971).

    $$\delta = \frac{P}{\pi E^*} \left(\ln \frac{L^3 \Delta R}{F R_i R_j S} + 1\right)$$

    F = P L is the force, and S = 1/(pi E*).

    >>> cylinder = cj.laws.DubowskyFreudensteinCylinder(207e9, 0.3, length=20e-3)
    >>> gap = extend.Gap(depth=1e-6, rate=0.0, bearing_radius=10e-3, clearance=0.1e-3)
    >>> print(f"{cj.laws.Hertz(cylinder).elastic_force(gap):.0f} N")
    775 N
    """


class GoldsmithCylinder(AbstractLoadByLength):
    r"""Goldsmith's line contact (W. Goldsmith 1960).

    $$\delta = \frac{P}{\pi E^*} \left(\ln \frac{L^3}{F R S} + 1\right), \quad R = \frac{R_i
    R_j}{\Delta R}$$

    F = P L is the force, and S = 1/(pi E*). The exponent of L is printed as 1, which is
    dimensionally inconsistent. With 3, used here, the law equals that of Dubowsky and Freudenstein.

    >>> cylinder = cj.laws.GoldsmithCylinder(207e9, 0.3, length=20e-3)
    >>> gap = extend.Gap(depth=1e-6, rate=0.0, bearing_radius=10e-3, clearance=0.1e-3)
    >>> print(f"{cj.laws.Hertz(cylinder).elastic_force(gap):.0f} N")
    775 N
    """
