"""Line contact of a journal along its bearing: elastic force from length, radii and materials.

These elasticities take the place of the stiffness in a law of the Hunt-Crossley family and can be
combined with any of its damping factors. The delivered restitution stays the same, because it
doesn't depend on the elastic force. In the formulas F is the force, delta the penetration, L the
length, dR the clearance, and 1/E* the sum of (1 - nu^2)/E of both materials. This module has the
base class and the explicit formulas; the logarithmic formulas are in `logarithmic_cylinders`.
"""

import abc

import jax
import jax.numpy as jnp
import numpy as np

from ...fields.declarations import quantity
from ...fields.types import Single
from ...math.vectors import Scalar
from .gap import Gap, Limit
from .laws import AbstractElasticity, AbstractMaterialPair

_GAUSS = np.polynomial.legendre.leggauss(24)
_NODES, _WEIGHTS = 0.5 * (_GAUSS[0] + 1.0), 0.5 * _GAUSS[1]
"""Nodes and weights of Gauss quadrature over [0, 1], (24,) each, more than smooth formulas need."""
_STRAIGHT_FROM = 0.99
"""Fraction of the largest penetration, where some formulas have an infinite stiffness, from which
the force is extrapolated linearly."""


class AbstractCylinder(AbstractMaterialPair, AbstractElasticity):
    """Base class of elasticities for a journal that touches its bearing along a line.

    An elasticity is the elastic force of a contact law as a function of the penetration. A subclass
    defines `line_force`; the energy is integrated numerically by default.

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
        """Return the integral of `line_force` up to a positive depth, m, in J/m."""
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
        """Return the range of penetrations for which the formula is valid, m; an empty tuple if it
        has no limit."""
        deepest = self.deepest(gap)
        if deepest is None:
            return ()
        return (Limit(type(self).__name__, "penetration", "m", gap.depth, 0.0, deepest),)

    def force(self, gap: Gap, exponent: float) -> Scalar:
        """Return the elastic force, N, zero without penetration.

        Near the largest valid penetration and beyond it, the force continues along its tangent.
        The exponent is not used.
        """
        touches, depth = _positive(gap)
        straight = self._straight(gap)
        if straight is None:
            load = self.line_force(gap, depth)
        else:
            # The formula up to the depth `end`, and its tangent beyond.
            end, _, slope = straight
            beyond = jnp.maximum(depth - end, 0.0)
            load = self.line_force(gap, jnp.minimum(depth, end)) + slope * beyond
        return jnp.where(touches, self.length * load, 0.0)

    def energy(self, gap: Gap, exponent: float) -> Scalar:
        """Return the integral of the force over the penetration, J; the exponent is not used."""
        touches, depth = _positive(gap)
        straight = self._straight(gap)
        if straight is None:
            energy = self.line_energy(gap, depth)
        else:
            # Beyond the depth `end` the integral is that of a straight line.
            end, load, slope = straight
            beyond = jnp.maximum(depth - end, 0.0)
            energy = self.line_energy(gap, jnp.minimum(depth, end))
            energy += beyond * (load + 0.5 * slope * beyond)
        return jnp.where(touches, self.length * energy, 0.0)

    def _straight(self, gap: Gap) -> tuple[Scalar, Scalar, Scalar] | None:
        """Return where the force begins to continue along its tangent, for large penetrations.

        It is given by the depth, m, and there the force per length, N/m, and its derivative by the
        depth, N/m^2. Return ``None`` for a formula without a largest penetration.
        """
        deepest = self.deepest(gap)
        if deepest is None:
            return None
        depth = jnp.asarray(_STRAIGHT_FROM * deepest)
        along = jnp.ones_like(depth)
        return depth, *jax.jvp(lambda depth: self.line_force(gap, depth), (depth,), (along,))


def _positive(gap: Gap) -> tuple[Scalar, Scalar]:
    """Return whether the surfaces touch, and the penetration, m, or 1e-6 m if they don't touch."""
    # Without contact the formulas are evaluated too; a positive depth keeps derivatives finite.
    touches = gap.depth > 0.0
    return touches, jnp.where(touches, gap.depth, 1e-6)


def radii_of(gap: Gap) -> tuple[Scalar, Scalar, Scalar]:
    """Return bearing radius, journal radius and radial clearance of a gap, m."""
    assert gap.bearing_radius is not None and gap.clearance is not None
    return gap.bearing_radius, gap.journal_radius, gap.clearance


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
    and MPa, but all arguments are in SI units. The exponent is
    n = Y dR^-0.005, with Y = 1.51 ln(1000 dR)^-0.151 for clearances dR below 0.34954 mm and
    Y = 0.0151 dR + 1.151 above. It is valid for clearances from 0.005 to 10 mm. The authors use the
    damping of `LankaraniNikravesh`. The arguments are those of `AbstractCylinder`. Source: C.
    Pereira et al. 2011, 2014.

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
        """Return the range of clearances for which the formula is valid, m."""
        clearance = radii_of(gap)[2]
        return (Limit(type(self).__name__, "clearance", "m", clearance, 5e-6, 10e-3),)


_MOST_CONTACT = 0.8
"""Largest b^2 for which `PerssonCylinder` uses its formula; at 0.8355 the force is infinite."""


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
    >>> print(f"{load:.3e} N/m")
    1.611e+05 N/m
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
        """Return the force in N for a contact half-angle, rad, and a radial clearance, m."""
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
        """Return the largest penetration for which the formula is used, m.

        It is eight clearances, where nearly half of the bearing's circumference is in contact.
        """
        return 2.0 * _MOST_CONTACT / (1.0 - _MOST_CONTACT) * radii_of(gap)[2]
