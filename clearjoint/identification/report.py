"""A fit as text."""

import math
from typing import Any

from ..information.text_tables import aligned


def report(fit: Any) -> str:
    """Estimates, goodness of fit, series, correlations, warnings of a `Fit`, as aligned tables."""
    parts = [_head(fit), _estimates(fit), _goodness(fit), _series(fit)]
    if len(fit.parameters) > 1:
        parts.append(_correlation(fit))
    if len(fit.searches) > 1:
        parts.append(_searches(fit))
    parts.append("\n".join(f"Warning: {warning}" for warning in fit.warnings))
    return "\n\n".join(part for part in parts if part)


def _head(fit: Any) -> str:
    end = fit.measurements.times()[-1]
    return (
        f"Fit of {fit.samples} samples in {len(fit.measurements.series)} series to {end:g} s: "
        f"{fit.ending.value}, {fit.best.evaluations} runs"
    )


def _estimates(fit: Any) -> str:
    rows = [["parameter", "estimate", "standard error", "95 % from", "to", "unit"]]
    errors, intervals = fit.standard_errors, fit.intervals
    for name, value in fit.estimates.items():
        digits = _digits(value, errors[name])
        shown = [f"{number:#.{digits}g}".rstrip(".") for number in (value, *intervals[name])]
        rows.append([name, shown[0], f"{errors[name]:.2g}", *shown[1:], fit.units[name]])
    return "\n".join(aligned(rows))


def _digits(value: float, error: float) -> int:
    """Significant digits that show two of the error."""
    if not 0.0 < error < math.inf or value == 0.0:
        return 4
    size = math.floor(math.log10(abs(value))) - math.floor(math.log10(error))
    return min(max(size + 2, 2), 15)


def _goodness(fit: Any) -> str:
    return (
        f"chi squared {fit.chi_squared:.6g} with {fit.freedom} degrees of freedom, "
        f"p = {fit.p_value:.2g}"
    )


def _series(fit: Any) -> str:
    rows = [["series", "samples", "rms / noise", "p (white)", "p (normal)"]]
    rms, white, normal = fit.rms, fit.whiteness, fit.normality
    for name, row in fit.residuals.items():
        cells = [f"{rms[name]:.3f}", f"{white[name]:.2g}", f"{normal[name]:.2g}"]
        rows.append([name, str(len(row)), *cells])
    return "\n".join(aligned(rows))


def _correlation(fit: Any) -> str:
    rows = [["correlation", *fit.parameters]]
    for name, row in zip(fit.parameters, fit.correlation, strict=True):
        rows.append([name, *(f"{number:.4f}" for number in row)])
    return "\n".join(aligned(rows))


def _searches(fit: Any) -> str:
    rows = [["start", "chi squared", "runs", "ended"]]
    for number, search in enumerate(fit.searches):
        chosen = " *" if search is fit.best else ""
        chi_squared, runs = f"{search.best.chi_squared:.6g}", str(search.evaluations)
        rows.append([f"{number}{chosen}", chi_squared, runs, search.ending.value])
    table = "\n".join(aligned(rows))
    if not fit.screened:
        return table
    runs = sum(one.runs for one in fit.screened)
    rounds = sum(len(one.times) for one in fit.screened)
    return f"from screening by {runs} runs in {rounds} rounds:\n{table}"
