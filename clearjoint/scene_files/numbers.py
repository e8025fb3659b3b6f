"""Numbers with units as text: "0.5 mm", "207 GPa"."""

import math
import re
import sys
from decimal import Decimal

from ..measurements.units import to_si
from .complaints import FilePlace

NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?inf)(?:\s+|(?=\D)|$)(.*)")

LONGEST = 200
"""Characters of a text that may be a number with its unit."""


def number_of_text(text: str, unit: str | None, place: FilePlace) -> float:
    """The number in the SI unit, rounded once: "0.3 mm" is 3e-4 m to the last bit.

    **Raises:** `ValueError` for text without a number, a unit of another dimension, and for a
    unit where none is declared.
    """
    matched = NUMBER.fullmatch(text) if len(text) <= LONGEST else None
    if matched is None:
        place.refuse(text, _expected(unit), "give a number, in quotes only if with a unit")
    number, written = matched[1], matched[2].strip()
    if math.isinf(float(number)) and "inf" not in number:
        place.refuse(text, f"a number below {sys.float_info.max:.2g}", "write a smaller one")
    if not written:
        return float(number)
    if unit is None:
        remedy = "write a plain number in SI units; fields made by `quantity` convert units"
        place.refuse(text, "a number without a unit, since none is declared", remedy)
    try:
        factor, _ = to_si(written, unit)
    except ValueError as error:
        raise ValueError(
            f"{place}: found {text!r}, expected {_expected(unit)}: write a unit of this dimension, "
            f"or a plain number in {unit}."
        ) from error
    value = float(number)
    return float(Decimal(number) * Decimal(repr(factor))) if math.isfinite(value) else value


def _expected(unit: str | None) -> str:
    return "a number" if unit is None else f"a number in {unit}"
