"""Fits of one draw of the noise by several searches from starts far off the true values."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from studies.fits.problem import STARTS, TRUTH, Attempt, fit, ideal

HEAD = ("sensor", "start", "search", "ending", "chi²/N", "runs", "screening runs", "s", "estimates")


@dataclass(frozen=True)
class Row:
    """A fit to the data of a sensor."""

    sensor: str
    start: str
    way: str
    attempt: Attempt

    @property
    def chi_squared(self) -> float:
        """Chi squared of a sample."""
        return self.attempt.found.chi_squared / self.attempt.found.samples

    def cells(self) -> tuple[str, ...]:
        """Return the row as text."""
        found = self.attempt.found
        return (
            self.sensor,
            self.start,
            self.way,
            found.ending.name.lower(),
            f"{self.chi_squared:.4f}",
            f"{self.attempt.runs}",
            f"{self.attempt.screening}",
            f"{self.attempt.seconds:.1f}",
            ", ".join(f"{name} {value:.5g}" for name, value in found.estimates.items()),
        )


def ways(sensor: str) -> list[str]:
    """Return the searches that are tried on data of a sensor."""
    summed = ["velocities first"] if sensor == "accelerometers" else []
    return ["at once", "windows", "windows, 12 starts", "screened", *summed]


def rows(sensor: str, ways: Sequence[str], end_time: float) -> Iterator[Row]:
    """Fit one draw of the noise from all starts by all searches."""
    clean, _ = ideal(sensor, end_time)
    data = clean.with_noise(np.random.default_rng(1))
    fit(data, TRUTH, "at once", end_time)  # compiles
    for start, guess in {"truth": TRUTH, **STARTS}.items():
        for way in ways:
            yield Row(sensor, start, way, fit(data, guess, way, end_time))
