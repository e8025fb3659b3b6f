"""Elastic contact force: a power of the penetration with a given or computed stiffness, or
another function."""

import abc
import math

import jax.numpy as jnp

from ...fields.conversion import AbstractConverting
from ...fields.declarations import optional_quantity, quantity
from ...fields.types import Single
from ...math.smoothing import positive_power
from ...math.vectors import Scalar
from .gap import Gap
from .limits import Limit

SOFTEST_CONTACT = 1e6
"""Generalised stiffness, N/m^n, below which a warning is issued."""
SOLIDS = 1e9, 2e12
"""Usual range of Young's modulus, Pa, from plastics to diamond."""
_GIVE_MODULUS = "give E in Pa; 1 GPa is 1e9 Pa"


class AbstractElasticity(AbstractConverting):
    """Base class of elastic forces of a contact as a function of the penetration.

    >>> foundation = cj.laws.LiuCylinder(207e9, 0.3, length=10e-3)
    >>> gap = extend.Gap(depth=1e-6, rate=0.0, bearing_radius=10e-3, clearance=0.1e-3)
    >>> print(f"{foundation.force(gap, exponent=1.5):.0f} N")
    126 N
    """

    @abc.abstractmethod
    def force(self, gap: Gap, exponent: float) -> Scalar:
        """Return the elastic force, N, zero without penetration.

        **Arguments:** `gap`: penetration, m, and radii, m. `exponent`: n of a law K delta^n.
        """

    @abc.abstractmethod
    def energy(self, gap: Gap, exponent: float) -> Scalar:
        """Return the stored energy, J: the integral of the force over the penetration."""

    def begins_flat(self, exponent: float) -> bool:
        """Return whether the force is known to start with zero slope at the onset.

        `exponent` is n of a law K delta^n. The default is ``False``.
        """
        del exponent
        return False

    def limits(self, gap: Gap) -> tuple[Limit, ...]:
        """Return the validity limits of the elastic force at a gap; an empty tuple by default."""
        del gap
        return ()


class AbstractStiffness(AbstractElasticity):
    """Base class of generalised stiffnesses K, N/m^n, of laws with the elastic force K delta^n.

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
        """Return the stiffness K in N/m^n for the radii of a gap."""

    def begins_flat(self, exponent: float) -> bool:
        """Return whether the exponent is a Python number above one."""
        return isinstance(exponent, int | float) and exponent > 1.0

    def force(self, gap: Gap, exponent: float) -> Scalar:
        """Return K delta^n, N."""
        return self.value(gap) * positive_power(gap.depth, exponent)

    def energy(self, gap: Gap, exponent: float) -> Scalar:
        """Return K delta^(n+1)/(n+1), J."""
        return self.value(gap) * positive_power(gap.depth, exponent + 1) / (exponent + 1)


class GivenStiffness(AbstractStiffness):
    """An explicit constant stiffness, N/m^n.

    >>> cj.laws.GivenStiffness(1e9).value(extend.Gap(depth=1e-6, rate=0.0)).item()
    1000000000.0
    """

    stiffness: Single = quantity(
        "N/m^n", positive=True, usual=(SOFTEST_CONTACT, math.inf), remedy="give K in N and m"
    )

    def value(self, gap: Gap) -> Scalar:
        """Return the stiffness K, N/m^n."""
        return self.stiffness


class AbstractMaterialPair(AbstractConverting):
    """Elastic constants of the materials of bearing and journal.

    - `young_modulus`, `poisson_ratio`: of the bearing, Pa and dimensionless.
    - `journal_young_modulus`, `journal_poisson_ratio`: of the journal; ``None`` for the bearing's.
    """

    young_modulus: Single = quantity("Pa", positive=True, usual=SOLIDS, remedy=_GIVE_MODULUS)
    poisson_ratio: Single = quantity("1", within=(-1.0, 0.5), remedy="give nu of the material")
    journal_young_modulus: Single | None = optional_quantity(
        "Pa", positive=True, usual=SOLIDS, remedy=_GIVE_MODULUS
    )
    journal_poisson_ratio: Single | None = optional_quantity(
        "1", within=(-1.0, 0.5), remedy="give nu of the material"
    )

    def compliance(self) -> Scalar:
        """Return the sum of (1 - nu^2)/E of both bodies, 1/Pa: the inverse contact modulus 1/E*."""
        modulus = self.journal_young_modulus
        ratio = self.journal_poisson_ratio
        modulus = self.young_modulus if modulus is None else modulus
        ratio = self.poisson_ratio if ratio is None else ratio
        return (1 - self.poisson_ratio**2) / self.young_modulus + (1 - ratio**2) / modulus


class RavnStiffness(AbstractMaterialPair, AbstractStiffness):
    r"""Internal contact of two spherical surfaces (P. Ravn 1998; Flores et al. 2006, section 4).

    $$K = \frac{4}{3 (s_i + s_j)} \sqrt{\frac{R_i R_j}{R_i - R_j}}, \quad s = \frac{1 - \nu^2}{E}$$

    Here i is the bearing and j the journal. The stiffness K, N/m^1.5, depends on their radii R and
    thus on the clearance R_i - R_j.

    **Arguments:**

    - `young_modulus`, `poisson_ratio`: of the bearing, Pa and dimensionless.
    - `journal_young_modulus`, `journal_poisson_ratio`: of the journal; the bearing's by default.

    >>> gap = extend.Gap(depth=1e-6, rate=0.0, bearing_radius=10e-3, clearance=0.5e-3)
    >>> print(f"{cj.laws.RavnStiffness(207e9, 0.3).value(gap):.4g} N/m^1.5")
    6.61e+10 N/m^1.5
    """

    def value(self, gap: Gap) -> Scalar:
        """Return the stiffness K in N/m^1.5 for the radii of a gap."""
        assert gap.bearing_radius is not None and gap.clearance is not None
        radii = gap.bearing_radius * gap.journal_radius
        return 4.0 / (3.0 * self.compliance()) * jnp.sqrt(radii / gap.clearance)


def as_stiffness(value: object) -> AbstractElasticity:
    """Return an elasticity unchanged, or a number in N/m^n as a `GivenStiffness`."""
    return value if isinstance(value, AbstractElasticity) else GivenStiffness(value)
