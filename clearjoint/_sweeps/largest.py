"""Search for the largest value of a parameter for which quantities stay within their limits."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float
from numpy.lib.stride_tricks import sliding_window_view
from typing_extensions import override

from .._dynamics.constraint_report import check_names
from .._fields.checks import (
    as_number,
    as_shown,
    require,
    require_count,
    require_positive,
    require_range,
    require_type,
    require_types,
)
from .._model.bodies import State
from .._model.scene import Scene
from .._parametrisation.parameter import PASS_PARAMETERS, Parameter
from .._parametrisation.variations import require_apart
from .._simulation.reductions.base import AbstractReduction
from .._simulation.reductions.quantities import Peak
from .._simulation.results.solution import SUCCESSFUL
from .._simulation.step import presets
from .._simulation.step.settings import Settings, settings_or
from ..quantities.base import Quantity, check_quantity, require_quantity
from .axes import Axis
from .sweep import sweep

if TYPE_CHECKING:
    import xarray as xr

QUANTITY = "quantity"
"""Name of a quantity that the user passes without a name."""
CLOSE = 2.0
"""The second sweep begins below the last value before the first violation, at a distance of this
many spacings of the first sweep."""
INSPECTIONS = 12
"""Maximum number of sweeps that search for violations between computed values, which limits the
number of runs where the margin is a rough function of the parameter."""
VALUE = "largest_value"
"""Name of the axis of the parameter's values in the sweeps."""
NEIGHBOURS = 2
"""The change of the margin inside an interval between two computed values is estimated as the
largest change over the interval and over this many intervals on each side of it."""
CONFIDENCE = 0.95
"""Confidence level of the quantiles' intervals."""

Watched = Quantity | AbstractReduction
"""A quantity, whose peak is limited, or a reduction, whose result is limited."""


@dataclass(frozen=True)
class LargestFeasible:
    """Result of `largest_feasible`: the largest value of a parameter up to which no limit is
    violated at any computed value.

    A margin is log(limit / peak), the smallest of all limited quantities: it is negative where a
    limit is violated. The peak is the largest value of a quantity, or the result of a reduction;
    with draws, it is the quantile of these numbers over the draws.

    - `value`: the largest feasible value, in `unit`; the range's upper end if no limit is violated.
    - `interval`: `value`, and the next computed value, which violates a limit. With several draws
      and a quantile below 1, it is instead a 95 % confidence interval of the value at which the
      first violation begins. Both ends are `value` if no limit is violated.
    - `met`: whether a computed value violates a limit.
    - `monotone`: whether the margins only fall: no computed margin exceeds one at a smaller value
      by more than `tolerance`; with draws, the nearest ends of their confidence intervals are
      compared. If false, larger values may satisfy the limits again, and a violation narrower than
      `spacing` may have been missed.
    - `alternating`: the first value that violates a limit, and the largest computed value above it
      that satisfies all limits; ``None`` if there is none.
    - `spacing`: largest relative distance between neighbouring values up to the first violation:
      their difference over the larger of their magnitudes. In a range that contains zero, the
      divisor is at least `tolerance` times the range.
    - `values`, `margins`: (n,) all computed values, in `unit`, and their margins. A margin is +inf
      for a peak of zero or less, and -inf for one that is NaN or infinite, as in a failed run.

    >>> speed, between = cj.quantities.Velocity("ball"), (100.0, 1000.0)  # 0.1 sqrt(k / m)
    >>> largest = cj.largest_feasible(
    ...     scene, state, 0.5, stiffness, speed, 2.0, between=between, lanes=8, progress=False
    ... )
    >>> largest.met, round(largest.value)
    (True, 400)
    """

    value: float
    unit: str
    interval: tuple[float, float]
    met: bool
    monotone: bool
    alternating: tuple[float, float] | None
    spacing: float
    values: Float[np.ndarray, " n"]
    margins: Float[np.ndarray, " n"]

    @override
    def __str__(self) -> str:
        low, high = self.interval
        trend = (
            "All computed margins fall with the parameter."
            if self.monotone
            else "Margins rise and fall: a violation between two computed values, which are up to "
            f"{self.spacing:.1%} apart, may have been missed."
        )
        if not self.met:
            return (
                f"No limit is reached up to {self.value:.6g} {self.unit}, the end of the range. "
                f"{trend}"
            )
        # One digit more than the ends of the interval have in common, from 2 to 12 digits.
        width = abs(high - low) / max(abs(low), abs(high), np.finfo(float).tiny)
        form = f".{int(np.clip(np.ceil(-np.log10(max(width, 1e-12))) + 1, 2, 12))}g"
        result = (
            f"The limits are satisfied up to {self.value:{form}} {self.unit} (the first violation "
            f"begins between {low:{form}} and {high:{form}}), by runs at {len(self.values)} "
            "values."
        )
        if self.alternating is not None:
            first, last = (f"{value:{form}}" for value in self.alternating)
            result += f" From {first} to {last} passes and violations alternate."
        return f"{result} {trend}"


def largest_feasible(
    scene: Scene,
    state: State,
    end_time: float,
    parameter: Parameter,
    quantity: Watched | Mapping[str, Watched],
    limit: float | Mapping[str, float],
    settings: Settings | None = None,
    *,
    between: tuple[float, float],
    after: float | None = None,
    draws: Mapping[str, Axis] | None = None,
    quantile: float = 1.0,
    lanes: int = 32,
    tolerance: float = 1e-3,
    start_time: float = 0.0,
    progress: bool = True,
) -> LargestFeasible:
    """Find the largest value of a parameter for which quantities stay within their limits.

    No computed value up to the result violates a limit. A sweep over the range finds the first
    violation, and a second one examines the values just below it. If margins, log(limit / peak),
    rise and fall, more sweeps search for violations between values with small margins. Further
    sweeps then divide the interval in which the first violation begins, down to the tolerance.

    ```python
    import clearjoint as cj

    scene, state = cj.mechanisms.slider_crank(0.1e-3)
    clearance = cj.Parameter(lambda scene: scene.joints["slider pin"].clearance, cj.Log())
    force = cj.quantities.ContactForce("slider pin", "V")
    options = {"between": (1e-6, 1e-4), "lanes": 8}
    print(cj.largest_feasible(scene, state, 2e-3, clearance, force, 1e4, **options))
    ```

    **Arguments:**

    - `parameter`: for example a clearance; values of a sweep are evenly spaced on its scale.
    - `quantity`: a scalar function of an `Instant` (the scene and its motion at one time), whose
      peak is limited; or a reduction, such as `ImpactCount`, whose main result (its name is "") is
      limited; or several functions and reductions by name.
    - `limit`: largest allowed value, positive, in SI; for several quantities by name, one for each.
    - `settings`: by default the search uses `clearjoint.presets.derivatives`, with which margins
      are smoother, and the values just below the first violation must also satisfy the limits in
      runs with the default settings of `simulate`.
    - `between`: smallest and largest value considered; the smallest must satisfy the limits.
    - `after`: time after which peaks of quantities count, to exclude a transient. Reductions have
      times of their own.
    - `draws`: `Axis` by name with the draws of each random number of the scene or its initial
      state, such as the initial phase. All have equal length; their i-th values form the i-th draw.
    - `quantile`: share of the draws that must satisfy each limit, from 0 to 1.
    - `lanes`: number of values in a sweep, at least 3, each of which is run with every draw.
    - `tolerance`: relative tolerance of the value, positive. If the range contains zero, the
      absolute tolerance is at least `tolerance` squared times the range. The search also ends where
      no floats are in between.

    **Raises:** `ValueError` for unsupported arguments, and if the smallest value violates a limit;
    the message then has the peak of the quantity, or says that it is NaN or that the run fails.
    """
    quantities = dict(quantity) if isinstance(quantity, Mapping) else {QUANTITY: quantity}
    limits = dict(limit) if isinstance(limit, Mapping) else {QUANTITY: limit}
    draws = {} if draws is None else draws
    require_types("draws", draws, Axis, "an Axis", "pass {name: cj.Axis(path, values)}")
    check_names(scene, state)
    require_type("parameter", parameter, Parameter, "a Parameter", PASS_PARAMETERS)
    ends = np.asarray(as_number(between, "between"))
    rising = ends.shape == (2,) and bool(np.isfinite(ends).all()) and bool(ends[0] < ends[1])
    remedy = "pass (smallest, largest), in the unit of the parameter"
    require(rising, "between", between, "two rising values", remedy)
    low, high = (float(parameter.scale.coordinate(value)) for value in ends)
    _check_quantities(scene, quantities, limits)
    expected = f"axes of other names than {VALUE!r}, the axis of the parameter"
    require(VALUE not in draws, "draws", VALUE, expected, "rename the axis")
    changes = {name: axis.setter(scene, state) for name, axis in draws.items()}
    own = parameter.variation.setter(scene, state, example=0.0)  # for values of the shape ()
    require_apart("draws", {VALUE: own, **changes}, scene, state)
    sizes = {name: len(axis.values) for name, axis in draws.items()}
    expected = "axes of equal length"
    require(len(set(sizes.values())) < 2, "draws", sizes, expected, "draw them together")
    require_range("quantile", quantile, 0.0, 1.0, "pass a share of the draws, for example 0.95")
    require_count("lanes", lanes, "give a number of values in a sweep")
    require(lanes > 2, "lanes", lanes, "at least 3", "pass 32")
    require_positive("tolerance", tolerance, "1e-3 suffices")
    # A quantity without reduction is limited by its peak.
    outputs = {name: as_reduction(watched, after) for name, watched in quantities.items()}

    def margins_with(settings: Settings) -> Callable[[np.ndarray], LaneMargins]:
        options = {"settings": settings, "start_time": start_time, "progress": progress}
        run = partial(sweep, scene, state, end_time, **options)
        return partial(lane_margins, run, parameter, outputs, limits, draws, quantile)

    # Near a limit, integration errors decide: the answer must hold in the run that a user makes.
    plain = margins_with(presets.default) if settings is None else None
    margins = margins_with(settings_or(settings, presets.derivatives))
    search = _Search(margins, lanes, tolerance, parameter, plain)
    return search.run(low, high, parameter.variation.unit_in(scene, state))


@dataclass(frozen=True)
class LaneMargins:
    """Margins log(limit / peak) at n values of the parameter; negative where a limit is violated.

    - `coordinates`: the parameter's values on its scale, rising.
    - `margins`: at each value, the smallest margin of all outputs; NaN if a peak is NaN, which
      counts as a violation.
    - `low`, `high`: ends of the 95 % confidence intervals of the margins, equal to `margins` if
      there is only one run for each value, or if all draws must satisfy the limits.
    - `peak`: text for the error message if a limit is violated at the first value.
    """

    coordinates: Float[np.ndarray, " n"]
    margins: Float[np.ndarray, " n"]
    low: Float[np.ndarray, " n"]
    high: Float[np.ndarray, " n"]
    peak: str = ""

    def with_others(self, others: "LaneMargins") -> "LaneMargins":
        """Return these margins merged with `others`, in the order of rising coordinates; at a
        coordinate that both have, the margin of this object is kept."""
        joined = [np.concatenate(pair) for pair in zip(self._rows, others._rows, strict=True)]
        # `np.unique` gives the first place of each coordinate, in rising order. The coordinates of
        # this object come before those of `others`.
        first_places = np.unique(joined[0], return_index=True)[1]
        return LaneMargins(*(values[first_places] for values in joined), peak=self.peak)

    def lowered_by(self, others: "LaneMargins") -> "LaneMargins":
        """Return these margins with, at each coordinate of `others`, the smaller of both margins,
        or NaN if one of them is NaN. This object must have all coordinates of `others`."""
        indices = np.searchsorted(self.coordinates, others.coordinates)
        lowered = [values.copy() for values in self._rows]
        # The coordinates, the first of the rows, are equal, so that their minimum changes nothing.
        for values, other_values in zip(lowered, others._rows, strict=True):
            values[indices] = np.minimum(values[indices], other_values)
        # The text `peak` is about the value of index 0.
        return LaneMargins(*lowered, peak=others.peak if 0 in indices else self.peak)

    @property
    def _rows(self) -> tuple[np.ndarray, ...]:
        return self.coordinates, self.margins, self.low, self.high

    def doubtful(self) -> Bool[np.ndarray, " m"]:
        """Return for each interval between neighbouring values whether it may hide a violation: it
        is below the first violation, and the smaller margin at its ends is below the largest change
        of the margin over this interval or one of the `NEIGHBOURS` intervals on each side of it."""
        count = min(first_violation(self.margins), len(self.margins) - 1)
        ends = self.margins[: count + 1]
        # The infinite margin of a failed run or of a zero peak tells nothing about the rate at
        # which the margin changes. The difference of two infinite margins is NaN.
        with np.errstate(invalid="ignore"):
            changes = np.nan_to_num(np.abs(np.diff(ends)), posinf=0.0)
        # With zeros at both ends, the first and the last interval have neighbours, too.
        around = np.pad(changes, NEIGHBOURS)
        largest_change = sliding_window_view(around, 2 * NEIGHBOURS + 1).max(axis=1)
        # Inside the interval, the margin may fall below its smaller end by the largest change.
        doubtful = np.zeros(len(self.coordinates) - 1, bool)
        doubtful[:count] = np.minimum(ends[:-1], ends[1:]) < largest_change
        return doubtful

    def falls(self, tolerance: float) -> bool:
        """Return whether the margins only fall: no confidence interval lies above an interval at a
        smaller coordinate by more than `tolerance`. Margins that are NaN are left out."""
        # A margin that is NaN cannot be compared.
        is_number = ~np.isnan(self.margins)
        # The smallest high end up to each coordinate.
        least = np.minimum.accumulate(np.where(is_number, self.high, np.inf))
        return bool(np.all(self.low[is_number][1:] <= least[is_number][:-1] + tolerance))


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

    `run` is `sweep` with all arguments but axes and outputs; `limits` are by name of output. A
    share `quantile` of the draws must satisfy each. `coordinates` are on the parameter's scale.
    """
    values = np.array([float(parameter.scale.value(u)) for u in coordinates])
    count = len(next(iter(draws.values())).values) if draws else 1
    # A lane for each pair of a value and a draw; the lanes of a value follow each other.
    axes = {VALUE: Axis(parameter.variation, np.repeat(values, count))}
    for name, axis in draws.items():
        axes[name] = Axis(axis.variation, np.tile(axis.values, len(values)))
    results = run(axes=axes, outputs=outputs, zipped=True)
    successful = results["result"].values == SUCCESSFUL
    # By output: the margins and the lower and upper ends of their intervals, (n,) each.
    of_outputs = {}
    for name, limit in limits.items():
        # A failed run counts as a violation.
        peaks = np.where(successful, results[name].values, np.inf).reshape(len(values), count)
        of_outputs[name] = limit_margins(peaks, limit, quantile)
    # The margins, and both ends of their intervals, are each the smallest of all outputs.
    margins, low, high = np.min(np.array([*of_outputs.values()]), axis=0)
    # For the message about a limit that is violated from the first value on.
    at_start = {name: float(each[0]) for name, (each, _, _) in of_outputs.items()}
    # A NaN is a violation too, but is not less than other margins.
    smallest = min(
        at_start, key=lambda name: -np.inf if np.isnan(at_start[name]) else at_start[name]
    )
    margin = at_start[smallest]
    peak = "the run with this value fails"
    if np.isnan(margin):
        peak = f"`{smallest}` has no peak with this value, but NaN"
    elif np.isfinite(margin) or successful[:count].all():
        # The margin is -inf if a run has failed, but also if successful runs have an infinite peak.
        # The empty name is that of a reduction's main result, which is limited.
        unit, limit = outputs[smallest].units().get("", "1"), limits[smallest]
        peak = (
            f"`{smallest}` reaches {limit * np.exp(-margin):.6g} {unit} with this value, and its "
            f"limit is {limit:.6g} {unit}"
        )
    return LaneMargins(coordinates, margins, low, high, peak)


def limit_margins(
    peaks: Float[np.ndarray, "n draws"], limit: float, quantile: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the margins log(limit / quantile of the peaks over the draws) at n values, and the
    lower and upper ends of their 95 % confidence intervals, (n,) each.

    The quantile of the peaks is an order statistic: the smallest peak that the share `quantile` of
    the draws does not exceed. The ends of its confidence interval are two other order statistics;
    the interval holds for any distribution (W. Conover, *Practical nonparametric statistics*,
    section 3.2). The lower end of the margin's interval is -inf if the draws are too few to give
    one. Both ends equal the margin for a single draw, and for the quantile 1.
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
    # A larger peak has a smaller margin, so that `above` gives the lower end. If it exceeds the
    # number of draws, any column serves here: the lower end becomes -inf below.
    columns = [ordered[:, k - 1] if k <= count else ordered[:, -1] for k in (middle, above, below)]
    with np.errstate(divide="ignore"):  # The margin of a peak of zero or less is +inf.
        margin, low, high = (np.log(limit) - np.log(np.maximum(column, 0.0)) for column in columns)
    if above > count:  # Too few draws to bound the quantile from above.
        low = np.full(len(peaks), -np.inf)
    return margin, low, high


def as_reduction(quantity: Quantity | AbstractReduction, after: float | None) -> AbstractReduction:
    """Return a reduction unchanged; for a quantity, its peak from the time `after` on."""
    if isinstance(quantity, AbstractReduction):
        return quantity
    unit = getattr(quantity, "unit", None) or "1"
    return Peak(quantity, unit, after=after)


@dataclass(frozen=True)
class _Search:
    """Search for the first violation, by sweeps of `lanes` values, to a relative `tolerance`.

    - `margins`: runs a sweep at rising coordinates, the values of `parameter` on its scale.
    - `plain`: like `margins`, with the default settings of `simulate`, with which the limits must
      hold too; ``None`` if the user has given settings.

    The argument `known` of methods has the margins of all values computed so far. Methods that
    sweep return it with the new margins.
    """

    margins: Callable[[np.ndarray], LaneMargins]
    lanes: int
    tolerance: float
    parameter: Parameter
    plain: Callable[[np.ndarray], LaneMargins] | None = None

    def run(self, low: float, high: float, unit: str) -> LargestFeasible:
        """Search between the coordinates `low`, which must satisfy the limits, and `high`. `unit`:
        of the parameter's values, for the result."""
        known = self.margins(np.linspace(low, high, self.lanes))
        self._require_smallest(known)
        # The first sweep is coarse: just below its first violation another one may lie between two
        # values.
        if first_violation(known.margins) < len(known.margins):
            known = self._refined(known, below=True)
        known = self._narrowed(self._inspected(known))
        return self._result(self._confirmed(known), unit)

    def _require_smallest(self, known: LaneMargins) -> None:
        smallest, expected = self._values(known)[0], "a value that satisfies the limits"
        remedy = f"{known.peak}; decrease it, or raise the limit"
        require(bool(known.margins[0] >= 0.0), "between[0]", smallest, expected, remedy)

    def _narrowed(self, known: LaneMargins) -> LaneMargins:
        """Sweep until the interval of the first violation is as narrow as the tolerance."""
        computed = 0
        # A sweep adds no value if there are no floats between the last value and the violation. The
        # interval that ends with the value of index k has the index k - 1.
        while (
            first_violation(known.margins) < len(known.margins)
            and len(known.coordinates) > computed
            and self._widths(known)[first_violation(known.margins) - 1] > self.tolerance
        ):
            computed, known = len(known.coordinates), self._refined(known)
        return known

    def _confirmed(self, known: LaneMargins) -> LaneMargins:
        """Run `plain` at values just below the first violation, and take its margins where they are
        smaller; repeat this until the first violation no longer moves."""
        if self.plain is None:  # `margins` already has the settings that the user has given
            return known
        # Lower margins, and values added before the violation, may move the first violation to
        # values without plain runs. So that the loop ends, values are added at most `INSPECTIONS`
        # times.
        checked, rounds = np.empty(0), 0
        violation = first_violation(known.margins)
        while known.coordinates[violation - 1] not in checked:
            just_below = known.coordinates[max(violation - self.lanes, 0) : violation]
            known = known.lowered_by(self.plain(just_below))
            checked = np.append(checked, just_below)
            self._require_smallest(known)
            if (rounds := rounds + 1) <= INSPECTIONS:
                known = self._narrowed(known)
            violation = first_violation(known.margins)
        return known

    def _refined(self, known: LaneMargins, below: bool = False) -> LaneMargins:
        """Sweep the interval from the last value before the first violation to the violation. With
        `below`, begin lower by `CLOSE` times its width, but not below the smallest value."""
        index = first_violation(known.margins)
        last, violation = known.coordinates[index - 1 : index + 1]
        start = max(known.coordinates[0], last - CLOSE * (violation - last)) if below else last
        return known.with_others(self.margins(np.linspace(start, violation, self.lanes)))

    def _inspected(self, known: LaneMargins) -> LaneMargins:
        """Divide intervals in which a violation may hide (see `LaneMargins.doubtful`), until none
        is wider than the tolerance, `INSPECTIONS` sweeps are made, or all margins are seen to fall
        as the coordinate rises."""
        for _ in range(INSPECTIONS):
            doubtful = known.doubtful() & (self._widths(known) > self.tolerance)
            # Margins that only fall have no violation before the first one.
            if known.falls(self.tolerance) or not doubtful.any():
                break
            # The tolerance is one of values; doubtful intervals are divided evenly in coordinates.
            widths = np.where(doubtful, np.diff(known.coordinates), 0.0)
            parts = np.ones(len(doubtful), int)
            for _ in range(self.lanes):  # Each lane divides the interval with the widest parts.
                parts[np.argmax(widths / parts)] += 1
            # The new coordinates inside each interval; none in an interval of one part.
            inside = [
                start + width * np.arange(1, count) / count
                for start, width, count in zip(known.coordinates, widths, parts, strict=False)
            ]
            known = known.with_others(self.margins(np.concatenate(inside)))
        return known

    def _result(self, known: LaneMargins, unit: str) -> LargestFeasible:
        # The smallest value satisfies the limits (`_require_smallest`), so `violation` is above 0.
        # If no margin is negative, `violation` is the number of values, and `value` the last one.
        violation, values = first_violation(known.margins), self._values(known)
        met, value = violation < len(values), values[violation - 1]
        # Index of the largest value that satisfies the limits, which may be above the violation.
        last_pass = int(np.flatnonzero(known.margins >= 0.0)[-1])
        return LargestFeasible(
            value=value,
            unit=unit,
            interval=self._interval(known) if met else (value, value),
            met=met,
            monotone=known.falls(self.tolerance),
            alternating=(values[violation], values[last_pass]) if last_pass > violation else None,
            spacing=float(self._widths(known)[:violation].max()),
            values=np.array(values),
            # NaN counts as a violation, so it becomes -inf; infinite margins remain as they are.
            margins=np.nan_to_num(known.margins, nan=-np.inf, posinf=np.inf, neginf=-np.inf),
        )

    def _interval(self, known: LaneMargins) -> tuple[float, float]:
        """Return two values of the parameter (not coordinates) between which the first violation
        begins, by the confidence intervals of the margins. The lower is the last value before the
        first interval that reaches below zero, or the smallest if no value is before it. The upper
        is the first value whose whole interval is below zero, or the largest if there is none."""
        possible, certain = first_violation(known.low), first_violation(known.high)
        values = self._values(known)
        return values[max(possible - 1, 0)], values[min(certain, len(values) - 1)]

    def _widths(self, known: LaneMargins) -> Float[np.ndarray, " m"]:
        """Return the relative distances of neighbouring values: their difference over the larger of
        their magnitudes."""
        values = np.array(self._values(known))
        low, high = values[0], values[-1]
        # Without a least divisor, the distance of zero from its neighbour would be 1, however close
        # the neighbour is.
        least = self.tolerance * (high - low) if low <= 0.0 <= high else np.finfo(float).tiny
        sizes = np.maximum(np.maximum(abs(values[1:]), abs(values[:-1])), least)
        return np.abs(np.diff(values)) / sizes

    def _values(self, known: LaneMargins) -> list[float]:
        """Return the values at the coordinates, with 0.3 for a scale's 0.30000000000000004."""
        return [as_shown(float(self.parameter.scale.value(u))) for u in known.coordinates]


def _check_quantities(
    scene: Scene, quantities: Mapping[str, Watched], limits: Mapping[str, float]
) -> None:
    require(len(quantities) > 0, "quantity", quantities, "one or more quantities", "name one")
    remedy = "give each quantity one limit, under the same name"
    same = set(quantities) == set(limits)
    require(same, "limit", sorted(limits), f"one for each of {sorted(quantities)}", remedy)
    for name, limit in limits.items():
        argument, remedy = f"limit[{name!r}]", "pass the largest allowed magnitude or distance"
        require_positive(argument, as_number(limit, argument), remedy)
    for name, watched in quantities.items():
        if isinstance(watched, AbstractReduction):
            # The main result of a reduction, which is limited, has the empty name.
            units, expected = list(watched.units()), 'a reduction with a main result, named ""'
            remedy = "subclass AbstractReduction to report one, or pass the quantity for its peak"
            require("" in units, f"quantity[{name!r}]", units, expected, remedy)
            watched.check(scene)
        else:
            require_quantity(f"quantity[{name!r}]", watched)
            check_quantity(f"quantity[{name!r}]", watched, scene)
