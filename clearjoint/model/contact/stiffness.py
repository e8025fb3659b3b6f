"""The generalised stiffness of a contact: given, or from materials and radii."""

import abc
import math

import jax.numpy as jnp

from ...fields.checks import as_number
from ...fields.conversion import AbstractConverting
from ...fields.declarations import optional_quantity, quantity
from ...fields.types import Single
from ...math.vectors import Scalar
from .gap import Gap

SOLIDS = 1e9, 2e12
"""Young's moduli, Pa, between which the materials of bearings lie: plastics and diamond."""
SOFTEST_CONTACT = 1e6
"""Generalised stiffness, N/m^n, below which a newton presses the surfaces together by a tenth of a
millimetre."""


_GIVE_MODULUS = "give E in Pa; 1 GPa is 1e9 Pa"


class AbstractStiffness(AbstractConverting):
    """The generalised stiffness K of a law.

    ```python
    import clearjoint as cj

    class LinerStiffness(cj.AbstractStiffness):
        modulus: float  # Pa
        thickness: float  # m

        def value(self, gap):
            return self.modulus * gap.bearing_radius / self.thickness

    law = cj.Hertz(LinerStiffness(modulus=3e9, thickness=1e-3), exponent=1.0)
    ```
    """

    @abc.abstractmethod
    def value(self, gap: Gap) -> Scalar:
        """The stiffness K in N/m^n for the radii of a gap."""


class GivenStiffness(AbstractStiffness):
    """A stiffness known from elsewhere, N/m^n."""

    stiffness: Single = quantity(
        "N/m^n", positive=True, usual=(SOFTEST_CONTACT, math.inf), remedy="give K in N and m"
    )

    def value(self, gap: Gap) -> Scalar:
        """The stiffness K in N/m^n, the same for every gap."""
        return self.stiffness


class RavnStiffness(AbstractStiffness):
    """Internal contact of two spherical surfaces (P. Ravn 1998; Flores et al. 2006, section 4).

    K = 4/(3 (s_i + s_j)) sqrt(R_i R_j/(R_i - R_j)) with s = (1 - nu^2)/E. It follows the radii, so
    that a swept clearance changes it.

    **Arguments:** Young's moduli in Pa and Poisson's ratios of bearing and journal; the journal's
    are the bearing's unless given.
    """

    young_modulus: Single = quantity("Pa", positive=True, usual=SOLIDS, remedy=_GIVE_MODULUS)
    poisson_ratio: Single = quantity("1", within=(-1.0, 0.5), remedy="give nu of the material")
    journal_young_modulus: Single | None = optional_quantity(
        "Pa", positive=True, usual=SOLIDS, remedy=_GIVE_MODULUS
    )
    journal_poisson_ratio: Single | None = optional_quantity(
        "1", within=(-1.0, 0.5), remedy="give nu of the material"
    )

    def value(self, gap: Gap) -> Scalar:
        """The stiffness K in N/m^1.5, by the radii of bearing and journal."""
        assert gap.bearing_radius is not None and gap.clearance is not None
        modulus = self.journal_young_modulus
        ratio = self.journal_poisson_ratio
        modulus = self.young_modulus if modulus is None else modulus
        ratio = self.poisson_ratio if ratio is None else ratio
        compliance = (1 - self.poisson_ratio**2) / self.young_modulus + (1 - ratio**2) / modulus
        radii = gap.bearing_radius * gap.journal_radius
        return 4.0 / (3.0 * compliance) * jnp.sqrt(radii / gap.clearance)


def as_stiffness(value: object) -> AbstractStiffness:
    """The stiffness given, or a `GivenStiffness` of a number in N/m^n."""
    return value if isinstance(value, AbstractStiffness) else GivenStiffness(as_number(value))
