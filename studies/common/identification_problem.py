"""Parameters of the double pendulum from made-up measurements: sensors, starts, and ways to fit."""

import time
from dataclasses import dataclass, replace

import numpy as np

import clearjoint as cj

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

ASTRAY = 5.0
"""Error, in Cramér-Rao bounds, beyond which noise does not explain where a fit ended."""


@dataclass(frozen=True)
class Attempt:
    """A fit, how many runs with derivatives it took in all its stages, how long, s, and how many
    runs without derivatives found its starts."""

    found: cj.results.Fit
    runs: int
    seconds: float
    screening: int = 0


def ideal(sensor: str, end_time: float) -> tuple[cj.Measurements, dict[str, float]]:
    """What a sensor would read without its noise, and the Cramér-Rao bounds of the coordinates by
    name."""
    channels, noise = SENSORS[sensor]
    times = np.arange(1, round(end_time * RATE) + 1) / RATE
    scene, state = cj.mechanisms.double_pendulum()
    tight = replace(cj.presets.derivatives, rtol=1e-11)
    found = cj.sensitivities(scene, state, end_time, PARAMETERS, channels, times, settings=tight)
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
    """Fit in a way: "at once", "windows", "windows, 12 starts", "velocities first", or "screened";
    without the test of the covariance, so that searches alone are timed."""
    scene, state = cj.mechanisms.double_pendulum()
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
            cj.identify(
                scene,
                state,
                summed,
                PARAMETERS,
                guess=guess,
                grow=grow,
                check_runs=0,
                progress=False,
            )
        )
        guess = fits[0].estimates
    if how in ("at once", "velocities first", "screened"):
        grow = []
    fits.append(
        cj.identify(
            scene,
            state,
            data,
            PARAMETERS,
            guess=guess,
            grow=grow,
            starts=starts,
            check_runs=0,
            progress=False,
        )
    )
    runs = sum(search.evaluations for one in fits for search in one.searches)
    screening = sum(one.runs for one in fits[-1].screened)
    return Attempt(fits[-1], runs, time.perf_counter() - begun, screening)


def coordinates(values: dict[str, float]) -> np.ndarray:
    """Coordinates (p,) of the parameters' values."""
    return np.array([PARAMETERS[name].scale.coordinate(value) for name, value in values.items()])
