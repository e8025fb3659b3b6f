"""Margins of many values of a parameter, and of draws beside each, by sweeps."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy.lib.stride_tricks import sliding_window_view

from ...model.bodies import State
from ...model.scene import Scene
from ...parametrisation.parameter import Parameter
from ...quantities.base import Quantity
from ...result_codes import RESULTS, result_number
from ...simulation.reductions.reductions import AbstractReduction, Peak
from ...simulation.step.settings import Settings
from ...sweeps.axes import Axis
from ...sweeps.sweep import sweep

VALUE = "largest_value"
NEIGHBOURS = 2
"""Intervals on either side whose changes of the margin an interval's own may be as large as."""
CONFIDENCE = 0.95
"""Of the quantiles' intervals."""


@dataclass(frozen=True)
class LaneMargins:
    """Margins at places (n,), the parameter's coordinates, rising.

    - `margins`: (n,) the smallest over the outputs, of the quantile over the draws.
    - `low`, `high`: (n,) ends of their confidence intervals; the margins themselves without draws.
    - `peak`: a text on the output with the smallest margin at the first place.
    """

    places: Float[np.ndarray, " n"]
    margins: Float[np.ndarray, " n"]
    low: Float[np.ndarray, " n"]
    high: Float[np.ndarray, " n"]
    peak: str = ""

    def with_others(self, others: "LaneMargins") -> "LaneMargins":
        """These and others, in order; of equal places the first."""
        places = np.concatenate([self.places, others.places])
        places, kept = np.unique(places, return_index=True)
        pairs = zip(self._rows, others._rows, strict=True)
        margins, low, high = (np.concatenate(pair)[kept] for pair in pairs)
        return LaneMargins(places, margins, low, high, self.peak)

    @property
    def _rows(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.margins, self.low, self.high

    def gap(self) -> tuple[int, int] | None:
        """Which lane is the first that does not hold, and the one before it; or ``None``."""
        fails = np.flatnonzero(~(self.margins >= 0.0))
        return (int(fails[0]) - 1, int(fails[0])) if len(fails) else None

    def doubtful(self) -> Bool[np.ndarray, " m"]:
        """Of each interval (n - 1,) below the first lane that does not hold, that one's included,
        whether the smaller of the margins at its ends is below the largest change of the margin
        over it or over one of its `NEIGHBOURS`: a violation may lie inside."""
        gap = self.gap()
        count = len(self.places) - 1 if gap is None else gap[1]
        ends = self.margins[: count + 1]
        changes = np.nan_to_num(np.abs(np.diff(ends)), posinf=0.0)
        around = np.pad(changes, NEIGHBOURS)
        largest_feasible = sliding_window_view(around, 2 * NEIGHBOURS + 1).max(axis=1)
        found = np.zeros(len(self.places) - 1, bool)
        found[:count] = np.minimum(ends[:-1], ends[1:]) < largest_feasible
        return found

    def falls(self, tolerance: float) -> bool:
        """Whether no margin is above one at a smaller place, by more than a tolerance and what the
        draws leave open."""
        known = ~np.isnan(self.margins)
        least = np.minimum.accumulate(np.where(known, self.high, np.inf))
        return bool(np.all(self.low[known][1:] <= least[known][:-1] + tolerance))


@dataclass(frozen=True)
class LaneProblem:
    """What is run in lanes: see `largest_feasible`."""

    scene: Scene
    state: State
    end_time: float
    parameter: Parameter
    outputs: Mapping[str, AbstractReduction]
    limits: Mapping[str, float]
    draws: Mapping[str, Axis]
    quantile: float
    settings: Settings
    start_time: float
    progress: bool

    def margins(self, places: Float[np.ndarray, " n"]) -> LaneMargins:
        """The margins at rising places (n,), by one sweep."""
        values = np.array([float(self.parameter.scale.value(place)) for place in places])
        count = len(next(iter(self.draws.values())).values) if self.draws else 1
        axes = {VALUE: Axis(self.parameter.variation, np.repeat(values, count))}
        for name, axis in self.draws.items():
            axes[name] = Axis(axis.variation, np.tile(axis.values, len(values)))
        found = sweep(
            self.scene,
            self.state,
            self.end_time,
            axes,
            self.outputs,
            self.settings,
            zipped=True,
            start_time=self.start_time,
            progress=self.progress,
        )
        fine = found["result"].values == result_number(RESULTS.successful)
        rows = {}
        for name, limit in self.limits.items():
            peaks = np.where(fine, found[name].values, np.inf).reshape(len(values), count)
            rows[name] = limit_margins(peaks, limit, self.quantile)
        margins, low, high = np.min(np.array([*rows.values()]), axis=0)
        peak = self._peak({name: float(row[0][0]) for name, row in rows.items()})
        return LaneMargins(places, margins, low, high, peak)

    def _peak(self, margins: Mapping[str, float]) -> str:
        """A text on the output with the smallest of the margins."""
        name = min(margins, key=lambda name: margins[name])
        if not np.isfinite(margins[name]):
            return "the run fails there"
        unit, limit = self.outputs[name].units().get("", "1"), self.limits[name]
        return (
            f"`{name}` reaches {limit * math.exp(-margins[name]):.6g} {unit} there, and its limit "
            f"is {limit:.6g} {unit}"
        )


def limit_margins(
    peaks: Float[np.ndarray, "n draws"], limit: float, quantile: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Margins (n,) of a quantile of the peaks over the draws, and both ends of their intervals.

    The quantile is a peak that occurred: the smallest that so large a part of the draws does not
    exceed. Its interval is of two more, of the orders between which it is with 95 % probability
    whatever the distribution (W. Conover, *Practical nonparametric statistics*, section 3.2).
    """
    from scipy.stats import binom

    ordered, count = np.sort(peaks, axis=1), peaks.shape[1]
    tail = 0.5 * (1.0 - CONFIDENCE)
    middle = max(math.ceil(quantile * count - 1e-9), 1)
    below = above = middle
    if count > 1 and quantile < 1.0:
        below = max(int(binom.ppf(tail, count, quantile)), 1)
        above = int(binom.ppf(1.0 - tail, count, quantile)) + 1
    columns = [ordered[:, k - 1] if k <= count else ordered[:, -1] for k in (middle, above, below)]
    with np.errstate(divide="ignore"):
        margin, low, high = (np.log(limit) - np.log(np.maximum(column, 0.0)) for column in columns)
    if above > count:
        low = np.full(len(peaks), -np.inf)
    return margin, low, high


def as_reduction(quantity: Quantity | AbstractReduction, after: float | None) -> AbstractReduction:
    """What a sweep keeps of a quantity: its peak, after a time in s."""
    if isinstance(quantity, AbstractReduction):
        return quantity
    unit = getattr(quantity, "unit", None) or "1"
    return Peak(quantity, unit, after=after)
