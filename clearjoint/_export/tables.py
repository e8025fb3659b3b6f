"""Text of reports: tables with aligned columns, numbers, durations and numbered sentences."""

import math
from collections.abc import Mapping, Sequence

import numpy as np


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of an aligned table: the first row is the head, the first column labels."""
    import pandas as pd

    (corner, *head), *body = rows
    labels = [label for label, *_ in body]
    table = pd.DataFrame([cells for _, *cells in body], labels, pd.Index(head, name=corner))
    return [line.rstrip() for line in table.to_string().splitlines()]


def percent(share: float) -> str:
    return f"{number(100.0 * share)} %" if np.isfinite(share) else "-"


def number(value: float, digits: int = 2) -> str:
    # A number that is not finite has no digits. Rounded first: 100 would otherwise be "1e+02".
    return f"{float(f'{value:.{digits}g}'):g}" if np.isfinite(value) else "-"


def estimates_table(
    estimates: Mapping[str, float],
    errors: Mapping[str, float],
    intervals: Mapping[str, tuple[float, float]],
    units: Mapping[str, str],
) -> str:
    rows = [["parameter", "estimate", "standard error", "95 % from", "to", "unit"]]
    for name, value in estimates.items():
        digits = _digits(value, errors[name])
        # The format keeps zeros at the end, which are significant.
        numbers = [f"{number:#.{digits}g}".rstrip(".") for number in (value, *intervals[name])]
        rows.append([name, numbers[0], f"{errors[name]:.2g}", *numbers[1:], units[name]])
    return "\n".join(aligned(rows))


def _digits(value: float, error: float) -> int:
    """Return the number of significant digits, 2 to 15, that show a value down to the second digit
    of its `error`; 4 for a value of zero, or an error that is not finite and positive."""
    if not 0.0 < error < math.inf or value == 0.0:
        return 4
    size = math.floor(math.log10(abs(value))) - math.floor(math.log10(error))
    return min(max(size + 2, 2), 15)


def duration(seconds: float) -> str:  # "0.23 s", "68 s", "3 min 20 s" or "1 h 7 min"
    if seconds < 9.95:
        return f"{seconds:.2g} s"
    rounded = round(seconds)
    if rounded < 120:
        return f"{rounded} s"
    minutes, rest = divmod(rounded, 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    return f"{minutes // 60} h {minutes % 60} min"


def numbered(sentences: Sequence[str]) -> str:
    return "\n".join(f"{number}. {sentence}" for number, sentence in enumerate(sentences, 1))
