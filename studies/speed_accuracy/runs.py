"""Measurement of a setting: error before the horizon, and energy error and cost beyond it."""

import gzip
import time
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from statistics import median

import numpy as np

import clearjoint as cj
from studies.speed_accuracy import evaluations
from studies.speed_accuracy.settings import Setting

REFERENCE = Path(__file__).resolve().parents[2] / "tests" / "data" / "reference"
"""Trajectories of the event-exact solver in extended precision."""
ROWS_APART = 20
"""Stride through the rows of the reference, which are 0.1 ms apart."""
SAVED = 51
CLEARANCE = 0.5e-3
"""Radial clearance, m."""
NUDGE = 1e-6
"""Relative change of the clearance from draw to draw, which changes a chaotic motion."""
SLOW = 3.0
"""Time of a run above which no further draws are made, s."""
MAX_STEPS = 1_500_000


@dataclass(frozen=True)
class Spans:
    """Spans of the runs.

    - `short`: end of the comparison with the reference before the horizon, s.
    - `long`: end of the runs for energy and cost, s, over `draws` clearances.
    """

    short: float = 0.1
    long: float = 2.0
    draws: int = 3


QUICK = Spans(0.012, 0.05, 1)
FULL = Spans()


@dataclass(frozen=True)
class Truth:
    """Centres of both arms, (times, 2, 3) m, at `times`, s."""

    times: np.ndarray
    centres: np.ndarray

    def error(self, solution: cj.results.Solution) -> float:
        """Return the largest error of a coordinate, m; NaN for a run that ended early."""
        if solution.result != cj.RESULTS.successful:
            return float("nan")
        return float(np.abs(centres(solution) - self.centres).max())


def compared(end: float) -> np.ndarray:
    """Return the instants of the comparison, s."""
    count = round(1e4 * end) // ROWS_APART
    return np.minimum(1e-4 * ROWS_APART * np.arange(count + 1), end)


def centres(solution: cj.results.Solution) -> np.ndarray:
    """Return the centres of both arms at the saved times, (times, 2, 3) m."""
    bodies = solution.states.bodies
    return np.stack([np.asarray(bodies[name].position) for name in ("arm 2", "arm 3")], axis=1)


@cache
def truth(end: float, restitution: float = 0.9) -> Truth:
    """Return the reference trajectory up to a time, s."""
    file = REFERENCE / f"double_pendulum_c0.0005_e{restitution:.1f}.csv.gz"
    with gzip.open(file, "rt") as lines:
        names = lines.readline().strip().split(",")
        table = np.loadtxt(lines, delimiter=",")[::ROWS_APART]
    columns = [[names.index(f"r{body}{axis}") for axis in "xyz"] for body in (2, 3)]
    return Truth(compared(end), table[: len(compared(end)), columns])


@dataclass(frozen=True)
class Point:
    """Measurements of a setting.

    - `error`, m, and `short_evaluations`: of the short run.
    - `residual`: energy error of the long run over the energy exchanged.
    - `attempts`, `evaluations`, `seconds`: of the long run without a ledger.

    Values are NaN for runs that failed or took more than `MAX_STEPS`.
    """

    setting: Setting
    error: float
    short_evaluations: float
    residual: float
    attempts: float
    evaluations: float
    seconds: float

    def __str__(self) -> str:
        return str(self.setting)


def measured(setting: Setting, spans: Spans) -> Point:
    """Measure a setting, after a run that compiles."""
    settings = setting.settings
    scene, state = cj.mechanisms.double_pendulum()
    goal = truth(spans.short)
    short = run(scene, state, goal.times, settings)
    each = evaluations.an_attempt(settings)
    if each is None:
        each = evaluations.counted(min(spans.short, 0.03), settings)
    attempts, seconds, residual = medians(settings, spans)
    return Point(
        setting,
        goal.error(short),
        each * int(short.attempts),
        residual,
        attempts,
        each * attempts,
        seconds,
    )


def medians(settings: cj.Settings, spans: Spans) -> tuple[float, float, float]:
    """Return the medians of the draws of `long_run`. One that fails or is slow counts for all."""
    draws = [long_run(settings, spans.long, 0)]
    if draws[0][1] < SLOW:
        draws += [long_run(settings, spans.long, draw) for draw in range(1, spans.draws)]
    attempts, seconds, residual = (median(column) for column in zip(*draws, strict=True))
    return attempts, seconds, residual


def long_run(settings: cj.Settings, end: float, draw: int) -> tuple[float, float, float]:
    """Return attempts, time, s, and energy error over the energy exchanged."""
    scene, state = cj.mechanisms.double_pendulum(CLEARANCE * (1.0 + NUDGE * draw))
    times = np.linspace(0.0, end, SAVED)
    attempts, seconds = cost(scene, state, times, settings)
    if not np.isfinite(attempts):
        return attempts, seconds, float("nan")
    kept = run(scene, state, times, replace(settings, ledger=True))
    return attempts, seconds, ledger_residual(scene, kept)


def cost(
    scene: cj.Scene, state: cj.State, times: np.ndarray, settings: cj.Settings
) -> tuple[float, float]:
    """Return attempts and processor time of a run, s, with checks; NaN if it failed."""
    begun = time.process_time()
    solution = run(scene, state, times, settings)
    seconds = time.process_time() - begun
    if solution.result != cj.RESULTS.successful:
        return float("nan"), float("nan")
    return float(solution.attempts), seconds


def ledger_residual(scene: cj.Scene, solution: cj.results.Solution) -> float:
    """Return the largest energy error over the energy exchanged with gravity."""
    if solution.result != cj.RESULTS.successful:
        return float("nan")
    observed = cj.observe(scene, solution)
    left = np.abs(observed.ledger_residual()).max() / np.ptp(observed.energies["gravity"])
    return float(left) if np.isfinite(left) else float("nan")


def run(
    scene: cj.Scene,
    state: cj.State,
    times: np.ndarray,
    settings: cj.Settings,
    impacts: bool = False,
) -> cj.results.Solution:
    """Simulate to the last of the times and save at all of them, in at most `MAX_STEPS` steps."""
    limited = replace(settings, max_steps=min(settings.max_steps, MAX_STEPS))
    save = cj.Saving(times, impacts=impacts)
    return cj.simulate(scene, state, float(times[-1]), limited, save, throw=False, progress=False)
