"""Tables as text."""

from collections.abc import Sequence

import numpy as np


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table with aligned columns, the first to the left, the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]).rstrip()
        for row in rows
    ]


def percent(share: float) -> str:
    """A share with two digits, "-" if there is none."""
    return f"{100.0 * share:.2g} %" if np.isfinite(share) else "-"


def number(value: float, digits: int = 2) -> str:
    """A number with so many digits, "-" if it is not finite."""
    return f"{value:.{digits}g}" if np.isfinite(value) else "-"
