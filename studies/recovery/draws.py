"""Parameters recovered from many draws of a sensor's noise."""

from dataclasses import dataclass

import numpy as np

import clearjoint as cj
from studies.common.identification_problem import (
    ASTRAY,
    TRUTH,
    Attempt,
    coordinates,
    fit,
)

LOWER = 0.1
"""Chi squared by which a minimum counts as lower than another."""
HEADINGS = (
    "sensor, start, way",
    "draws",
    "astray",
    "told",
    "scatter / bound",
    "bias / its error",
    "intervals with the truth, %",
    "runs",
    "without derivatives",
    "s",
)


@dataclass(frozen=True)
class Recovery:
    """Fits to draws of the noise, (n,), and the errors of their coordinates over the bounds,
    (n, p)."""

    attempts: tuple[Attempt, ...]
    errors: np.ndarray

    @property
    def astray(self) -> np.ndarray:
        """(n,) whether a fit ended elsewhere."""
        return np.abs(self.errors).max(axis=1) > ASTRAY

    @property
    def told(self) -> int:
        """Number of fits astray that say so, by a warning."""
        pairs = zip(self.attempts, self.astray, strict=True)
        return sum(bool(attempt.found.warnings) for attempt, astray in pairs if astray)

    @property
    def scatter(self) -> np.ndarray:
        """(p,) standard deviation of the fits that did not go astray, over the bound."""
        return self.errors[~self.astray].std(axis=0, ddof=1)

    @property
    def bias(self) -> np.ndarray:
        """(p,) mean of their errors, over its standard error."""
        fine = self.errors[~self.astray]
        return fine.mean(axis=0) / (self.scatter / np.sqrt(len(fine)))

    @property
    def coverage(self) -> np.ndarray:
        """(p,) part of their 95 % intervals that hold the truth."""
        inside = [
            [low < TRUTH[name] < high for name, (low, high) in attempt.found.intervals.items()]
            for attempt, astray in zip(self.attempts, self.astray, strict=True)
            if not astray
        ]
        return np.mean(inside, axis=0)


def recovery(
    clean: cj.Measurements,
    bounds: dict[str, float],
    guess: dict[str, float],
    how: str,
    draws: int,
    end_time: float,
) -> Recovery:
    """Fit draws of the noise of measurements, each from the same guess."""
    generator = np.random.default_rng(0)
    attempts = [fit(clean.with_noise(generator), guess, how, end_time) for _ in range(draws)]
    offsets = np.array([one.found.coordinates for one in attempts]) - coordinates(TRUTH)
    return Recovery(tuple(attempts), offsets / np.array(list(bounds.values())))


def lower(found: Recovery, nearest: Recovery) -> str:
    """In how many of the same draws chi squared is lower than in the minimum nearest the truth, by
    how much, and how far that is from the truth."""
    pairs = zip(found.attempts, nearest.attempts, strict=False)
    gains = np.array([near.found.chi_squared - one.found.chi_squared for one, near in pairs])
    gained = gains > LOWER
    if not gained.any():
        return f"chi squared lower than from the truth: in 0 of {len(gains)} draws"
    errors = np.abs(found.errors[: len(gains)][gained]).max(axis=1)
    return (
        f"chi squared lower than from the truth: in {gained.sum()} of {len(gains)} draws, by "
        f"{gains[gained].min():.2g} to {gains.max():.2g}, {np.median(errors):.1f} bounds off "
        f"(median; at most {errors.max():.1f})"
    )


def row(label: str, found: Recovery) -> str:
    """A line of the table."""
    runs = [attempt.runs for attempt in found.attempts]
    astray = int(found.astray.sum())
    cells = [label, str(len(runs)), str(astray), str(found.told)]
    if len(runs) - astray > 1:
        cells += [", ".join(f"{part:.2f}" for part in found.scatter)]
        cells += [", ".join(f"{part:+.1f}" for part in found.bias)]
        cells += [", ".join(f"{100.0 * part:.0f}" for part in found.coverage)]
    else:
        cells += ["-", "-", "-"]
    screening = np.median([attempt.screening for attempt in found.attempts])
    seconds = np.median([attempt.seconds for attempt in found.attempts])
    cells += [f"{np.median(runs):.0f}, at most {max(runs)}", f"{screening:.0f}", f"{seconds:.2f}"]
    return "| " + " | ".join(cells) + " |"
