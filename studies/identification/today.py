"""Parameters from measurements with clearjoint's derivatives, and as a user would find them today.

The probes of the study, 0.1 s, one draw of the noise. Each way searches from the same starts,
drawn around the truth: far ones within a factor 5 of Young's modulus, a restitution of 0.6 to 0.98
and 20 % of the clearance, near ones within a tenth of that, in the coordinates of the scales.

- `identify`: derivatives of the motion. At once, or over growing windows.
- SciPy's `least_squares` with finite differences on `cj.simulate`; see
  `studies.common.baselines.scipy_fit`.
- Exudyn's optimisers on Exudyn's model and its own data, if installed; see
  `studies.common.baselines.exudyn_fit`.

A search succeeds that ends within five Cramér-Rao bounds of the truth in all parameters.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np

import clearjoint as cj
from studies.common.baselines import scipy_fit
from studies.common.baselines.scipy_fit import Found
from studies.common.identification_problem import (
    ASTRAY,
    PARAMETERS,
    SENSORS,
    TRUTH,
    WINDOWS,
    coordinates,
    ideal,
)

SPREAD = np.array([np.log(5.0), np.log(0.9 / 0.1) - np.log(0.6 / 0.4), np.log(1.2)])
"""Half the range of far starts, in coordinates."""
PARTS = {"near": 0.1, "far": 1.0}
NOISE = SENSORS["probes"][1]
SCALES = {name: parameter.scale for name, parameter in PARAMETERS.items()}
FINER = 1e-6
"""Relative step of differences whose error is least here: 1e-4, of SciPy's own step 1e-3."""


@dataclass(frozen=True)
class Problem:
    """Data of the probes, (4, T) m at `times`, s, and the Cramér-Rao bounds (p,)."""

    measurements: cj.Measurements
    times: np.ndarray
    values: np.ndarray
    bounds: np.ndarray

    def ends(self, windows: bool) -> list[float]:
        """Ends of the windows, s, the whole record last."""
        last = float(self.times[-1])
        return [*(end for end in WINDOWS if windows and end < last), last]

    def identified(self, start: np.ndarray, windows: bool) -> Found:
        """By `identify`."""
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

    def by_differences(self, start: np.ndarray, windows: bool, step: float | None) -> Found:
        """By `least_squares`."""
        scales, ends = tuple(SCALES.values()), self.ends(windows)
        return scipy_fit.fit(self.times, self.values, NOISE, scales, start, ends, step)


def problem(end_time: float) -> Problem:
    """One draw of the noise on the probes."""
    clean, bounds = ideal("probes", end_time)
    drawn = clean.with_noise(np.random.default_rng(0))
    values = np.stack([np.asarray(series.values) for series in drawn.series.values()])
    return Problem(drawn, drawn.times(), values, np.array(list(bounds.values())))


def starts(part: float, number: int) -> np.ndarray:
    """(number, p) coordinates, evenly over a part of the range around the truth."""
    drawn = np.random.default_rng(1).uniform(-1.0, 1.0, (number, len(SPREAD)))
    return coordinates(TRUTH) + part * SPREAD * drawn


def row(label: str, founds: Sequence[Found], bounds: np.ndarray) -> str:
    """A line of the table: successes, medians of runs and seconds, and the most."""
    errors = [np.abs(found.coordinates - coordinates(TRUTH)) / bounds for found in founds]
    hits = sum(bool(error.max() < ASTRAY) for error in errors)
    runs, seconds = [f.runs for f in founds], [f.seconds for f in founds]
    return (
        f"| {label} | {hits} of {len(founds)} | {np.median(runs):.0f}, at most {max(runs)} "
        f"| {np.median(seconds):.2f}, at most {max(seconds):.1f} |"
    )


def compare(data: Problem, parts: Sequence[str], number: int, windows: Sequence[bool]) -> None:
    """Rows of `identify` and `least_squares`."""
    truth = coordinates(TRUTH)
    ways: dict[str, Callable[[np.ndarray, bool], Found]] = {
        "identify": data.identified,
        "least_squares": lambda start, growing: data.by_differences(start, growing, None),
        f"least_squares, steps {FINER:g}": lambda start, growing: data.by_differences(
            start, growing, FINER
        ),
    }
    for growing in windows:
        for name, way in ways.items():
            way(truth, growing)  # compiles
            for part in parts:
                founds = [way(start, growing) for start in starts(PARTS[part], number)]
                how = "windows" if growing else "at once"
                print(row(f"{name}, {how}, {part}", founds, data.bounds), flush=True)


def compare_exudyn(data: Problem, number: int, seeds: int) -> None:
    """Rows of Exudyn's optimisers on its own model's data."""
    from studies.common.baselines import exudyn_fit, exudyn_pendulum

    clean = exudyn_pendulum.probes(**TRUTH, times=data.times, step=exudyn_fit.STEP)
    drawn = clean + NOISE * np.random.default_rng(0).standard_normal(clean.shape)
    misfit = exudyn_fit.Misfit(data.times, drawn, NOISE, SCALES)
    for part, factor in PARTS.items():
        founds = [exudyn_fit.simplex(misfit, start, ranges()) for start in starts(factor, number)]
        print(row(f"Exudyn Minimize, {part}", founds, data.bounds), flush=True)
    if seeds > 0:
        founds = [exudyn_fit.genetic(misfit, ranges(), seed) for seed in range(seeds)]
        print(row("Exudyn GeneticOptimization, then Minimize, far", founds, data.bounds))


def ranges() -> dict[str, tuple[float, float]]:
    """Coordinates that far starts come from, by name."""
    low, high = coordinates(TRUTH) - SPREAD, coordinates(TRUTH) + SPREAD
    pairs = zip(low.tolist(), high.tolist(), strict=True)
    return dict(zip(PARAMETERS, pairs, strict=True))


def run(quick: bool, number: int, genetic: int) -> None:
    """Print all rows for a number of starts and of genetic searches; if `quick`, those of two near
    starts, 0.03 s, at once, without Exudyn."""
    data = problem(0.03 if quick else 0.1)
    print("| way, starts | successes | runs | s |\n|---|---|---|---|")
    if quick:
        compare(data, ("near",), 2, (False,))
        return
    compare(data, tuple(PARTS), number, (False, True))
    if find_spec("exudyn") is None:
        print("Exudyn is not installed (pip install 'exudyn>=1.13'): its rows are left out.")
        return
    compare_exudyn(data, number, genetic)
