"""Tables of a fit's report, as text."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from ..information.text_tables import aligned
from .screening.screening import Screened
from .searches import Search


def estimates_table(
    estimates: Mapping[str, float],
    errors: Mapping[str, float],
    intervals: Mapping[str, tuple[float, float]],
    units: Mapping[str, str],
) -> str:
    """Return a table with a row for each parameter: estimate, standard error, interval and unit.

    All arguments are by name of the parameter.
    """
    rows = [["parameter", "estimate", "standard error", "95 % from", "to", "unit"]]
    for name, value in estimates.items():
        digits = _digits(value, errors[name])
        numbers = [f"{number:#.{digits}g}".rstrip(".") for number in (value, *intervals[name])]
        rows.append([name, numbers[0], f"{errors[name]:.2g}", *numbers[1:], units[name]])
    return "\n".join(aligned(rows))


def _digits(value: float, error: float) -> int:
    """Return how many digits of a value to show, so that two digits of its error are visible."""
    if not 0.0 < error < math.inf or value == 0.0:
        return 4
    size = math.floor(math.log10(abs(value))) - math.floor(math.log10(error))
    return min(max(size + 2, 2), 15)


def series_table(
    residuals: Mapping[str, np.ndarray],
    rms: Mapping[str, float],
    whiteness: Mapping[str, float],
    normality: Mapping[str, float],
) -> str:
    """Return a table of the series: number of samples, and tests of the residuals, all by name."""
    rows = [["series", "samples", "rms / noise", "p (white)", "p (normal)"]]
    for name, row in residuals.items():
        cells = [f"{rms[name]:.3f}", f"{whiteness[name]:.2g}", f"{normality[name]:.2g}"]
        rows.append([name, str(len(row)), *cells])
    return "\n".join(aligned(rows))


def correlation_table(names: Sequence[str], correlation: Float[np.ndarray, "p p"]) -> str:
    """Return a table of the correlations (p, p) of the estimates of the p named parameters."""
    rows = [["correlation", *names]]
    for name, row in zip(names, correlation, strict=True):
        rows.append([name, *(f"{number:.4f}" for number in row)])
    return "\n".join(aligned(rows))


def numbered(sentences: Sequence[str]) -> str:
    """Return sentences as lines with the numbers 1, 2 and so on."""
    return "\n".join(f"{number}. {sentence}" for number, sentence in enumerate(sentences, 1))


def searches_table(searches: Sequence[Search], best: Search, screened: Sequence[Screened]) -> str:
    """Return a table of the searches, the best one marked by a star.

    With results of a screening, a line about its runs and rounds precedes the table.
    """
    rows = [["start", "chi squared", "runs", "ended"]]
    for number, search in enumerate(searches):
        mark = " *" if search is best else ""
        chi_squared, runs = f"{search.best.chi_squared:.6g}", str(search.evaluations)
        rows.append([f"{number}{mark}", chi_squared, runs, search.ending.value])
    table = "\n".join(aligned(rows))
    if not screened:
        return table
    runs = sum(one.runs for one in screened)
    rounds = sum(len(one.times) for one in screened)
    return f"starts from screening by {runs} runs in {rounds} rounds:\n{table}"
