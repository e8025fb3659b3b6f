"""Fits of simulated logs, and how often their intervals hold the true values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

import clearjoint as cj


@dataclass(frozen=True)
class Draw:
    """A fit of one simulated log, the true values by name, and its processor time, s."""

    found: cj.results.RobotFit
    truth: Mapping[str, float]
    seconds: float

    def estimate(self, name: str) -> float:
        """Return an estimate, or the start of what the log doesn't determine."""
        held = self.found.held
        return held[name][0] if name in held else self.found.fit.estimates[name]

    def holds(self, name: str) -> bool:
        """Return whether the 95 % interval holds the true value."""
        low, high = self.found.intervals[name]
        return low <= self.truth[name] <= high

    def error(self, name: str) -> float:
        """Return the error of an estimate's logarithm over its standard error."""
        fit = self.found.fit
        k = [*fit.parameters].index(name)
        deviation = np.sqrt(fit.covariance[k, k])
        return (fit.coordinates[k] - np.log(self.truth[name])) / deviation

    @property
    def mean_square(self) -> float:
        """Mean square of the residuals over their noise."""
        residuals = np.concatenate([*self.found.fit.residuals.values()])
        return float(np.mean(residuals**2))


COVERAGE: tuple[str, str] = (
    "intervals that hold it",
    "error over standard error, mean ± deviation",
)
"""Head of the columns by `coverage`."""


def coverage(draws: Sequence[Draw], name: str) -> tuple[str, str]:
    """Return how many of the intervals hold the true value of a parameter, without those of draws
    that don't determine it, and the spread of the errors over the standard errors."""
    known = [draw for draw in draws if name in draw.found.intervals]
    if not known:
        return "none", ""
    held = sum(draw.holds(name) for draw in known)
    # An estimate that is about zero has an interval, but no error of its logarithm.
    errors = [draw.error(name) for draw in known if name in draw.found.fit.parameters]
    spread = f"{np.mean(errors):.2f} ± {np.std(errors):.2f}" if errors else ""
    return f"{held} of {len(known)}", spread
