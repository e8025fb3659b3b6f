"""Tables of numbers as text."""

from collections.abc import Sequence

import numpy as np


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of a table with aligned columns.

    **Arguments:** `rows`: the texts of each row, of equal number; the first row is the head, and
    the first text of every row its label.
    """
    import pandas as pd

    (corner, *head), *body = rows
    labels = [label for label, *_ in body]
    columns = pd.Index(head, name=corner)
    table = pd.DataFrame([cells for _, *cells in body], labels, columns)
    return [line.rstrip() for line in table.to_string().splitlines()]


def percent(share: float) -> str:
    """Return `share` in percent as text with two digits; "-" if it is not finite."""
    return f"{100.0 * share:.2g} %" if np.isfinite(share) else "-"


def number(value: float, digits: int = 2) -> str:
    """Return `value` as text with `digits` significant digits; "-" if it is not finite."""
    return f"{value:.{digits}g}" if np.isfinite(value) else "-"
