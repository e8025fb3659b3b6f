"""Normal contact laws: the force from penetration, its rate, and the memory of the impact.

All laws here are of the Hunt-Crossley family F = K delta^n (1 + chi rate/entry speed); they differ
in chi. A law of another form subclasses `AbstractContactLaw`; `clearjoint.testing.check_law` tells
whether it behaves.
"""

import abc
from typing import Any

import jax.numpy as jnp

from ...fields.checks import (
    as_number,
    caution_above,
    caution_below,
    optional_quantity,
    quantity,
    require_positive,
    require_range,
)
from ...fields.conversion import AbstractConverting
from ...math.vectors import Scalar
from .gap import Gap

SOFTEST_SOLID, STIFFEST_SOLID = 1e9, 2e12
"""Young's moduli, Pa, between which the materials of bearings lie: plastics and diamond."""
SOFTEST_CONTACT = 1e6
"""Generalised stiffness, N/m^n, below which a newton presses the surfaces together by a tenth of a
millimetre."""


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
        """K in N/m^n."""


class GivenStiffness(AbstractStiffness):
    """A stiffness known from elsewhere, N/m^n."""

    stiffness: Any = quantity("N/m^n")

    def __check_init__(self):
        require_positive("stiffness", self.stiffness, "give K in N/m^n")
        caution_below(
            "stiffness",
            self.stiffness,
            "N/m^n",
            SOFTEST_CONTACT,
            "give K in N and m",
        )

    def value(self, gap: Gap) -> Scalar:
        """K in N/m^n."""
        return self.stiffness


class RavnStiffness(AbstractStiffness):
    """Internal contact of two spherical surfaces (P. Ravn 1998; Flores et al. 2006, section 4).

    K = 4/(3 (s_i + s_j)) sqrt(R_i R_j/(R_i - R_j)) with s = (1 - nu^2)/E. It follows the radii, so
    that a swept clearance changes it.

    **Arguments:** Young's moduli in Pa and Poisson's ratios of bearing and journal; the journal's
    are the bearing's unless given.
    """

    young_modulus: Any = quantity("Pa")
    poisson_ratio: Any = quantity("1")
    journal_young_modulus: Any = optional_quantity("Pa")
    journal_poisson_ratio: Any = optional_quantity("1")

    def __check_init__(self):
        self._check_modulus("young_modulus")
        require_range("poisson_ratio", self.poisson_ratio, -1.0, 0.5, "give nu of the material")
        if self.journal_young_modulus is not None:
            self._check_modulus("journal_young_modulus")
        if self.journal_poisson_ratio is not None:
            require_range("journal_poisson_ratio", self.journal_poisson_ratio, -1.0, 0.5, "give nu")

    def _check_modulus(self, name: str) -> None:
        modulus = getattr(self, name)
        require_positive(name, modulus, "give E in Pa")
        caution_below(name, modulus, "Pa", SOFTEST_SOLID, "give E in Pa; 1 GPa is 1e9 Pa")
        caution_above(name, modulus, "Pa", STIFFEST_SOLID, "give E in Pa; 1 GPa is 1e9 Pa")

    def value(self, gap: Gap) -> Scalar:
        """K in N/m^1.5."""
        assert gap.bearing_radius is not None and gap.clearance is not None
        modulus = self.journal_young_modulus
        ratio = self.journal_poisson_ratio
        modulus = self.young_modulus if modulus is None else modulus
        ratio = self.poisson_ratio if ratio is None else ratio
        compliance = (1 - self.poisson_ratio**2) / self.young_modulus + (1 - ratio**2) / modulus
        radii = gap.bearing_radius * gap.journal_radius
        return 4.0 / (3.0 * compliance) * jnp.sqrt(radii / gap.clearance)


def _as_stiffness(value: Any) -> AbstractStiffness:
    return value if isinstance(value, AbstractStiffness) else GivenStiffness(as_number(value))
