"""Searches with derivatives compared with searches without, on one draw of the probes' noise.

All searches begin at the same starts, drawn around the truth: far ones within a factor 5 of Young's
modulus, a restitution of 0.6 to 0.98 and 20 % of the clearance; near ones within a tenth of that,
in coordinates. A search succeeds if all parameters end within five Cramér-Rao bounds of the truth.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np

import clearjoint as cj
from studies.fits import scipy_fit
from studies.fits.problem import ASTRAY, PARAMETERS, SENSORS, TRUTH, WINDOWS, coordinates, ideal
from studies.fits.scipy_fit import Found

SPREAD = np.array([np.log(5.0), np.log(0.9 / 0.1) - np.log(0.6 / 0.4), np.log(1.2)])
"""Half the range of far starts, in coordinates."""
RANGES = {"near": 0.1, "far": 1.0}
"""Ranges of the starts as fractions of `SPREAD`."""
NOISE = SENSORS["probes"][1]
SCALES = {name: parameter.scale for name, parameter in PARAMETERS.items()}
FINE_STEP = 1e-6
"""Relative step of finite differences with the smallest error here."""
HEAD = ("search, starts", "successes", "runs: median, largest", "s: median, largest")


@dataclass(frozen=True)
class Row:
    """Searches from all starts of a range."""

    label: str
    found: Sequence[Found]
    bounds: np.ndarray

    @property
    def successes(self) -> int:
        """Number of searches that ended at the truth."""
        errors = [np.abs(one.coordinates - coordinates(TRUTH)) / self.bounds for one in self.found]
        return sum(bool(error.max() < ASTRAY) for error in errors)

    def cells(self) -> tuple[str, ...]:
        """Return the row as text."""
        runs, seconds = [one.runs for one in self.found], [one.seconds for one in self.found]
        return (
            self.label,
            f"{self.successes} of {len(self.found)}",
            f"{np.median(runs):.0f}, {max(runs)}",
            f"{np.median(seconds):.2f}, {max(seconds):.1f}",
        )


@dataclass(frozen=True)
class Problem:
    """Readings of the probes, (4, T) m at times (T,) s, and the Cramér-Rao bounds (p,)."""

    measurements: cj.Measurements
    times: np.ndarray
    values: np.ndarray
    bounds: np.ndarray

    def ends(self, windows: bool) -> list[float]:
        """Return the ends of the windows, s; the last is that of the record."""
        last = float(self.times[-1])
        return [*(end for end in WINDOWS if windows and end < last), last]

    def identify(self, start: np.ndarray, windows: bool) -> Found:
        """Search with `cj.identify` from coordinates (p,)."""
        scene, state = cj.mechanisms.double_pendulum()
        guess = {n: float(s.value(u)) for (n, s), u in zip(SCALES.items(), start, strict=True)}
        grow = self.ends(windows)[:-1]
        begun = time.perf_counter()
        found = cj.identify(
            scene,
            state,
            self.measurements,
            PARAMETERS,
            guess=guess,
            grow=grow,
            check_runs=0,
            progress=False,
        )
        runs = found.best.evaluations
        return Found(found.coordinates, runs, time.perf_counter() - begun)

    def least_squares(self, start: np.ndarray, windows: bool, step: float | None) -> Found:
        """Search with SciPy from coordinates (p,), with a relative step of differences."""
        scales, ends = tuple(SCALES.values()), self.ends(windows)
        return scipy_fit.fit(self.times, self.values, NOISE, scales, start, ends, step)


def problem(end_time: float) -> Problem:
    """Return one draw of the noise on the probes."""
    clean, bounds = ideal("probes", end_time)
    drawn = clean.with_noise(np.random.default_rng(0))
    values = np.stack([np.asarray(series.values) for series in drawn.series.values()])
    return Problem(drawn, drawn.times(), values, np.array(list(bounds.values())))


def starts(fraction: float, number: int) -> np.ndarray:
    """Return coordinates (number, p), uniform over a fraction of `SPREAD` around the truth."""
    drawn = np.random.default_rng(1).uniform(-1.0, 1.0, (number, len(SPREAD)))
    return coordinates(TRUTH) + fraction * SPREAD * drawn


def rows(quick: bool, number: int) -> Iterator[Row]:
    """Search from a number of starts of each range; if `quick`, from two near ones at once."""
    data = problem(0.03 if quick else 0.1)
    ranges, number = (("near",), 2) if quick else (tuple(RANGES), number)
    searches: dict[str, Callable[[np.ndarray, bool], Found]] = {
        "`identify`": data.identify,
        "`least_squares`": lambda start, windows: data.least_squares(start, windows, None),
        f"`least_squares`, `diff_step={FINE_STEP:g}`": lambda start, windows: data.least_squares(
            start, windows, FINE_STEP
        ),
    }
    for windows in (False,) if quick else (False, True):
        for name, search in searches.items():
            search(coordinates(TRUTH), windows)  # compiles
            for kind in ranges:
                found = [search(start, windows) for start in starts(RANGES[kind], number)]
                label = f"{name}, {'windows' if windows else 'at once'}, {kind}"
                yield Row(label, found, data.bounds)
    if quick:
        return
    if find_spec("exudyn") is None:
        print("Exudyn is not installed (pip install 'exudyn>=1.13'): its rows are left out.")
        return
    yield from _exudyn_rows(data, number)


def _exudyn_rows(data: Problem, number: int) -> Iterator[Row]:
    """Search with Exudyn's optimiser on data of Exudyn's own model."""
    from studies.common.baselines import exudyn_pendulum
    from studies.fits import exudyn_fit

    clean = exudyn_pendulum.probes(**TRUTH, times=data.times, step=exudyn_fit.STEP)
    drawn = clean + NOISE * np.random.default_rng(0).standard_normal(clean.shape)
    misfit = exudyn_fit.Misfit(data.times, drawn, NOISE, SCALES)
    low, high = coordinates(TRUTH) - SPREAD, coordinates(TRUTH) + SPREAD
    limits = dict(zip(PARAMETERS, zip(low.tolist(), high.tolist(), strict=True), strict=True))
    for kind, factor in RANGES.items():
        found = [exudyn_fit.minimise(misfit, start, limits) for start in starts(factor, number)]
        yield Row(f"Exudyn `Minimize`, {kind}", found, data.bounds)
