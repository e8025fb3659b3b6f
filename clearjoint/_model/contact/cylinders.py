"""Line contact of a journal along its bearing, smooth or rough, by length, radii and material."""

import abc
import math
from functools import partial
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from typing_extensions import override

from ..._fields.checks import require
from ..._fields.objects import AbstractConverting, quantity
from ..._fields.types import Single
from ..._math.interpolation import gauss_rule
from ..._math.smoothing import positive_power, value_and_slope
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

_NODES, _WEIGHTS = gauss_rule(24)
"""Nodes, weights of Gauss quadrature over [0, 1]. Smooth formulas would need fewer than 24."""


class AbstractCylinder(AbstractMaterialPair, AbstractElasticity):
    """Base class of elasticities for a journal that touches its bearing along a line.

    They take the place of the stiffness in a law of the Hunt-Crossley family, with any of its
    damping factors, and don't change the delivered restitution. In the formulas F is the force, L
    the length, P = F/L, delta the penetration, dR the radial clearance, R_i and R_j the radii of
    bearing and journal, and 1/E* the sum of (1 - nu^2)/E of both materials. A subclass defines
    `line_force`; the energy is integrated numerically by default.

    **Arguments:** those of `RavnStiffness`, and `length`: L, m. Each base of a
    `ClearanceJoint` (the journal's two end circles) applies the full law: use half the journal's
    length, or the whole length with `line_points`. An `UnusualValueWarning` tells of a length
    outside 1e-5 to 10 m.

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
        """Return the force per length, N/m, at a positive `depth`, m, for the radii of `gap`."""

    def line_energy(self, gap: Gap, depth: Scalar) -> Scalar:
        """Return the integral of `line_force` over the penetration, from zero to `depth`, J/m."""
        # The force is a smooth function of the square root of the depth, but not of the depth:
        # Gauss quadrature in the root is accurate. The substitution depth * node^2 gives the factor
        # 2 node depth.
        depths = [depth * node**2 for node in _NODES]
        forces = [self.line_force(gap, at) for at in depths]
        parts = zip(_WEIGHTS, _NODES, forces, strict=True)
        return sum(weight * 2.0 * node * force for weight, node, force in parts) * depth

    def deepest(self, gap: Gap) -> Scalar | None:
        """Return the largest penetration for which the formula is valid, m; ``None``, the default,
        for no limit. Beyond 0.99 of this penetration the force continues along its tangent. A run
        that records impacts warns of penetrations beyond the limit."""
        return None

    @override
    def limits(self, gap: Gap) -> tuple[Limit, ...]:
        deepest = self.deepest(gap)
        if deepest is None:
            return ()
        return (Limit(type(self).__name__, "penetration", "m", gap.depth, 0.0, deepest),)

    @override
    def force(self, gap: Gap, exponent: float) -> Scalar:
        depth, added_force, _ = self._parts(gap)
        load = add(self.line_force(gap, depth), added_force)
        return jnp.where(gap.depth > 0.0, self.length * load, 0.0)

    @override
    def energy(self, gap: Gap, exponent: float) -> Scalar:
        depth, _, added_energy = self._parts(gap)
        energy = add(self.line_energy(gap, depth), added_energy)
        return jnp.where(gap.depth > 0.0, self.length * energy, 0.0)

    def _parts(self, gap: Gap) -> tuple[Scalar, Scalar, Scalar]:
        """Return the depth at which to evaluate the formula, m, at most 0.99 of the `deepest`; and
        the force, N/m, and energy, J/m, that the force's tangent line adds beyond this limit."""
        # Without contact the formulas are evaluated too; a positive depth keeps derivatives finite.
        depth = jnp.where(gap.depth > 0.0, gap.depth, 1e-6)
        deepest = self.deepest(gap)
        if deepest is None:
            return depth, 0.0, 0.0
        # At the largest penetration itself, some formulas have an infinite stiffness: the tangent
        # line begins before.
        end = jnp.asarray(0.99 * deepest)
        load, slope = value_and_slope(partial(self.line_force, gap), end)
        beyond = jnp.maximum(depth - end, 0.0)
        added_energy = beyond * (load + 0.5 * slope * beyond)
        return jnp.minimum(depth, end), slope * beyond, added_energy


class LiuCylinder(AbstractCylinder):
    r"""Line contact that is valid for conformal contact too (C. Liu, K. Zhang, R. Yang 2007).

    $$F = \frac{\pi}{2} E^* L \delta \sqrt{\frac{\delta}{2 (\Delta R + \delta)}}$$

    The symbols are those of `AbstractCylinder`.

    >>> law = cj.laws.Hertz(cj.laws.LiuCylinder(207e9, 0.3, length=20e-3))
    >>> print(f"{law.elastic_force(extend.Gap(1e-6, 0.0, 10e-3, clearance=0.1e-3)):.0f} N")
    251 N
    """

    @override
    def line_force(self, gap: Gap, depth: Scalar) -> Scalar:
        _, _, clearance = radii_of(gap)
        root = jnp.sqrt(depth / (2.0 * (clearance + depth)))
        return 0.5 * jnp.pi / self.compliance() * depth * root


class PereiraCylinder(AbstractCylinder):
    r"""Internal line contact for clearances from 0.005 to 10 mm (C. Pereira et al. 2011, 2014).

    $$F = \frac{(0.965 \Delta R + 0.0965) L E^*}{\Delta R} \delta^n, \quad n = Y \Delta R^{-0.005}$$

    The formula is in mm, N and MPa, but all arguments are in SI units. Y is 1.51 (ln(1000
    dR))^-0.151 for clearances dR below 0.34954 mm, and 0.0151 dR + 1.151 above. Other symbols are
    those of `AbstractCylinder`. The authors use the damping of `LankaraniNikravesh`.

    >>> law = cj.laws.Hertz(cj.laws.PereiraCylinder(207e9, 0.3, length=20e-3))
    >>> print(f"{law.elastic_force(extend.Gap(1e-6, 0.0, 10e-3, clearance=0.1e-3)):.0f} N")
    1009 N
    """

    @override
    def line_force(self, gap: Gap, depth: Scalar) -> Scalar:
        # As the formula requires, lengths are in mm, and `modulus` is in MPa. The formula's result
        # is in N/mm; the factor 1e3 in the last line converts it to N/m.
        _, _, clearance = radii_of(gap)
        clearance_mm = 1e3 * clearance
        # The clip keeps the logarithm positive: it vanishes at a clearance of 0.001 mm, which is
        # below the valid range.
        narrow = 1.51 * jnp.log(1e3 * jnp.clip(clearance_mm, 5e-3, 0.34954)) ** -0.151
        y = jnp.where(clearance_mm < 0.34954, narrow, 0.0151 * clearance_mm + 1.151)
        exponent = y * clearance_mm**-0.005
        modulus = 1e-6 / self.compliance()
        factor = (0.965 * clearance_mm + 0.0965) * modulus / clearance_mm
        return 1e3 * factor * (1e3 * depth) ** exponent

    @override
    def limits(self, gap: Gap) -> tuple[Limit, ...]:
        _, _, clearance = radii_of(gap)
        return (Limit(type(self).__name__, "clearance", "m", clearance, 5e-6, 10e-3),)


_MOST_CONTACT = 0.8
"""Largest b^2 = tan^2(half-angle/2) for which `PerssonCylinder` counts as valid; at 0.8346 the
force is infinite."""


class PerssonCylinder(AbstractCylinder):
    r"""Conformal contact of equal materials, exact for a given half-angle (A. Persson 1964).

    $$\frac{E' \Delta R}{P} = \frac{2 - \ln(b^2 + 1) - 2 b^4}{\pi b^2 (b^2 + 1)}, \quad b =
    \tan\frac{\varepsilon}{2}$$

    epsilon is the half-angle of the contact, P the force per length, dR the radial clearance, and
    E' = E/(1 - nu^2); for different materials 2 E* (see `AbstractCylinder`) replaces E'. Persson's
    theory doesn't give the penetration. Here the half-angle follows from the overlap of the
    undeformed circles as in `LiuCylinder`, cos(epsilon) = dR/(dR + delta). For small penetrations
    the force is then several times that of the other formulas. `half_angle` and `load` show where a
    contact is too conformal for formulas that assume a small half-angle. Penetrations up to eight
    clearances, where nearly half of the bearing's circumference is in contact, count as valid.

    >>> cylinder = cj.laws.PerssonCylinder(207e9, 0.3, length=20e-3)
    >>> load = cylinder.load(np.pi / 4, clearance=0.1e-3)  # of a half-angle of 45 degrees
    >>> print(f"{load:.3e} N")
    1.611e+05 N
    """

    @override
    def line_force(self, gap: Gap, depth: Scalar) -> Scalar:
        _, _, clearance = radii_of(gap)
        # b^2 = tan^2(half-angle/2) = (1 - cos)/(1 + cos) for the cosine dR/(dR + delta).
        return self._line_load(depth / (2.0 * clearance + depth), clearance)

    def half_angle(self, gap: Gap) -> Scalar:
        """Return the half-angle of the contact at the penetration of a gap, rad."""
        _, _, clearance = radii_of(gap)
        return jnp.arccos(clearance / (clearance + jnp.maximum(gap.depth, 0.0)))

    def load(self, half_angle: Scalar, clearance: Scalar) -> Scalar:
        """Return the force, N, for a half-angle of the contact, rad, and a radial clearance, m. At
        84.8 degrees it is infinite; beyond, the result is negative."""
        return self.length * self._line_load(jnp.tan(0.5 * half_angle) ** 2, clearance)

    def _line_load(self, square: Scalar, clearance: Scalar) -> Scalar:
        numerator = 2.0 - jnp.log1p(square) - 2.0 * square**2
        # For equal materials E' is twice E*.
        modulus = 2.0 / self.compliance()
        return modulus * clearance * jnp.pi * square * (square + 1.0) / numerator

    @override
    def deepest(self, gap: Gap) -> Scalar:
        _, _, clearance = radii_of(gap)
        return 2.0 * _MOST_CONTACT / (1.0 - _MOST_CONTACT) * clearance


@jax.custom_jvp
def inverse_of_load(ratio: Scalar) -> Scalar:
    """Return the solution u > 1 of u exp(1 - u) = ratio, for a ratio between zero and one. In
    `AbstractLogarithmicCylinder`, the ratio is the penetration over the largest valid penetration,
    and u is ln(A/P) + k."""
    q = -jnp.log(ratio)
    # Newton's method for u - 1 - ln u = q, started from an upper bound.
    u = 1.0 + jnp.sqrt(2.0 * q) + q
    for _ in range(5):  # four steps reach rounding accuracy; the fifth is a margin
        u = u * (q + jnp.log(u)) / (u - 1.0)
    return u


@inverse_of_load.defjvp
def _inverse_along(primals: tuple[Scalar], tangents: tuple[Scalar]) -> tuple[Scalar, Scalar]:
    # The derivative of ln u + 1 - u = ln ratio: du (1/u - 1) = d(ratio)/ratio.
    (ratio,), (tangent,) = primals, tangents
    u = inverse_of_load(ratio)
    return u, -u / ((u - 1.0) * ratio) * tangent


class AbstractLogarithmicCylinder(AbstractCylinder):
    """Base class of line contacts with delta = P S [ln(A/P) + k], where S = 1/(pi E*), 1/Pa (see
    `AbstractCylinder`). A subclass declares the `constant` k, and the `factor` of the load A =
    factor E* dR, N/m, unless it is 4 pi; for another A it defines `reference_load`."""

    constant: ClassVar[float]
    factor: ClassVar[float] = 4.0 * math.pi

    def reference_load(self, gap: Gap) -> Scalar:
        """Return the load A for the radii of a gap, N/m."""
        _, _, clearance = radii_of(gap)
        return self.factor * clearance / self.compliance()

    def _flatness(self) -> Scalar:
        return self.compliance() / jnp.pi

    @override
    def deepest(self, gap: Gap) -> Scalar:
        return self.reference_load(gap) * np.exp(self.constant - 1.0) * self._flatness()

    @override
    def line_force(self, gap: Gap, depth: Scalar) -> Scalar:
        return depth / (self._flatness() * inverse_of_load(depth / self.deepest(gap)))

    @override
    def line_energy(self, gap: Gap, depth: Scalar) -> Scalar:
        """Return P delta minus the integral of delta with respect to P, in closed form, J/m."""
        u = inverse_of_load(depth / self.deepest(gap))
        return (depth / u) ** 2 * (0.5 * u - 0.25) / self._flatness()


class JohnsonCylinder(AbstractLogarithmicCylinder):
    r"""Line contact of K. L. Johnson 1985, valid for penetrations up to 0.541 clearances.

    $$\delta = \frac{P}{\pi E^*} \left(\ln \frac{4 \pi E^* \Delta R}{P} - 1\right)$$

    The symbols are those of `AbstractCylinder`.

    >>> law = cj.laws.Hertz(cj.laws.JohnsonCylinder(207e9, 0.3, length=20e-3))
    >>> print(f"{law.elastic_force(extend.Gap(1e-6, 0.0, 10e-3, clearance=0.1e-3)):.0f} N")
    1032 N
    """

    constant = -1.0


class EsduCylinder(AbstractLogarithmicCylinder):
    r"""Line contact of ESDU 78035, valid for penetrations up to four clearances.

    $$\delta = \frac{P}{\pi E^*} \left(\ln \frac{4 \pi E^* \Delta R}{P} + 1\right)$$

    The symbols are those of `AbstractCylinder`.

    >>> law = cj.laws.Hertz(cj.laws.EsduCylinder(207e9, 0.3, length=20e-3))
    >>> print(f"{law.elastic_force(extend.Gap(1e-6, 0.0, 10e-3, clearance=0.1e-3)):.0f} N")
    776 N
    """

    constant = 1.0


class RadzimovskyCylinder(AbstractLogarithmicCylinder):
    r"""Line contact of E. I. Radzimovsky 1953, valid for penetrations up to 1.425 clearances.

    $$\delta = \frac{P}{\pi E^*} \left(\frac{2}{3} + \ln \frac{4 R_i}{b} + \ln \frac{4
    R_j}{b}\right), \quad b = 1.60 \sqrt{\frac{P R}{E^*}}$$

    b is the width of the contact, and R = R_i R_j/dR the relative radius; other symbols are those
    of `AbstractCylinder`. The formula is used as printed, although Roark's handbook has 1.60 for
    diameters; with 2.26, that for radii, the penetration would be smaller by P/(pi E*) ln 2.

    >>> law = cj.laws.Hertz(cj.laws.RadzimovskyCylinder(207e9, 0.3, length=20e-3))
    >>> print(f"{law.elastic_force(extend.Gap(1e-6, 0.0, 10e-3, clearance=0.1e-3)):.0f} N")
    888 N
    """

    constant = 2.0 / 3.0
    # ln(4 R_i/b) + ln(4 R_j/b) = ln(16 R_i R_j/b^2) = ln(6.25 E* dR/P), since 16/1.6^2 = 6.25.
    factor = 6.25


class AbstractLoadByLength(AbstractLogarithmicCylinder):
    """Base class of the `AbstractLogarithmicCylinder`s with the constant k = 1 and the load A = L^2
    dR/(R_i R_j S), N/m, where S = 1/(pi E*)."""

    constant = 1.0

    @override
    def reference_load(self, gap: Gap) -> Scalar:
        bearing, journal, clearance = radii_of(gap)
        return self.length**2 * clearance / (bearing * journal * self._flatness())


class DubowskyFreudensteinCylinder(AbstractLoadByLength):
    r"""Line contact of S. Dubowsky and F. Freudenstein (1971).

    $$\delta = \frac{P}{\pi E^*} \left(\ln \frac{L^3 \Delta R}{F R_i R_j S} + 1\right)$$

    S is 1/(pi E*); other symbols are those of `AbstractCylinder`. The formula is valid for
    penetrations up to L^2 dR/(R_i R_j).

    >>> law = cj.laws.Hertz(cj.laws.DubowskyFreudensteinCylinder(207e9, 0.3, length=20e-3))
    >>> print(f"{law.elastic_force(extend.Gap(1e-6, 0.0, 10e-3, clearance=0.1e-3)):.0f} N")
    775 N
    """


class GoldsmithCylinder(AbstractLoadByLength):
    """Line contact of W. Goldsmith 1960, which equals that of `DubowskyFreudensteinCylinder`.

    The printed formula has the length L in place of L^3, which is dimensionally inconsistent.

    >>> law = cj.laws.Hertz(cj.laws.GoldsmithCylinder(207e9, 0.3, length=20e-3))
    >>> print(f"{law.elastic_force(extend.Gap(1e-6, 0.0, 10e-3, clearance=0.1e-3)):.0f} N")
    775 N
    """


REACH = 4.0
"""Distance of the mean planes, over the roughness, below which asperities touch."""
FIT, EXPONENT = 4.4086e-5, 6.804
"""Constants of the fit F_5/2 = FIT (4 - distance/roughness)^EXPONENT (Arcoumanis et al. 1997)."""
AROUND = math.sqrt(math.pi) * math.gamma(EXPONENT + 1.0) / math.gamma(EXPONENT + 1.5)
"""Integral of (1 - x^2)^EXPONENT from -1 to 1. Along the arc of contact, from x = -1 to 1, the
pressure has this form: its integral is `AROUND` times the largest pressure times half the arc."""


class GreenwoodTripp(AbstractConverting):
    r"""Pressure of the asperities of two rough surfaces (J. A. Greenwood, J. H. Tripp 1970).

    $$p = \frac{16 \sqrt{2} \pi}{15} (\sigma \beta \eta)^2 \sqrt{\sigma/\beta}\, E'
    F_{5/2}(h/\sigma)$$

    Here h is the distance of the surfaces' mean planes, sigma the standard deviation of the sum of
    both profiles, beta the radius of curvature of the asperities, and eta their number per area.
    F_5/2 is 4.4086e-5 (4 - h/sigma)^6.804 below a distance of 4 sigma, and zero above (C.
    Arcoumanis, P. Ostovar, R. Mortier 1997). From 0 to 2 sigma, this fit deviates by at most 11 %
    from the integral for a normal distribution of heights. At 2.5 sigma it is 35 % too small; the
    pressure there is 0.2 % of that at zero distance.

    **Arguments:**

    - `roughness`: sigma, m: the root of the sum of the squares of both surfaces' roughness (rms).
    - `modulus`: E', Pa, with 1/E' = (1 - nu1^2)/E1 + (1 - nu2^2)/E2; 1.14e11 Pa for steel on steel.
    - `density`: sigma beta eta, without unit; usually 0.03 to 0.05, by default 0.04.
    - `sharpness`: sigma/beta, without unit; usually 1e-4 to 1e-2, by default 1e-3.

    **Raises:** `ValueError` if a value is not positive.

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
        """Return the mean pressure, Pa, at a distance of the mean planes, m."""
        return self._scale() * positive_power(REACH - distance / self.roughness, EXPONENT)

    def force(self, depth: Scalar, radius: Scalar, clearance: Scalar, length: Scalar) -> Scalar:
        """Return the force on a journal that touches its bearing with asperities, N: the integral
        of the pressure along the arc of contact.

        At an angle phi from the closest point, the surfaces' distance is taken as the smallest one
        plus clearance phi^2/2, with a relative error of about roughness over clearance.

        **Arguments:** in m. `depth`: `reach` minus the smallest distance; no force if negative.
        `radius`: of the bearing. `clearance`: radial, of mean surfaces. `length`: of the journal.
        """
        # At an angle phi from the closest point, 4 - distance/sigma is
        # (depth - clearance phi^2/2)/sigma, which is zero at phi = sqrt(2 depth/clearance), the end
        # of the arc. With x = phi over this angle it is (depth/sigma) (1 - x^2). So the integral is
        # `AROUND` times (depth/sigma)^EXPONENT times half the arc, radius sqrt(2 depth/clearance),
        # whose factor sqrt(depth/sigma) is contained in `power`.
        power = positive_power(depth / self.roughness, EXPONENT + 0.5)
        arc = radius * square_root(2.0 * self.roughness / clearance)
        return self._scale() * AROUND * length * arc * power

    def _scale(self) -> Scalar:
        """Return the pressure, Pa, at a distance of 3 sigma, where (4 - h/sigma)^6.804 is one."""
        factor = 16.0 * math.sqrt(2.0) * math.pi / 15.0 * FIT
        return factor * self.density**2 * square_root(self.sharpness) * self.modulus


class RoughCylinders(AbstractContactLaw):
    """Contact of a rough journal with its bearing: of asperities first, then of the walls.

    The force begins at a distance of four times the roughness, with the pressure of the asperities
    along the arc of contact. The force of the walls is added once the mean surfaces meet. The law
    is meant for mixed lubrication: film and asperities of a `LubricatedJoint` share the load if its
    `transition` is ``None``.

    **Arguments:**

    - `asperities`: a `GreenwoodTripp`.
    - `length`: m, half the journal's, since each of its two bases applies the full law; the whole
      length with `line_points` of the `ClearanceJoint`.
    - `law`: of the walls. Its force must begin without a kink, as that of `Hertz` with an exponent
      above one does. A `smoothing` must be at most `asperities.reach`, which is not checked:
      otherwise the force of the walls would begin before that of the asperities.

    **Raises:** `ValueError` if the force of `law` may begin with a jump or a kink; when a force is
    computed, if the `Gap` has no radii.

    >>> rough = cj.laws.GreenwoodTripp(roughness=0.5e-6, modulus=1.14e11)
    >>> law = cj.laws.RoughCylinders(rough, length=10e-3, law=cj.laws.Hertz(1e10))
    >>> print(f"{law.onset_offset():.1e} m")
    2.0e-06 m
    """

    asperities: GreenwoodTripp
    length: Single = quantity("m", positive=True, remedy="give the length of the contact in m")
    law: AbstractContactLaw  # pyright: ignore[reportGeneralTypeIssues]
    force_jumps = False

    @property
    @override
    def uses_entry_speed(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.law.uses_entry_speed

    @override
    def __check_init__(self):
        require_instance("asperities", self.asperities, GreenwoodTripp)
        require_instance("law", self.law, AbstractContactLaw)
        # The mean surfaces meet while asperities are already in contact. This is no event, so that
        # steps don't end there, and a jump of the force or its slope would be inside of a step.
        begins_flat = not (self.law.force_jumps or self.law.slope_jumps())
        name, remedy = type(self.law).__name__, "pass for example Hertz(1e10)"
        require(begins_flat, "law", name, "a law whose force begins with zero slope", remedy)

    @override
    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        return self._of_asperities(gap) + self.law.force(gap, entry_speed)

    @override
    def elastic_force(self, gap: Gap) -> Scalar:
        return self._of_asperities(gap) + self.law.elastic_force(gap)

    @override
    def stored_energy(self, gap: Gap) -> Scalar:
        depth = gap.depth + self.asperities.reach
        # The force of the asperities is proportional to depth^(EXPONENT + 0.5).
        of_asperities = self._of_asperities(gap) * depth / (EXPONENT + 1.5)
        return of_asperities + self.law.stored_energy(gap)

    @override
    def onset_offset(self) -> Scalar:
        return jnp.maximum(self.asperities.reach, self.law.onset_offset())

    @override
    def slope_jumps(self) -> bool:
        return False

    @override
    def limits(self, gap: Gap) -> tuple[Limit, ...]:
        return self.law.limits(gap)

    def _of_asperities(self, gap: Gap) -> Scalar:
        radius, _, clearance = radii_of(gap)
        depth = gap.depth + self.asperities.reach
        return self.asperities.force(depth, radius, clearance, self.length)
