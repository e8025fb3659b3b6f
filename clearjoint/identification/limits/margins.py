"""Margins of peaks to their limits, and where the smallest of them is zero.

The margin of an output is log(limit / peak): 0.1 is ten per cent in hand, and where a peak is a
power of the parameter, the margin is a straight line over the parameter's logarithm. A peak moves
in time with the parameter, but where it is, the output's rate is zero: its derivative is that of
the output at a fixed time (the envelope theorem), which `clearjoint.sensitivities` gives. Off the
peak it is another one, to first order in the distance: instants must be close enough to tell it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ...fields.checks import require
from ...results import RESULTS
from ...simulation.sensitivities import Sensitivities


@dataclass(frozen=True)
class Margins:
    """Margins, log(limit / peak), at one value of a parameter.

    - `place`: the parameter's coordinate on its scale.
    - `margins[name]`: of each output, 0.1 for ten per cent in hand; `slopes[name]`: their
      derivatives to the coordinate; `times[name]`: of the peaks, s. NaN for a run that failed.

    ```python
    import clearjoint as cj

    two = {"force": 0.2, "error": -0.1}
    found = cj.Margins(-8.5, two, slopes={"force": -1.0, "error": -1.0}, times=two)
    print(found.narrowest, found.holds)  # error False
    ```
    """

    place: float
    margins: Mapping[str, float]
    slopes: Mapping[str, float]
    times: Mapping[str, float]

    @property
    def narrowest(self) -> str:
        """The output with the smallest margin, or one whose margin is not known."""
        return min(self.margins, key=lambda name: np.nan_to_num(self.margins[name], nan=-np.inf))

    @property
    def margin(self) -> float:
        """The smallest margin."""
        return self.margins[self.narrowest]

    @property
    def slope(self) -> float:
        """That of the smallest margin."""
        return self.slopes[self.narrowest]

    @property
    def holds(self) -> bool:
        """Whether all outputs keep their limits."""
        return self.margin >= 0.0

    def of(self, name: str) -> "Margins":
        """Those of one output alone."""
        parts = (self.margins, self.slopes, self.times)
        return Margins(self.place, *({name: part[name]} for part in parts))


def margins_of(
    run: Sensitivities, place: float, limits: Mapping[str, float], neighbours: int = 1
) -> Margins:
    """Margins of a run's outputs to their limits, along its only parameter; see `peak`."""
    failed = run.result != RESULTS.successful
    found = {name: (np.nan,) * 3 if failed else peak(run, name, neighbours) for name in limits}
    return Margins(
        place,
        {name: float(np.log(limits[name] / value)) for name, (value, _, _) in found.items()},
        {name: -slope / value for name, (value, slope, _) in found.items()},
        {name: time for name, (_, _, time) in found.items()},
    )


def peak(run: Sensitivities, name: str, neighbours: int = 1) -> tuple[float, float, float]:
    """Largest value of an output, its derivative along the only parameter, and its time, s.

    It is that of the parabola through the largest of the values and so many on either side; the
    derivative is interpolated likewise. At an end of the run it is the value there.
    """
    values, slopes, times = run.values[name], run.derivatives[name][:, 0], run.times
    k = int(np.argmax(values))
    if not neighbours <= k < len(values) - neighbours:
        return float(values[k]), float(slopes[k]), float(times[k])
    near = slice(k - neighbours, k + neighbours + 1)
    unit = float(np.ptp(times[near]))
    shifts = (times[near] - times[k]) / unit
    arc, slope = np.polyfit(shifts, np.stack([values[near], slopes[near]], axis=1), 2).T
    shift = float(np.clip(-0.5 * arc[1] / arc[0], -1.0, 1.0)) if arc[0] < 0.0 else 0.0
    value, derivative = np.polyval(arc, shift), np.polyval(slope, shift)
    return float(value), float(derivative), float(times[k] + shift * unit)


@dataclass(frozen=True)
class MarginZero:
    """Where the smallest margin is zero, and all places that were looked at on the way.

    `known`: whether a zero was found; if not, the margin is nowhere negative, as far as was seen,
    and `place` is the upper end.

    >>> def look(place):  # at c = exp(place) the peak is c**2, the limit 4.0
    ...     margin = np.log(4.0) - 2.0 * place
    ...     return cj.Margins(place, {"force": margin}, {"force": -2.0}, {"force": 0.0})
    >>> found = cj.largest_within(look, 0.0, 0.5)  # up to c = 1.65
    >>> found.place, found.known, len(found.path)
    (0.5, False, 2)
    """

    place: float
    path: list[Margins]
    known: bool


def largest_within(
    look: Callable[[float], Margins], low: float, high: float, tolerance: float = 1e-5
) -> MarginZero:
    """The zero of the smallest margin between two places, by safeguarded Newton steps from `low`.

    A step that leaves the places known to hold and to fail, or follows two that did not halve the
    margin, is replaced by a bisection (to the upper end while nothing is known to fail). So margin
    or bracket are halved every few runs, also where the derivative is of no use. What lies between
    the places looked at is not seen: if the margin rises and falls, a sweep must tell whether all
    smaller values hold. (The loop is Python's because a look is a run on the host; solvers of
    optimistix trace theirs, and none of them keeps a bracket round Newton's steps.)

    **Arguments:** `tolerance`: of the margin, or of the bracket of a margin that jumps.

    **Raises:** `ValueError` if the lower end fails.

    >>> def look(place):  # at c = exp(place) the peak is c**2, the limit 4.0
    ...     margin = np.log(4.0) - 2.0 * place
    ...     return cj.Margins(place, {"force": margin}, {"force": -2.0}, {"force": 0.0})
    >>> found = cj.largest_within(look, 0.0, 3.0)
    >>> found.known, round(float(np.exp(found.place)), 6)
    (True, 2.0)
    """
    path, good, bad = [look(low)], low, None
    remedy = "lower it, or raise the limits"
    require(path[0].holds, "low", low, f"a place that holds, with `{path[0].narrowest}`", remedy)
    while not abs(path[-1].margin) <= tolerance:
        top = high if bad is None else bad
        place = newton_step(path)
        if not good < place < top:
            place = high if bad is None else 0.5 * (good + bad)
        path.append(look(place))
        good, bad = (place, bad) if path[-1].holds else (good, place)
        if good == high or (bad is not None and bad - good <= tolerance):
            return MarginZero(good, path, bad is not None)
    return MarginZero(path[-1].place, path, True)


def newton_step(path: list[Margins]) -> float:
    """Where the tangent at the last place looked at is zero; NaN if the last two steps together did
    not halve the margin, or the tangent is level."""
    now = path[-1]
    slow = len(path) > 2 and not abs(now.margin) <= 0.5 * abs(path[-3].margin)
    return np.nan if slow or now.slope == 0.0 else now.place - now.margin / now.slope
