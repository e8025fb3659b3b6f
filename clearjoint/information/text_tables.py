"""Tables of numbers as lines of text, for `print`."""

from collections.abc import Sequence

import numpy as np


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table whose first row is the head, with aligned columns: the first to the left,
    the others to the right."""
    import pandas as pd

    (corner, *head), *body = rows
    labels = [label for label, *_ in body]
    columns = pd.Index(head, name=corner)
    table = pd.DataFrame([cells for _, *cells in body], labels, columns)
    return [line.rstrip() for line in table.to_string().splitlines()]


def percent(share: float) -> str:
    """A share in percent with two digits, "-" if it is not finite."""
    return f"{100.0 * share:.2g} %" if np.isfinite(share) else "-"


def number(value: float, digits: int = 2) -> str:
    """A number with so many digits, "-" if it is not finite."""
    return f"{value:.{digits}g}" if np.isfinite(value) else "-"
