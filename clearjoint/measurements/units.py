"""Conversion of units to SI by pint.

The units are those of pint's application registry, in which users can define their own
(`pint.get_application_registry().define`).
"""

import math
import re
from typing import TYPE_CHECKING

from ..fields.checks import require

if TYPE_CHECKING:
    import pint

LONGEST = 100
"""Largest number of characters in a unit."""
LARGEST_POWER = 1000
"""Largest product of the magnitudes of all powers in a unit. Without a limit, pint would compute
integers that exhaust the memory."""
POWER = re.compile(r"\*\*\(?[+-]?(\d{1,2}(?:\.\d*)?)(?:/\d{1,2})?(?!\d)\)?")
"""A power with a small exponent, such as "**2" or "**(-1/2)"."""
# The remedy in error messages about a unit.
SPELLING = 'write for example "mm", "deg", "N m", "m/s^2", "g_0" or "1"'


def to_si(unit: str, si: str | None) -> tuple[float, str]:
    """Return the factor that converts values from a unit to an SI unit, and the SI unit as text.

    The first result times a value in `unit` is the value in the second result.

    **Arguments:**

    - `unit`: any unit that pint knows, such as "mm" or "rpm".
    - `si`: the SI unit to convert to; ``None`` for the SI base unit of the same dimension.

    **Raises:** `ValueError` for an unknown unit, a unit of another dimension, a frequency in Hz
    where an angular speed is expected, a unit that is not a multiple of the SI unit, such as a
    level in dB, and a unit that is too long or has too large powers to be converted quickly.
    """
    import pint  # Importing it takes a quarter of a second, so it is imported only when needed.

    registry = pint.get_application_registry()
    source = _pint_unit(registry, unit)
    target = registry.get_base_units(source)[1] if si is None else registry.Unit(si)
    expected = f"a unit of {'SI' if si is None else si!r}"
    remedy = f"check the column and its channel; {source} has dimension {source.dimensionality}"
    require(source.is_compatible_with(target), "unit", unit, expected, remedy)
    # To pint, a radian is dimensionless, so that 1 Hz would silently become 1 rad/s.
    cycles = "hertz" in str(source) and "radian" in str(target)
    require(not cycles, "unit", unit, f"{expected}, not cycles", 'write "rpm" or "turn/s"')
    # A level or a temperature in degrees Celsius has no single factor: it would convert wrongly. A
    # conversion by a factor gives 0 for 0, and for 2 twice as much as for 1, apart from rounding.
    zero, one, two = (registry.convert(number, source, target) for number in (0.0, 1.0, 2.0))
    linear = abs(zero) + abs(two - 2.0 * one) <= 1e-12 * abs(one)
    require(linear, "unit", unit, f"a multiple of {target}", "convert the values beforehand")
    if si is not None:
        return float(one), si
    # A unit that is an SI unit already keeps the spelling of the user.
    return float(one), unit if one == 1.0 else f"{target:~C}" or "1"


def _pint_unit(registry: "pint.registry.ApplicationRegistry", unit: str) -> "pint.Unit":
    """Return the unit of pint that a text names.

    **Raises:** `ValueError` for an unknown unit, and for one that is too long or has too large
    powers, see `LONGEST` and `LARGEST_POWER`.
    """
    from pint.util import string_preprocessor

    # Units come from headers of files, so pint's parser must not be given an expression that takes
    # it very long. Only powers with small exponents are accepted, and no powers of powers: after
    # every accepted power has become "#", neither "##" nor "**" may be left.
    require(len(unit) <= LONGEST, "unit", unit, f"at most {LONGEST} characters", SPELLING)
    plain = string_preprocessor(unit).replace(" ", "")
    powers = POWER.findall(plain)
    chained = "##" in (rest := POWER.sub("#", plain)) or "**" in rest
    small = math.prod(max(float(power), 1.0) for power in powers) <= LARGEST_POWER
    expected = "a unit whose powers are small numbers"
    require(small and not chained, "unit", unit, expected, SPELLING)
    try:
        known = registry.Unit(unit)
        registry.get_base_units(known)  # Overflows for a prefix with a large power.
    except Exception as error:  # pint raises many kinds of errors, including its tokenizer's.
        raise ValueError(
            f"Argument `unit` must be a unit that pint knows, but is {unit!r}: {SPELLING}."
        ) from error
    return known
