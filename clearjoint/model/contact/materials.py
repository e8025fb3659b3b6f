"""The materials of bearing and journal."""

from ...fields.conversion import AbstractConverting
from ...fields.declarations import optional_quantity, quantity
from ...fields.types import Single
from ...math.vectors import Scalar

SOLIDS = 1e9, 2e12
"""Young's moduli, Pa, between which the materials of bearings lie: plastics and diamond."""
_GIVE_MODULUS = "give E in Pa; 1 GPa is 1e9 Pa"


class AbstractMaterialPair(AbstractConverting):
    """Young's moduli in Pa and Poisson's ratios of bearing and journal; the journal's are the
    bearing's unless given."""

    young_modulus: Single = quantity("Pa", positive=True, usual=SOLIDS, remedy=_GIVE_MODULUS)
    poisson_ratio: Single = quantity("1", within=(-1.0, 0.5), remedy="give nu of the material")
    journal_young_modulus: Single | None = optional_quantity(
        "Pa", positive=True, usual=SOLIDS, remedy=_GIVE_MODULUS
    )
    journal_poisson_ratio: Single | None = optional_quantity(
        "1", within=(-1.0, 0.5), remedy="give nu of the material"
    )

    def compliance(self) -> Scalar:
        """Both (1 - nu^2)/E together, 1/Pa: one over the contact modulus E*."""
        modulus = self.journal_young_modulus
        ratio = self.journal_poisson_ratio
        modulus = self.young_modulus if modulus is None else modulus
        ratio = self.poisson_ratio if ratio is None else ratio
        return (1 - self.poisson_ratio**2) / self.young_modulus + (1 - ratio**2) / modulus
