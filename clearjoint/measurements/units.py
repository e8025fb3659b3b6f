"""Units of measured data, converted to SI by pint and its application registry.

Units that a user defines there (`pint.get_application_registry().define`) hold here, too.
"""

import math
import re
from typing import TYPE_CHECKING

from ..fields.checks import require

if TYPE_CHECKING:
    import pint

LONGEST = 100
"""Characters of a unit."""
LARGEST_POWER = 1000
"""The product of all powers in a unit: Python's integers grow until memory ends."""
POWER = re.compile(r"\*\*\(?[+-]?(\d{1,2}(?:\.\d*)?)(?:/\d{1,2})?(?!\d)\)?")
SPELLING = 'write for example "mm", "deg", "N m", "m/s^2", "g_0" or "1"'


def to_si(unit: str, si: str | None) -> tuple[float, str]:
    """Factor from a unit to SI, and the SI unit.

    **Arguments:** `si`: the unit to arrive at; ``None`` for whatever SI has for that dimension.

    **Raises:** `ValueError` for a unit that pint does not know, one of another dimension, and one
    that is no multiple of the SI unit, such as a level in dB.
    """
    import pint  # a quarter of a second, which only measured data cost

    registry = pint.get_application_registry()
    own = _pint_unit(registry, unit)
    target = registry.get_base_units(own)[1] if si is None else registry.Unit(si)
    expected = f"a unit of {'SI' if si is None else si!r}"
    remedy = f"check the column and its channel; {own} has dimension {own.dimensionality}"
    require(own.is_compatible_with(target), "unit", unit, expected, remedy)
    cycles = "hertz" in str(own) and "radian" in str(target)
    require(not cycles, "unit", unit, f"{expected}, not cycles", 'write "rpm" or "turn/s"')
    zero, one, two = (registry.convert(number, own, target) for number in (0.0, 1.0, 2.0))
    linear = abs(zero) + abs(two - 2.0 * one) <= 1e-12 * abs(one)
    require(linear, "unit", unit, f"a multiple of {target}", "convert the values beforehand")
    if si is not None:
        return float(one), si
    return float(one), unit if one == 1.0 else f"{target:~C}" or "1"


def _pint_unit(registry: "pint.registry.ApplicationRegistry", unit: str) -> "pint.Unit":
    from pint.util import string_preprocessor

    require(len(unit) <= LONGEST, "unit", unit, f"at most {LONGEST} characters", SPELLING)
    plain = string_preprocessor(unit).replace(" ", "")
    powers = POWER.findall(plain)
    chained = "##" in (rest := POWER.sub("#", plain)) or "**" in rest
    small = math.prod(max(float(power), 1.0) for power in powers) <= LARGEST_POWER
    expected = "a unit whose powers are small numbers"
    require(small and not chained, "unit", unit, expected, SPELLING)
    try:
        found = registry.Unit(unit)
        registry.get_base_units(found)  # overflows for a prefix with a large power
    except Exception as error:  # pint raises errors of many kinds, its tokenizer's among them
        raise ValueError(
            f"Argument `unit` must be a unit that pint knows, but is {unit!r}: {SPELLING}."
        ) from error
    return found
