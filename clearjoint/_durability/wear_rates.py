"""Specific wear rates of the two parts of a joint with clearance: bearing and journal."""

from dataclasses import dataclass
from typing import Annotated, Literal

from .._fields.checks import nearest, require, require_positive

Part = Literal["bearing", "journal"]
PARTS: tuple[Part, Part] = ("bearing", "journal")
PROFILES = tuple(f"{part}_profile" for part in PARTS)
Material = Literal[
    "brass",
    "copper-beryllium",
    "mild steel",
    "PMMA",
    "polythene",
    "PTFE",
    "stainless steel",
    "tool steel",
]
"""Materials with a typical wear rate."""
COEFFICIENT_AND_HARDNESS: dict[Material, tuple[float, float]] = {
    "brass": (6e-4, 1.0e9),
    "copper-beryllium": (3.7e-5, 2.1e9),
    "mild steel": (7e-3, 1.8e9),
    "PMMA": (7e-6, 0.2e9),
    "polythene": (1.3e-7, 0.017e9),
    "PTFE": (2.5e-5, 0.05e9),
    "stainless steel": (1.7e-5, 2.5e9),
    "tool steel": (1.3e-4, 8.5e9),
}
"""Wear coefficient k, without unit, and typical hardness H, Pa, of each material. k is for
unlubricated sliding on hard steel, except for mild steel, which slides on mild steel (J. F.
Archard, J. Appl. Phys. 24, 1953, 981)."""


@dataclass(frozen=True)
class WearRates:
    """Specific wear rates of the bearing and of the journal of a joint, m^2/N.

    A rate is the worn volume divided by the normal force and by the sliding distance. It equals
    Archard's coefficient over the hardness, k/H. Tables often have mm^3/(N m), which is 1e-9 m^2/N.
    A part with the rate zero, the default, doesn't wear. `on_hard_steel` gives typical rates.

    **Raises:** `ValueError` if a rate is negative or not finite, or both are zero.

    >>> cj.WearRates(bearing=5.05e-4 * 1e-9)  # PTFE against steel, 5.05e-4 mm^3/(N m)
    WearRates(bearing=5.050000000000001e-13, journal=0.0)
    """

    bearing: Annotated[float, "m^2/N"] = 0.0
    journal: Annotated[float, "m^2/N"] = 0.0

    def __post_init__(self):
        for part in PARTS:
            remedy = "give it in m^2/N; 1 mm^3/(N m) is 1e-9 m^2/N"
            require_positive(part, getattr(self, part), remedy, zero=True)
        remedy = "give the rate of one part at least"
        require(self.bearing + self.journal > 0.0, "bearing", 0.0, "positive", remedy)

    @staticmethod
    def on_hard_steel(material: Material, part: Part = "bearing") -> "WearRates":
        """Return `WearRates` with the typical rate of a material, such as "brass", of the bearing
        or journal that slides on hard steel without a lubricant. The other part doesn't wear.

        Measured rates scatter by a factor of ten, and lubrication reduces them by a factor of a
        hundred or more. The rate for mild steel is that of mild steel on mild steel.

        **Raises:** `ValueError` for an unknown material or part.

        >>> print(f"{cj.WearRates.on_hard_steel('brass').bearing:.0e} m^2/N")
        6e-13 m^2/N
        """
        materials = list(COEFFICIENT_AND_HARDNESS)
        remedy = nearest(material, materials, "pass the rate itself: WearRates(bearing=...)")
        expected = f"one of {', '.join(materials)}"
        require(material in materials, "material", material, expected, remedy)
        require(part in PARTS, "part", part, " or ".join(PARTS), "name one of them")
        coefficient, hardness = COEFFICIENT_AND_HARDNESS[material]
        return WearRates(**{part: coefficient / hardness})
