"""Parameters of the double pendulum from made-up measurements, and which starts lead to them.

``python -m studies.identification [--quick]``: c = 0.5 mm, e = 0.9, steel, 0.1 s at 10 kHz, seen by
proximity probes at both bases (5 µm), accelerometers at both arms' centres (5 m/s^2) or a camera
(positions of both centres, 75 µm). Young's modulus starts a factor 5 off, restitution at 0.6, the
clearance 20 % off. A table says how each search ended, and after how many runs with and without
derivatives, beside the Cramér-Rao bounds; figures of the fits go to `results/identification`.
``--quick`` fits the probes to 0.03 s.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import clearjoint as cj
from clearjoint import plot

RATE = 1e4
ARMS, BASES = ("arm 2", "arm 3"), ("V", "W")
ACROSS: tuple[cj.quantities.Component, ...] = ("x", "y")
ALL: tuple[cj.quantities.Component, ...] = ("x", "y", "z")
TRUTH = {"young": 207e9, "restitution": 0.9, "clearance": 0.5e-3}
PARAMETERS = {
    "young": cj.Parameter(lambda s: s.joints["shoulder"].law.stiffness.young_modulus, cj.Log()),
    "restitution": cj.Parameter(lambda s: s.joints["shoulder"].law.restitution, cj.Bounded(0, 1)),
    "clearance": cj.Parameter(lambda s: s.joints["shoulder"].clearance, cj.Log()),
}
SENSORS = {
    "probes": (
        {f"{b} {a}": cj.quantities.JournalOffset("shoulder", a, b) for b in BASES for a in ACROSS},
        5e-6,
    ),
    "accelerometers": (
        {f"{b} {a}": cj.quantities.Acceleration(b, a) for b in ARMS for a in ALL},
        5.0,
    ),
    "camera": ({f"{b} {a}": cj.quantities.Position(b, a) for b in ARMS for a in ALL}, 75e-6),
}
STARTS = {
    "stiff, wide": {"young": 5 * 207e9, "restitution": 0.6, "clearance": 0.6e-3},
    "soft, narrow": {"young": 207e9 / 5, "restitution": 0.6, "clearance": 0.4e-3},
}
WINDOWS = (0.012, 0.016, 0.02, 0.025, 0.03, 0.04, 0.05, 0.06, 0.07, 0.08, 0.09)
SUMMING = 2e-3
"""Error of the summed velocities, m/s, where a peak has few samples."""
SPREAD = {"young": 1.0, "restitution": 1.0, "clearance": 0.25}
BOX = {"young": 1.8, "restitution": 2.0, "clearance": 0.25}
"""Half widths of the box that is screened round a start: a little more than the starts are off."""


@dataclass(frozen=True)
class Attempt:
    """A fit, how many runs with derivatives it took in all its stages, how long, s, and how many
    runs without derivatives found its starts."""

    found: cj.Fit
    runs: int
    seconds: float
    screening: int = 0


def ideal(sensor: str, end_time: float) -> tuple[cj.Measurements, dict[str, float]]:
    """What a sensor would read without its noise, and the Cramér-Rao bounds of the coordinates by
    name."""
    channels, noise = SENSORS[sensor]
    times = np.arange(1, round(end_time * RATE) + 1) / RATE
    scene, state = cj.double_pendulum()
    tight = cj.Integration(rtol=1e-11)
    found = cj.sensitivities(scene, state, end_time, PARAMETERS, channels, times, integration=tight)
    clean = {name: cj.Series(c, times, found.values[name], noise) for name, c in channels.items()}
    jacobian = np.concatenate([found.derivatives[name] / noise for name in channels])
    deviations = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    return cj.Measurements(clean), dict(zip(PARAMETERS, deviations.tolist(), strict=True))


def velocities(data: cj.Measurements) -> cj.Measurements:
    """Accelerations from rest summed to velocities, of which the noise grows as the root of time.

    Peaks of the acceleration that do not overlap with those of the model have no slope that leads
    to them; steps of the velocity have.
    """
    series = {}
    for name, one in data.series.items():
        assert isinstance(one.channel, cj.quantities.Acceleration)
        channel = cj.quantities.Velocity(one.channel.body, one.channel.component)
        values = (np.cumsum(one.values) - 0.5 * one.values) / RATE
        noise = one.noise / RATE * np.sqrt(np.arange(1, len(one) + 1)) + SUMMING
        series[name] = cj.Series(channel, one.times, values, noise)
    return cj.Measurements(series)


def fit(data: cj.Measurements, guess: dict[str, float], how: str, end_time: float) -> Attempt:
    """Fit in a way: "at once", "windows", "windows, 12 starts", "velocities first", or
    "screened"."""
    scene, state = cj.double_pendulum()
    grow = [end for end in WINDOWS if end < end_time]
    starts: cj.Starts | cj.Screening | None = None
    if how.endswith("starts"):
        starts = cj.Starts(12, SPREAD)
    elif how == "screened":
        starts = cj.Screening(spread=BOX)
    begun = time.perf_counter()
    fits = []
    if how == "velocities first":
        summed = velocities(data)
        fits.append(
            cj.identify(scene, state, summed, PARAMETERS, guess=guess, grow=grow, progress=False)
        )
        guess = fits[0].estimates
    if how in ("at once", "velocities first", "screened"):
        grow = []
    fits.append(
        cj.identify(
            scene, state, data, PARAMETERS, guess=guess, grow=grow, starts=starts, progress=False
        )
    )
    runs = sum(search.evaluations for one in fits for search in one.searches)
    screening = sum(one.runs for one in fits[-1].screened)
    return Attempt(fits[-1], runs, time.perf_counter() - begun, screening)


def study(sensor: str, hows: Sequence[str], end_time: float, folder: Path) -> None:
    """Fit from all starts in all ways, print how it went, and draw the best."""
    clean, bounds = ideal(sensor, end_time)
    data = clean.with_noise(np.random.default_rng(1))
    errors = ", ".join(f"{name} {bound:.2g}" for name, bound in bounds.items())
    print(f"\n{sensor} to {end_time} s; Cramér-Rao bounds of the coordinates: {errors}")
    fit(data, TRUTH, "at once", end_time)  # compiles
    fits = []
    for label, guess in {"truth": TRUTH, **STARTS}.items():
        for how in hows:
            attempt = fit(data, guess, how, end_time)
            found = attempt.found
            fits.append(found)
            values = ", ".join(f"{name} {value:.5g}" for name, value in found.estimates.items())
            fit_of = found.chi_squared / found.samples
            runs = f"{attempt.runs:5d} + {attempt.screening:4d} runs"
            print(
                f"{label:14s}{how:20s}{found.ending.name:11s}chi2/N {fit_of:8.4f}  "
                f"{runs} {attempt.seconds:6.1f} s  {values}",
                flush=True,
            )
    best = min(fits, key=lambda found: found.chi_squared)
    print(f"\n{best}")
    plot.fitted(best)
    plt.savefig(folder / f"{sensor}.png", dpi=120)
    plot.correlations(best)
    plt.savefig(folder / f"{sensor}_correlation.png", dpi=120)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="the probes to 0.03 s")
    parser.add_argument("--output", type=Path, default=Path("results/identification"))
    parser.add_argument("--sensors", nargs="+", choices=SENSORS, default=list(SENSORS))
    options = parser.parse_args(arguments)
    options.output.mkdir(parents=True, exist_ok=True)
    matplotlib.use("Agg")
    if options.quick:
        study("probes", ("at once",), 0.03, options.output)
        return
    for sensor in options.sensors:
        hows = ["at once", "windows", "windows, 12 starts", "screened"]
        if sensor == "accelerometers":
            hows.append("velocities first")
        study(sensor, hows, 0.1, options.output)


if __name__ == "__main__":
    cj.configure()
    main()
