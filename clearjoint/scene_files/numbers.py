"""Convert texts such as "0.5 mm" and "207 GPa" to numbers in SI units."""

import math
import re
import sys
from decimal import Decimal

from ..measurements.units import to_si
from .locations import FileLocation

NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?inf)(?:\s+|(?=\D)|$)(.*)")

LONGEST = 200
"""Longest text, in characters, that is read as a number with a unit."""


def number_of_text(text: str, unit: str | None, location: FileLocation) -> float:
    """Return the number of a text such as "0.3 mm" in an SI unit. It is rounded once: "0.3 mm" is
    exactly the float 3e-4.

    **Arguments:** `unit`: the SI unit, None if no unit is declared; `location`: for messages.

    **Raises:** `ValueError` for a text without a number, for a unit of another dimension than
    `unit`, and for a unit where none is declared.
    """
    expected = "a number" if unit is None else f"a number in {unit}"
    matched = NUMBER.fullmatch(text) if len(text) <= LONGEST else None
    if matched is None:
        location.refuse(text, expected, "write a number, in quotes only if it has a unit")
    digits, written = matched[1], matched[2].strip()
    number = float(digits)
    if math.isinf(number) and "inf" not in digits:
        location.refuse(text, f"a number below {sys.float_info.max:.2g}", "write a smaller one")
    if not written:
        return number
    if unit is None:
        remedy = "write a plain number in SI units; fields made by `quantity` convert units"
        location.refuse(text, "a number without a unit, since none is declared", remedy)
    try:
        factor, _ = to_si(written, unit)
    except ValueError as error:
        raise ValueError(
            f"{location}: found {text!r}, expected {expected}: write a unit of this dimension, "
            f"or a plain number in {unit}."
        ) from error
    # The product of the decimal digits is exact; float() rounds it once.
    return float(Decimal(digits) * Decimal(repr(factor))) if math.isfinite(number) else number
