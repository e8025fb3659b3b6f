"""Margins of quantities to their limits, computed by sweeps over many values of a parameter.

Each value may be combined with random draws of other numbers, such as the phase at the start. Then
a given quantile of the quantities over the draws must stay within the limits.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float
from numpy.lib.stride_tricks import sliding_window_view

from ...parametrisation.parameter import Parameter
from ...quantities.base import Quantity
from ...result_codes import RESULTS, result_number
from ...simulation.reductions.base import AbstractReduction
from ...simulation.reductions.quantities import Peak
from ...sweeps.axes import Axis

if TYPE_CHECKING:
    import xarray as xr

VALUE = "largest_value"
"""Name of the axis of the parameter's values in the sweeps."""
NEIGHBOURS = 2
"""Number of neighbouring intervals on each side that bound the change of the margin inside an
interval."""
CONFIDENCE = 0.95
"""Confidence level of the quantiles' intervals."""


@dataclass(frozen=True)
class LaneMargins:
    """Margins log(limit / peak) at n values of the parameter; negative where a limit is violated.

    - `coordinates`: (n,) rising coordinates of the values on the parameter's scale.
    - `margins`: (n,) the smallest margin of all outputs; with draws, that of the quantile of the
      peaks over the draws. A failed run counts as an infinite peak, with the margin -inf. The
      margin is +inf for a peak of zero or less, and NaN, a violation, for a peak that is NaN.
    - `low`, `high`: (n,) ends of the margins' 95 % confidence intervals; equal to `margins` without
      draws.
    - `peak`: text for an error message on the output with the smallest margin at the first
      coordinate.
    """

    coordinates: Float[np.ndarray, " n"]
    margins: Float[np.ndarray, " n"]
    low: Float[np.ndarray, " n"]
    high: Float[np.ndarray, " n"]
    peak: str = ""

    def with_others(self, others: "LaneMargins") -> "LaneMargins":
        """Return these margins merged with those at other coordinates, in the order of coordinates.

        Where a coordinate occurs in both, the margin of this object is kept.
        """
        coordinates = np.concatenate([self.coordinates, others.coordinates])
        coordinates, kept = np.unique(coordinates, return_index=True)
        margins, low, high = (
            np.concatenate([getattr(self, name), getattr(others, name)])[kept]
            for name in ("margins", "low", "high")
        )
        return LaneMargins(coordinates, margins, low, high, self.peak)

    def doubtful(self) -> Bool[np.ndarray, " m"]:
        """Return for each interval between neighbouring values, (n - 1,), whether it may hide a
        violation.

        An interval up to the first violation is doubtful if the smaller margin at its ends is below
        the largest change of the margin over the interval and its `NEIGHBOURS`.
        """
        count = min(first_violation(self.margins), len(self.margins) - 1)
        ends = self.margins[: count + 1]
        # The infinite margin of a failed run or of a zero peak tells nothing about the rate at
        # which the margin changes.
        changes = np.nan_to_num(np.abs(np.diff(ends)), posinf=0.0)
        around = np.pad(changes, NEIGHBOURS)
        largest_change = sliding_window_view(around, 2 * NEIGHBOURS + 1).max(axis=1)
        # The smaller of an interval's two margins may fall by as much inside the interval.
        doubtful = np.zeros(len(self.coordinates) - 1, bool)
        doubtful[:count] = np.minimum(ends[:-1], ends[1:]) < largest_change
        return doubtful

    def falls(self, tolerance: float) -> bool:
        """Return whether the margins only fall as the coordinate rises.

        A rise counts only if the lower end of a confidence interval exceeds the upper end of an
        earlier one by more than `tolerance`, a difference of logarithms and thus a relative change
        of the peak. Margins that are NaN are left out. If the margins only fall, no violation is
        hidden between two values that satisfy the limits.
        """
        known = ~np.isnan(self.margins)
        least = np.minimum.accumulate(np.where(known, self.high, np.inf))
        return bool(np.all(self.low[known][1:] <= least[known][:-1] + tolerance))


def first_violation(margins: Float[np.ndarray, " n"]) -> int:
    """Return the index of the first margin that is negative or NaN; n if there is none."""
    # The appended entry is found if no other is.
    return int(np.argmin(np.append(margins >= 0.0, False)))


def lane_margins(
    run: Callable[..., "xr.Dataset"],
    parameter: Parameter,
    outputs: Mapping[str, AbstractReduction],
    limits: Mapping[str, float],
    draws: Mapping[str, Axis],
    quantile: float,
    coordinates: Float[np.ndarray, " n"],
) -> LaneMargins:
    """Compute the margins at n values of a parameter, each with all draws, by one sweep.

    **Arguments:**

    - `run`: function that sweeps over axes by name, such as `sweep` with its other arguments set.
    - `parameter`: the parameter, and `coordinates`: (n,) its rising coordinates.
    - `outputs`: limited reductions by name, and `limits`: their limits by the same names, SI.
    - `draws`: axes of random numbers by name, of equal length; empty for none.
    - `quantile`: share of the draws that must satisfy the limits.
    """
    values = np.array([float(parameter.scale.value(u)) for u in coordinates])
    count = len(next(iter(draws.values())).values) if draws else 1
    # A lane for each pair of a value and a draw; the lanes of a value follow each other.
    axes = {VALUE: Axis(parameter.variation, np.repeat(values, count))}
    for name, axis in draws.items():
        axes[name] = Axis(axis.variation, np.tile(axis.values, len(values)))
    results = run(axes=axes, outputs=outputs, zipped=True)
    successful = results["result"].values == result_number(RESULTS.successful)
    rows = {}
    for name, limit in limits.items():
        # A failed run counts as a violation.
        peaks = np.where(successful, results[name].values, np.inf).reshape(len(values), count)
        rows[name] = limit_margins(peaks, limit, quantile)
    # Each of the three is the smallest of all outputs.
    margins, low, high = np.min(np.array([*rows.values()]), axis=0)
    # For the message about a limit that is violated from the first value on.
    smallest = min(rows, key=lambda name: float(rows[name][0][0]))
    first = float(rows[smallest][0][0])
    peak = "the run with this value fails"
    if np.isfinite(first):
        unit, limit = outputs[smallest].units().get("", "1"), limits[smallest]
        peak = (
            f"`{smallest}` reaches {limit * math.exp(-first):.6g} {unit} with this value, and its "
            f"limit is {limit:.6g} {unit}"
        )
    return LaneMargins(coordinates, margins, low, high, peak)


def limit_margins(
    peaks: Float[np.ndarray, "n draws"], limit: float, quantile: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return margins log(limit / quantile of the peaks over the draws), with 95 % intervals.

    The quantile is an order statistic of the draws: the smallest peak that the given share of the
    draws does not exceed. Its 95 % confidence interval is between two other order statistics and
    holds for any distribution (W. Conover, *Practical nonparametric statistics*, section 3.2).

    **Arguments:** `peaks`: (n, draws); `limit`: in the unit of the peaks; `quantile`: share of the
    draws, 0 to 1.

    **Returns:** margins, lower ends and upper ends, (n,) each. The lower end is -inf if there are
    too few draws for it. Both ends equal the margin for a single draw, and for the quantile 1.
    """
    from scipy.stats import binom

    ordered, count = np.sort(peaks, axis=1), peaks.shape[1]
    tail = 0.5 * (1.0 - CONFIDENCE)
    # Numbers of order statistics, from 1. A product such as 0.55 * 100 exceeds 55 by rounding,
    # which must not raise the number to 56.
    middle = max(math.ceil(quantile * count - 1e-9), 1)
    below = above = middle
    # The quantile 1 means that all these draws must satisfy the limit: their largest peak is exact.
    if count > 1 and quantile < 1.0:
        below = max(int(binom.ppf(tail, count, quantile)), 1)
        above = int(binom.ppf(1.0 - tail, count, quantile)) + 1
    # A larger peak has a smaller margin, so that `above` gives the lower end.
    columns = [ordered[:, k - 1] if k <= count else ordered[:, -1] for k in (middle, above, below)]
    with np.errstate(divide="ignore"):
        margin, low, high = (np.log(limit) - np.log(np.maximum(column, 0.0)) for column in columns)
    if above > count:  # Too few draws to bound the quantile from above.
        low = np.full(len(peaks), -np.inf)
    return margin, low, high


def as_reduction(quantity: Quantity | AbstractReduction, after: float | None) -> AbstractReduction:
    """Return a reduction unchanged; for a quantity, its peak from the time `after`, s, on."""
    if isinstance(quantity, AbstractReduction):
        return quantity
    unit = getattr(quantity, "unit", None) or "1"
    return Peak(quantity, unit, after=after)
