"""The largest value of a parameter with which quantities stay within their limits."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ...fields.checks import (
    as_shown,
    require,
    require_count,
    require_positive,
    require_range,
)
from ...fields.conversion import as_numbers
from ...model.bodies import State
from ...model.scene import Scene
from ...parametrisation.parameter import PASS_PARAMETERS, Parameter
from ...quantities.base import Quantity, check_quantity
from ...simulation.reductions.reductions import AbstractReduction
from ...simulation.step import presets
from ...simulation.step.settings import Settings, settings_or
from ...sweeps.axes import Axis
from .lanes import LaneMargins, LaneProblem, as_reduction

QUANTITY = "quantity"
CLOSE = 2.0
"""How far below the first lane that fails a second row looks closely, in steps of the first row."""
INSPECTIONS = 12
"""Rows at most that look closely at where a violation may lie between two lanes."""

Watched = Quantity | AbstractReduction


@dataclass(frozen=True)
class LargestFeasible:
    """The largest value that holds, with all smaller ones that were looked at.

    - `value`: in the parameter's `unit`; the upper end of the range if no limit is met there.
    - `interval`: values between which the first violation found begins: the last that holds and the
      first that does not, or, with a quantile of draws, those that its 95 % confidence interval
      leaves open.
    - `met`: whether a limit was met within the range.
    - `monotone`: whether all margins that were seen fall with the parameter. If not, a larger
      value may hold again, and a violation narrower than `spacing` may have been missed.
    - `alternating`: the first value that does not hold, and the largest that holds above it: passes
      and violations alternate between them. ``None`` if no value above the first violation holds.
    - `spacing`: the largest distance between neighbouring values looked at up to `value`, relative
      to the larger.
    - `values`, `margins`: (n,) what was looked at in lanes, and the smallest margin
      log(limit / peak) there, -inf where a run failed.

    >>> speed, between = cj.quantities.Velocity("ball"), (100.0, 1000.0)  # 0.1 sqrt(k / m)
    >>> found = cj.largest_feasible(
    ...     scene, state, 0.5, stiffness, speed, 2.0, between=between, lanes=8, progress=False
    ... )
    >>> found.met, round(found.value)
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

    def __str__(self) -> str:
        """The value, how sure it is, and what was seen on the way, in a sentence."""
        low, high = self.interval
        fall = (
            "All margins seen fall with it."
            if self.monotone
            else f"Margins rise and fall: a violation between two of the values looked at, up to "
            f"{self.spacing:.1%} apart, may have been missed."
        )
        if not self.met:
            found = f"No limit is met up to {self.value:.6g} {self.unit}, the end of the range."
            return f"{found} {fall}"
        form = f".{_digits(low, high)}g"
        found = (
            f"Up to {self.value:{form}} {self.unit} (the first violation begins between "
            f"{low:{form}} and {high:{form}}), by {len(self.values)} lanes."
        )
        if self.alternating is not None:
            first, last = (f"{value:{form}}" for value in self.alternating)
            found += f" From {first} to {last} passes and violations alternate."
        return f"{found} {fall}"


def _digits(low: float, high: float) -> int:
    """Significant digits of the ends of an interval, one more than they have in common."""
    width = abs(high - low) / max(abs(low), abs(high), np.finfo(float).tiny)
    return int(np.clip(np.ceil(-np.log10(max(width, 1e-12))) + 1, 2, 12))


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
    """Find the largest value of a parameter, a clearance say, with which quantities stay within
    their limits, and all smaller values of the range too.

    A row of lanes tells where a limit is first exceeded; a second row looks closely at what lies
    just below. Where margins rise and fall, further rows look between lanes whose margins are
    smaller than they change from lane to lane. Each further row divides the interval in which the
    limit is met by the number of lanes, to the tolerance.

    ```python
    import clearjoint as cj

    scene, state = cj.mechanisms.slider_crank(0.1e-3)
    found = cj.largest_feasible(
        scene,
        state,
        2e-3,
        cj.Parameter(lambda scene: scene.joints["slider pin"].clearance, cj.Log()),
        cj.quantities.ContactForce("slider pin", "V"),
        1e4,
        between=(1e-6, 1e-4),
        lanes=8,
    )
    print(found)
    ```

    **Arguments:**

    - `scene`, `state`, `start_time`, `end_time` s: as in `simulate`.
    - `parameter`: what is varied; rows are even on its scale.
    - `quantity`: a scalar function of an `Instant`, whose peak counts, or a reduction with one
      result, such as `ImpactCount`; or several by name.
    - `limit`: the largest value allowed, positive, in SI; of several quantities by name.
    - `settings`: how to integrate; `clearjoint.presets.derivatives` unless given.
    - `between`: the least and the largest value considered; the least must hold.
    - `after`: s, from when on peaks count, behind a transient.
    - `draws`: what scatters, such as the phase at the start: axes of equally many values each, by
      name, which change together. `quantile`: the part of them that must keep the limits.
    - `lanes`: values in a row.
    - `tolerance`: of the value, relative to itself.
    - `progress`: show a bar while lanes run.

    **Returns:** a `LargestFeasible`.

    **Raises:** `ValueError` for arguments that no run can use, and if the least value does not
    hold; the message has the peak that it reaches.
    """
    named = isinstance(quantity, Mapping)
    quantities: dict[str, Watched] = dict(quantity) if named else {QUANTITY: quantity}
    limits = dict(limit) if isinstance(limit, Mapping) else {QUANTITY: limit}
    draws = {} if draws is None else dict(draws)
    low, high = _range_on_scale(parameter, between)
    _check_limits(quantities, limits)
    _check(scene, quantities, draws, quantile, lanes, tolerance)
    settings = settings_or(settings, presets.derivatives)
    outputs = {name: as_reduction(one, after) for name, one in quantities.items()}
    problem = LaneProblem(
        scene,
        state,
        end_time,
        parameter,
        outputs,
        limits,
        draws,
        quantile,
        settings,
        start_time,
        progress,
    )
    search = _Search(problem, lanes, tolerance, parameter)
    return search.found(low, high, parameter.variation.unit_in(scene, state))


@dataclass(frozen=True)
class _Search:
    """Rows of so many lanes, up to a tolerance."""

    problem: LaneProblem
    lanes: int
    tolerance: float
    parameter: Parameter

    def found(self, low: float, high: float, unit: str) -> LargestFeasible:
        """The largest value between two places."""
        seen = self.problem.margins(np.linspace(low, high, self.lanes))
        least = self._value(low)
        remedy = f"{seen.peak}; lower it, or raise the limit"
        require(bool(seen.margins[0] >= 0.0), "between[0]", least, "a value that holds", remedy)
        if seen.gap() is not None:
            seen = self._refined(seen, close=True)
        seen = self._inspected(seen)
        if seen.gap() is None:
            return self._largest(seen, self._value(high), unit)
        while self._widths(seen)[_gap(seen)[0]] > self.tolerance:
            seen = self._refined(seen)
        holds, _ = _gap(seen)
        return self._largest(seen, self._value(seen.places[holds]), unit)

    def _refined(self, seen: LaneMargins, close: bool = False) -> LaneMargins:
        """One more row of lanes in the gap; one that looks `close` begins below it."""
        holds, fails = (seen.places[k] for k in _gap(seen))
        start = max(seen.places[0], holds - CLOSE * (fails - holds)) if close else holds
        return seen.with_others(self.problem.margins(np.linspace(start, fails, self.lanes)))

    def _inspected(self, seen: LaneMargins) -> LaneMargins:
        """Rows of lanes, where margins do not fall alone, in the intervals that may hold a
        violation, until these are as narrow as the tolerance."""
        for _ in range(INSPECTIONS):
            open_ones = seen.doubtful() & (self._widths(seen) > self.tolerance)
            if seen.falls(self.tolerance) or not open_ones.any():
                break
            widths = np.where(open_ones, np.diff(seen.places), 0.0)
            parts = np.ones(len(widths), int)
            for _ in range(self.lanes):  # each lane into what is then the widest
                parts[np.argmax(widths / parts)] += 1
            rows = [
                start + width * np.arange(1, count) / count
                for start, width, count in zip(seen.places, widths, parts, strict=False)
            ]
            seen = seen.with_others(self.problem.margins(np.concatenate(rows)))
        return seen

    def _largest(self, seen: LaneMargins, value: float, unit: str) -> LargestFeasible:
        met = seen.gap() is not None
        again = int(np.flatnonzero(seen.margins >= 0.0)[-1])
        first = _gap(seen)[1] if met else len(seen.places) - 1
        return LargestFeasible(
            value=value,
            unit=unit,
            interval=self._interval(seen) if met else (value, value),
            met=met,
            monotone=seen.falls(self.tolerance),
            alternating=(self._value(seen.places[first]), self._value(seen.places[again]))
            if again > first
            else None,
            spacing=float(self._widths(seen)[:first].max()),
            values=np.array([self._value(place) for place in seen.places]),
            margins=np.nan_to_num(seen.margins, nan=-np.inf, posinf=np.inf, neginf=-np.inf),
        )

    def _interval(self, seen: LaneMargins) -> tuple[float, float]:
        """Values between which the largest one is."""
        sure = np.flatnonzero(~(seen.low >= 0.0))
        lost = np.flatnonzero(~(seen.high >= 0.0))
        low = seen.places[max(int(sure[0]) - 1, 0)] if len(sure) else seen.places[-1]
        high = seen.places[int(lost[0])] if len(lost) else seen.places[-1]
        return self._value(low), self._value(high)

    def _widths(self, seen: LaneMargins) -> Float[np.ndarray, " m"]:
        """How far neighbouring values are apart, relative to the larger."""
        values = np.array([self._value(float(place)) for place in seen.places])
        sizes = np.maximum(np.maximum(abs(values[1:]), abs(values[:-1])), np.finfo(float).tiny)
        return np.abs(np.diff(values)) / sizes

    def _value(self, place: float) -> float:
        return as_shown(float(self.parameter.scale.value(place)))


def _gap(seen: LaneMargins) -> tuple[int, int]:
    gap = seen.gap()
    assert gap is not None
    return gap


def _range_on_scale(parameter: Parameter, between: tuple[float, float]) -> tuple[float, float]:
    """The places of the least and the largest value."""
    kind = type(parameter).__name__
    require(isinstance(parameter, Parameter), "parameter", kind, "a Parameter", PASS_PARAMETERS)
    ends = np.asarray(as_numbers(between), dtype=float)
    rising = ends.shape == (2,) and bool(np.isfinite(ends).all()) and bool(ends[0] < ends[1])
    remedy = "pass (least, largest), in the unit of the parameter"
    require(rising, "between", between, "two rising values", remedy)
    low, high = (float(parameter.scale.coordinate(value)) for value in ends)
    return low, high


def _check_limits(outputs: Mapping[str, object], limits: Mapping[str, float]) -> None:
    remedy = "give each quantity one limit, under the same name"
    same = set(outputs) == set(limits)
    require(same, "limit", sorted(limits), f"one for each of {sorted(outputs)}", remedy)
    for name, limit in limits.items():
        fine = isinstance(limit, int | float | np.number) and 0.0 < float(limit) < np.inf
        remedy = "give the largest value allowed, of a magnitude or a distance"
        require(fine, f"limit[{name!r}]", limit, "a positive number", remedy)


def _check(
    scene: Scene,
    quantities: Mapping[str, Watched],
    draws: Mapping[str, Axis],
    quantile: float,
    lanes: int,
    tolerance: float,
) -> None:
    for name, one in quantities.items():
        if isinstance(one, AbstractReduction):
            units, expected = list(one.units()), "a reduction with one result"
            remedy = "subclass AbstractReduction to report one, or pass the quantity for its peak"
            require(
                "" in units, f"quantity[{name!r}]", units, "a reduction with one result", remedy
            )
            one.check(scene)
        else:
            expected = "a scalar function of an Instant, or a reduction"
            remedy = 'pass for example cj.quantities.ContactForce("pin")'
            require(callable(one), f"quantity[{name!r}]", one, expected, remedy)
            check_quantity(f"quantity[{name!r}]", one, scene)
    sizes = {name: len(axis.values) for name, axis in draws.items()}
    expected = "axes of equally many values each"
    require(len(set(sizes.values())) < 2, "draws", sizes, expected, "draw them together")
    require_range("quantile", quantile, 0.0, 1.0, "give the part of the draws, 0.95 say")
    require_count("lanes", lanes, "give a number of values in a row")
    require(lanes > 2, "lanes", lanes, "three at least", "take 32")
    require_positive("tolerance", tolerance, "1e-3 of the value suffice")
