"""Parameters of the double pendulum recovered from many draws of a sensor's noise.

``python -m studies.recovery [--draws 50] [--quick]``: the problem and the starts of
`studies.identification`, each draw fitted anew from the far starts, in the ways of that study. If
the estimates are as good as the data allow, they scatter as the Cramér-Rao bound says, their mean
is off by no more than its own error, and 95 of 100 intervals hold the truth. The camera is fitted
from the truth as well, so that draws in which a lower minimum lies elsewhere are known: no fit can
tell in them which one is right. ``--quick`` fits two draws of the probes to 0.03 s from the truth.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import clearjoint as cj

from .identification import PARAMETERS, SENSORS, STARTS, TRUTH, Attempt, fit, ideal

STIFF, SOFT = STARTS
WAYS = (
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
"""Sensor, start, way to fit, and how many times the draws are fitted so: 50 draws leave the scatter
uncertain by a tenth, and starts cost runs."""
ASTRAY = 5.0
"""Error, in Cramér-Rao bounds, beyond which noise does not explain where a fit ended."""
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


def coordinates(values: dict[str, float]) -> np.ndarray:
    """Coordinates (p,) of the parameters' values."""
    return np.array([PARAMETERS[name].scale.coordinate(value) for name, value in values.items()])


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


def study(sensor: str, ways: Sequence[tuple[str, str, int]], end_time: float) -> None:
    """Print the bounds of a sensor and a row for each start, way and number of draws."""
    clean, bounds = ideal(sensor, end_time)
    fit(clean, TRUTH, "at once", end_time)  # compiles
    slopes = {n: p.scale.slope(p.scale.coordinate(TRUTH[n])) for n, p in PARAMETERS.items()}
    parts = (f"{name} {bounds[name] * slopes[name] / TRUTH[name]:.2g}" for name in TRUTH)
    print(f"{sensor} to {end_time} s; relative Cramér-Rao bounds: {', '.join(parts)}")
    print("| " + " | ".join(HEADINGS) + " |\n" + "|---" * len(HEADINGS) + "|")
    nearest = None
    for start, how, draws in ways:
        guess = STARTS.get(start, TRUTH)
        found = recovery(clean, bounds, guess, how, draws, end_time)
        print(row(f"{sensor}, {start}, {how}", found), flush=True)
        if start == "truth":
            nearest = found
        elif nearest is not None and how == "screened":
            print(lower(found, nearest), flush=True)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="two draws of the probes to 0.03 s")
    parser.add_argument("--draws", type=int, default=50)
    parser.add_argument("--sensors", nargs="+", choices=SENSORS, default=list(SENSORS))
    options = parser.parse_args(arguments)
    if options.quick:
        study("probes", [("truth", "at once", 2)], 0.03)
        return
    for sensor in options.sensors:
        chosen = [(s, how, part) for name, s, how, part in WAYS if name == sensor]
        ways = [(s, how, max(2, round(part * options.draws))) for s, how, part in chosen]
        study(sensor, ways, 0.1)


if __name__ == "__main__":
    cj.configure()
    main()
