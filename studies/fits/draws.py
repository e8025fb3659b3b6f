"""Fits of many draws of a sensor's noise: scatter, bias and coverage of the estimates."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

import clearjoint as cj
from studies.fits.problem import ASTRAY, STARTS, TRUTH, Attempt, coordinates, fit, ideal

LOWER = 0.1
"""Difference in chi squared by which a minimum counts as lower than another."""
STIFF, SOFT = STARTS
TRIALS = (
    ("probes", STIFF, "windows", 1.0),
    ("probes", SOFT, "windows", 4.0),
    ("accelerometers", STIFF, "velocities first", 1.0),
    ("accelerometers", SOFT, "velocities first", 1.0),
    ("accelerometers", STIFF, "screened", 1.0),
    ("accelerometers", SOFT, "screened", 1.0),
    ("camera", "truth", "at once", 1.0),
    ("camera", SOFT, "windows", 1.0),
    ("camera", STIFF, "windows", 0.1),
    ("camera", STIFF, "windows, 12 starts", 0.04),
    ("camera", STIFF, "screened", 1.0),
    ("camera", SOFT, "screened", 1.0),
)
"""Sensor, start, search, and the number of draws as a multiple of the option `--draws`."""
HEAD = (
    "sensor, start, search",
    "draws",
    "astray",
    "astray with a warning",
    "scatter / bound",
    "bias / its error",
    "intervals that contain the truth, %",
    "lower minima than from the truth",
    "runs",
    "screening runs",
    "s",
)


@dataclass(frozen=True)
class Trial:
    """A number of draws of a sensor's noise, each fitted from one start by one search."""

    sensor: str
    start: str
    way: str
    draws: int


@dataclass(frozen=True)
class Recovery:
    """Fits to n draws of the noise.

    `errors` (n, p): errors of the coordinates over the Cramér-Rao bounds. `nearest`: fits to the
    same draws from the truth, if they were made.
    """

    label: str
    attempts: tuple[Attempt, ...]
    errors: np.ndarray
    nearest: tuple[Attempt, ...] | None = None

    @property
    def astray(self) -> np.ndarray:
        """(n,) whether a fit ended further from the truth than noise explains."""
        return np.abs(self.errors).max(axis=1) > ASTRAY

    @property
    def warned(self) -> int:
        """Number of fits astray that have a warning."""
        pairs = zip(self.attempts, self.astray, strict=True)
        return sum(bool(attempt.found.warnings) for attempt, astray in pairs if astray)

    @property
    def scatter(self) -> np.ndarray:
        """(p,) standard deviation of the fits not astray, over the bound."""
        return self.errors[~self.astray].std(axis=0, ddof=1)

    @property
    def bias(self) -> np.ndarray:
        """(p,) mean error of the fits not astray, over its standard error."""
        errors = self.errors[~self.astray]
        return errors.mean(axis=0) / (self.scatter / np.sqrt(len(errors)))

    @property
    def coverage(self) -> np.ndarray:
        """(p,) fraction of the 95 % intervals of fits not astray that contain the truth."""
        inside = [
            [low < TRUTH[name] < high for name, (low, high) in attempt.found.intervals.items()]
            for attempt, astray in zip(self.attempts, self.astray, strict=True)
            if not astray
        ]
        return np.mean(inside, axis=0)

    @property
    def lower(self) -> int | None:
        """Number of draws with a lower chi squared than that of the fit from the truth."""
        if self.nearest is None:
            return None
        pairs = zip(self.attempts, self.nearest, strict=False)
        return sum(near.found.chi_squared - a.found.chi_squared > LOWER for a, near in pairs)

    def cells(self) -> tuple[str, ...]:
        """Return the row as text."""
        runs = [attempt.runs for attempt in self.attempts]
        astray = int(self.astray.sum())
        statistics = ("-", "-", "-")
        if len(runs) - astray > 1:
            statistics = (
                ", ".join(f"{part:.2f}" for part in self.scatter),
                ", ".join(f"{part:+.1f}" for part in self.bias),
                ", ".join(f"{100.0 * part:.0f}" for part in self.coverage),
            )
        return (
            self.label,
            str(len(runs)),
            str(astray),
            str(self.warned),
            *statistics,
            "" if self.lower is None else str(self.lower),
            f"{np.median(runs):.0f}, at most {max(runs)}",
            f"{np.median([attempt.screening for attempt in self.attempts]):.0f}",
            f"{np.median([attempt.seconds for attempt in self.attempts]):.2f}",
        )


def trials(sensor: str, draws: int) -> list[Trial]:
    """Return the trials of a sensor for a basic number of draws."""
    return [
        Trial(name, start, way, max(2, round(part * draws)))
        for name, start, way, part in TRIALS
        if name == sensor
    ]


def recoveries(sensor: str, trials: Sequence[Trial], end_time: float) -> Iterator[Recovery]:
    """Fit all draws of the trials of a sensor."""
    clean, bounds = ideal(sensor, end_time)
    fit(clean, TRUTH, "at once", end_time)  # compiles
    nearest = None
    for trial in trials:
        found = recover(clean, bounds, trial, end_time, nearest)
        # No fit can do better than the one from the truth, unless the lowest minimum is elsewhere.
        if trial.start == "truth":
            nearest = found.attempts
        yield found


def recover(
    clean: cj.Measurements,
    bounds: dict[str, float],
    trial: Trial,
    end_time: float,
    nearest: tuple[Attempt, ...] | None = None,
) -> Recovery:
    """Fit draws of the noise of measurements, each from the start of the trial."""
    generator, guess = np.random.default_rng(0), STARTS.get(trial.start, TRUTH)
    attempts = tuple(
        fit(clean.with_noise(generator), guess, trial.way, end_time) for _ in range(trial.draws)
    )
    errors = np.array([a.found.coordinates for a in attempts]) - coordinates(TRUTH)
    label = f"{trial.sensor}, {trial.start}, {trial.way}"
    return Recovery(label, attempts, errors / np.array(list(bounds.values())), nearest)
