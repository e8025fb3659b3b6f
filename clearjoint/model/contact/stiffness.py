"""The elastic force of a contact: a power of the penetration with a generalised stiffness, given or
from materials and radii, or another function of it.
"""

import abc
import math

import jax.numpy as jnp

from ...fields.conversion import AbstractConverting
from ...fields.declarations import quantity
from ...fields.types import Single
from ...math.smoothing import positive_power
from ...math.vectors import Scalar
from .gap import Gap
from .limits import Limit
from .materials import AbstractMaterialPair

SOFTEST_CONTACT = 1e6
"""Generalised stiffness, N/m^n, below which a newton presses the surfaces together by a tenth of a
millimetre."""


class AbstractElasticity(AbstractConverting):
    """The elastic force of a contact against its penetration, and the energy that it stores.

    >>> foundation = cj.laws.LiuCylinder(207e9, 0.3, length=10e-3)  # is one
    >>> gap = extend.Gap(depth=1e-6, rate=0.0, bearing_radius=10e-3, clearance=0.1e-3)
    >>> print(f"{foundation.force(gap, exponent=1.5):.0f} N")
    126 N
    """

    @abc.abstractmethod
    def force(self, gap: Gap, exponent: float) -> Scalar:
        """Elastic force in N, zero without penetration; `exponent` is the law's."""

    @abc.abstractmethod
    def energy(self, gap: Gap, exponent: float) -> Scalar:
        """The force's integral over the penetration, J."""

    def begins_flat(self, exponent: float) -> bool:
        """Whether the force is known to have no slope where the penetration begins."""
        del exponent
        return False

    def limits(self, gap: Gap) -> tuple[Limit, ...]:
        """What of a gap it holds for, if not for all."""
        del gap
        return ()


class AbstractStiffness(AbstractElasticity):
    """The generalised stiffness K of a law, whose elastic force is K delta^n.

    ```python
    import clearjoint as cj

    class LinerStiffness(cj.extend.AbstractStiffness):
        modulus: float  # Pa
        thickness: float  # m

        def value(self, gap):
            return self.modulus * gap.bearing_radius / self.thickness

    law = cj.laws.Hertz(LinerStiffness(modulus=3e9, thickness=1e-3), exponent=1.0)
    ```
    """

    @abc.abstractmethod
    def value(self, gap: Gap) -> Scalar:
        """The stiffness K in N/m^n for the radii of a gap."""

    def begins_flat(self, exponent: float) -> bool:
        """For an exponent that is a Python number above one."""
        return isinstance(exponent, int | float) and exponent > 1.0

    def force(self, gap: Gap, exponent: float) -> Scalar:
        """K delta^n, N."""
        return self.value(gap) * positive_power(gap.depth, exponent)

    def energy(self, gap: Gap, exponent: float) -> Scalar:
        """K delta^(n+1)/(n+1), J."""
        return self.value(gap) * positive_power(gap.depth, exponent + 1) / (exponent + 1)


class GivenStiffness(AbstractStiffness):
    """A stiffness known from elsewhere, N/m^n.

    >>> cj.laws.GivenStiffness(1e9).value(extend.Gap(depth=1e-6, rate=0.0)).item()
    1000000000.0
    """

    stiffness: Single = quantity(
        "N/m^n", positive=True, usual=(SOFTEST_CONTACT, math.inf), remedy="give K in N and m"
    )

    def value(self, gap: Gap) -> Scalar:
        """The stiffness K in N/m^n, the same for every gap."""
        return self.stiffness


class RavnStiffness(AbstractMaterialPair, AbstractStiffness):
    r"""Internal contact of two spherical surfaces (P. Ravn 1998; Flores et al. 2006, section 4).

    $$K = \frac{4}{3 (s_i + s_j)} \sqrt{\frac{R_i R_j}{R_i - R_j}}, \quad s = \frac{1 - \nu^2}{E}$$

    K = 4/(3 (s_i + s_j)) sqrt(R_i R_j/(R_i - R_j)) with s = (1 - nu^2)/E. It follows the radii, so
    that a swept clearance changes it.

    **Arguments:** Young's moduli in Pa and Poisson's ratios of bearing and journal; the journal's
    are the bearing's unless given.

    >>> gap = extend.Gap(depth=1e-6, rate=0.0, bearing_radius=10e-3, clearance=0.5e-3)
    >>> print(f"{cj.laws.RavnStiffness(207e9, 0.3).value(gap):.4g} N/m^1.5")
    6.61e+10 N/m^1.5
    """

    def value(self, gap: Gap) -> Scalar:
        """The stiffness K in N/m^1.5, by the radii of bearing and journal."""
        assert gap.bearing_radius is not None and gap.clearance is not None
        radii = gap.bearing_radius * gap.journal_radius
        return 4.0 / (3.0 * self.compliance()) * jnp.sqrt(radii / gap.clearance)


def as_stiffness(value: object) -> AbstractElasticity:
    """The elasticity given, or a `GivenStiffness` of a number in N/m^n."""
    return value if isinstance(value, AbstractElasticity) else GivenStiffness(value)
