"""Text of a fit's report: tables, and remedies for residuals far above the noise."""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from ..information.fisher_information import aligned
from ..information.horizon import FitHorizon
from ..measurements.series import Measurements
from ..parametrisation.parameter import Parameter
from ..parametrisation.variations import SeriesDelay, StateNumber
from . import goodness_of_fit as statistics
from .levenberg_marquardt import Ending, Search
from .screening.screening import Screened

FAR = 2.0
"""Ratio of residuals to stated noise above which they count as far above the noise."""
GOOD = 1.5
"""Ratio of residuals to stated noise up to which a series counts as well fitted."""
PIECES = 20
"""Number of equal pieces of the record, of which the first with large residuals is found. Series
with fewer samples are not examined for delays and outliers."""
DOUBLINGS = 5
"""Number of growing windows to suggest, each twice as long as the one before it."""
MOST = 0.5
"""Share of chi squared above which one cause counts as the main cause."""
FEW = 0.02
"""Share of the samples that may be outliers: the largest residuals are summed over this share."""
UNCORRELATED = 1e-3
"""p-value of the test of whiteness below which residuals are not white."""


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
        # The format keeps zeros at the end, which are significant.
        numbers = [f"{number:#.{digits}g}".rstrip(".") for number in (value, *intervals[name])]
        rows.append([name, numbers[0], f"{errors[name]:.2g}", *numbers[1:], units[name]])
    return "\n".join(aligned(rows))


def _digits(value: float, error: float) -> int:
    """Return how many digits of a value to show, so that two digits of its error are visible.

    There are 4 for a value of zero and without a finite, positive error; otherwise at least 2, and
    at most the 15 digits of a 64-bit float.
    """
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
    """Return a table with a row for each measured series.

    **Arguments**, all by name of the series:

    - `residuals`: (N,) for N samples, without unit; only their number is shown.
    - `rms`: root mean square of the residuals, in multiples of the noise.
    - `whiteness`, `normality`: p-values of the tests that the residuals are white and normal.
    """
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
    """Return a table with a row for each search, the best one marked by a star.

    With results of a screening, a line about its runs and rounds precedes the table.

    **Arguments:** `screened`: result of each pass of the screening; empty without one.
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


def remedies(
    measurements: Measurements,
    parameters: Mapping[str, Parameter],
    predictions: Mapping[str, np.ndarray],
    residuals: Mapping[str, np.ndarray],
    searches: Sequence[Search],
    best: Search,
    scatter: float,
    screened: bool,
    horizon: FitHorizon | None,
) -> Iterator[str]:
    """Yield sentences on remedies for a poor fit, the cheapest and most likely first.

    **Arguments:**

    - `measurements`, `parameters`: the data, and the estimated parameters by name.
    - `searches`: the search from each start; `best`: the one with the smallest chi squared.
    - `predictions`, `residuals`: (N,) of each series by name, SI and in standard deviations.
    - `scatter`: square root of chi squared per degree of freedom, 1 for the stated noise.
    - `screened`: whether a screening, many runs without derivatives, found the starts.
    - `horizon`: result of `fit_horizon`, which has the length of the record that a single run can
      fit, ``None`` if the user gave none.
    """
    # A missing effect would leave a trace in the residuals, which would then be correlated.
    if all(statistics.whiteness(row) > UNCORRELATED for row in residuals.values()):
        yield (
            "Residuals are white: the model fits, and the noise may be understated. If the sensors "
            f"can be that noisy, state a noise {scatter:.3g} times as large."
        )
    sizes = {name: _rms(row) for name, row in residuals.items()}
    worst = max(sizes, key=lambda name: sizes[name])
    others = [size for name, size in sizes.items() if name != worst]
    # If the model fits all other series, the fault is probably in the sensor of this one.
    if others and max(others) <= GOOD:
        yield (
            f"Only series {worst!r} does not fit: its residuals are {sizes[worst]:.3g} times its "
            "noise. Check its unit, sign, axes and noise, and the position of the sensor."
        )
    yield from _delays(measurements, parameters, predictions, residuals)
    yield from _outliers(measurements, residuals)
    yield from _shorter_records(measurements, residuals, horizon, len(best.windows))
    if len(searches) == 1 and not screened:
        yield (
            "Search from several starts, by starts=cj.Starts(8). If impacts make chi squared "
            "rough, screen starts without derivatives, by starts=cj.Screening(...)."
        )
    else:
        # Searches that end in one minimum differ in chi squared by less than a hundredth.
        ends = [search.best.chi_squared for search in searches]
        yield (
            f"The {len(ends)} searches ended at chi squared from {min(ends):.3g} to "
            f"{max(ends):.3g}: "
            + (
                "all in one minimum. The model probably lacks an effect."
                if max(ends) < 1.01 * min(ends)
                else "in several minima. Use more starts, or a wider spread."
            )
        )
    if best.ending is Ending.EXHAUSTED:
        number = best.evaluations
        yield f"The search had not converged after {number} runs: increase max_iterations."
    if not any(isinstance(one.variation, StateNumber) for one in parameters.values()):
        yield (
            "Estimate the initial state too, unless it is known more accurately than the noise, "
            'for example by cj.Parameter.initial(lambda state: state.bodies["..."].spin[2]).'
        )


def _delays(
    measurements: Measurements,
    parameters: Mapping[str, Parameter],
    predictions: Mapping[str, np.ndarray],
    residuals: Mapping[str, np.ndarray],
) -> Iterator[str]:
    """Yield a sentence on the first series whose misfit is mainly that of a delayed clock.

    **Arguments:** as in `remedies`.
    """
    variations = [parameter.variation for parameter in parameters.values()]
    estimated = {name for one in variations if isinstance(one, SeriesDelay) for name in one.series}
    for name, series in measurements.series.items():
        if len(series) < PIECES:  # Too few samples to tell a delay from other causes.
            continue
        # A small delay adds delay * rate to the residuals. Least squares gives the delay that
        # explains most of them.
        rate = np.gradient(predictions[name], np.asarray(series.times)) / np.asarray(series.noise)
        row = residuals[name]
        power = float(rate @ rate)
        shift = float(row @ rate) / power if power > 0.0 else 0.0
        # The share of the mean square that a shift removes; the minimum is for residuals of zero.
        explained = 1.0 - _rms(row - shift * rate) ** 2 / max(_rms(row) ** 2, 1e-300)
        if explained > MOST and _rms(row) > FAR:
            direction = "late" if shift > 0.0 else "early"
            remedy = (
                "start its delay from another guess"
                if name in estimated
                else f"estimate its delay, by a parameter cj.Parameter.delay({name!r})"
            )
            yield (
                f"Series {name!r} seems {abs(shift):.3g} s {direction}, which would explain "
                f"{explained:.0%} of its misfit: check its clock and its trigger, or {remedy}."
            )
            return


def _outliers(measurements: Measurements, residuals: Mapping[str, np.ndarray]) -> Iterator[str]:
    """Yield a sentence if few samples, the share `FEW`, contribute most of chi squared.

    **Arguments:** as in `remedies`.
    """
    rows = np.concatenate(list(residuals.values())) ** 2
    count = max(int(FEW * len(rows)), 1)
    largest = np.sort(rows)[::-1][:count]
    if len(rows) >= PIECES and largest.sum() >= MOST * rows.sum():
        name, worst = max(residuals.items(), key=lambda item: float(np.abs(item[1]).max()))
        time = float(measurements[name].times[np.argmax(np.abs(worst))])
        yield (
            f"{count} of {len(rows)} samples contribute {largest.sum() / rows.sum():.0%} of chi "
            f"squared, the worst at {time:.6g} s in {name!r}: remove outliers, or state a larger "
            "noise for these samples. Times of impact peaks are the first to deviate."
        )


def _shorter_records(
    measurements: Measurements,
    residuals: Mapping[str, np.ndarray],
    horizon: FitHorizon | None,
    windows: int,
) -> Iterator[str]:
    """Yield sentences that advise to fit a shorter record, or growing windows of the record.

    **Arguments:** `measurements`, `residuals`, `horizon`: as in `remedies`; `windows`: number of
    windows that have been fitted.
    """
    times = np.concatenate([np.asarray(s.times) for s in measurements.series.values()])
    rows = np.concatenate([residuals[name] for name in measurements.series])
    edges = np.linspace(times.min(), times.max(), PIECES + 1)
    start, end = float(edges[0]), float(measurements.times()[-1])
    # The run fits the data up to the first piece of the record with large residuals.
    pieces = ((low, (times >= low) & (times <= high)) for low, high in pairwise(edges))
    until = float(next((low for low, inside in pieces if _rms(rows[inside]) > FAR), edges[-1]))
    # With large residuals from the first piece on, no part of the record fits.
    if until == start:
        length = (end - start) / PIECES
        wrong = "the scene, the initial state or a unit is wrong, not the value of a parameter"
        if windows > 1:
            yield (
                "The run deviates from the data from the first samples on, although windows of the "
                "record were fitted first: begin with a shorter one, by grow=("
                f"{start + length:.4g}, ...). If that fails too, {wrong}."
            )
        else:
            # The first window is one piece, and each further one is twice as long.
            grow = ", ".join(f"{start + length * 2**k:.4g}" for k in range(DOUBLINGS))
            yield (
                "The run deviates from the data from the first samples on: fit growing windows of "
                "the record, from which a search converges from farther away, by "
                f"identify(..., grow=({grow})). If the data up to {start + length:.4g} s do not "
                f"fit either, {wrong}."
            )
    elif until < end:
        # The first window is the part that fits, and the next ones are longer in small steps.
        ends = until + (end - until) * np.array([0.0, 0.25, 0.5])
        grow = ", ".join(f"{one:.4g}" for one in ends)
        yield (
            f"The run follows the data up to {until:.4g} s and deviates afterwards: fit growing "
            f"windows of the record, by identify(..., grow=({grow}))."
        )
    if horizon is None:
        yield (
            "Compute the longest record that a single run can fit, by "
            "cj.fit_horizon(scene, state, parameters, measurements, uncertainty=...)."
        )
    elif end > horizon.single_shot:
        yield (
            f"The record ends at {end:.4g} s, but a single run can fit only "
            f"{horizon.single_shot:.4g} s: shorten the record, or fit windows that grow from this "
            "time, by grow=[...]."
        )


def _rms(row: Float[np.ndarray, " N"]) -> float:
    """Return the root mean square of a row, 0 for an empty one."""
    return math.sqrt(float(np.mean(row**2))) if len(row) else 0.0
