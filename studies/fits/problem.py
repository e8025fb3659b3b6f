"""Estimation problem of the double pendulum: sensors, starts and searches."""

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
"""Additional noise of the summed velocities, m/s: a peak has few samples."""
SPREAD = {"young": 1.0, "restitution": 1.0, "clearance": 0.25}
BOX = {"young": 1.8, "restitution": 2.0, "clearance": 0.25}
"""Half widths of the screened box in coordinates: slightly more than the errors of the starts."""
ASTRAY = 5.0
"""Error in Cramér-Rao bounds that noise does not explain."""


@dataclass(frozen=True)
class Attempt:
    """A fit and its cost.

    `runs`: runs with derivatives in all stages; `screening`: runs without derivatives that chose
    the starts; `seconds`: time taken, s.
    """

    found: cj.results.Fit
    runs: int
    seconds: float
    screening: int = 0


def ideal(sensor: str, end_time: float) -> tuple[cj.Measurements, dict[str, float]]:
    """Return a sensor's readings without noise, and the Cramér-Rao bounds of the coordinates."""
    channels, noise = SENSORS[sensor]
    times = np.arange(1, round(end_time * RATE) + 1) / RATE
    scene, state = cj.mechanisms.double_pendulum()
    tight = replace(cj.presets.derivatives, rtol=1e-11)
    found = cj.sensitivities(scene, state, end_time, PARAMETERS, channels, times, settings=tight)
    clean = {name: cj.Series(c, times, found.outputs[name], noise) for name, c in channels.items()}
    jacobian = np.concatenate([found.derivatives[name] / noise for name in channels])
    deviations = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    return cj.Measurements(clean), dict(zip(PARAMETERS, deviations.tolist(), strict=True))


def velocities(data: cj.Measurements) -> cj.Measurements:
    """Sum accelerations from rest to velocities, whose noise grows with the root of time.

    A peak of the acceleration that does not overlap with the model's peak leaves chi squared flat;
    a step of the velocity does not.
    """
    summed = {}
    for name, series in data.series.items():
        assert isinstance(series.channel, cj.quantities.Acceleration)
        channel = cj.quantities.Velocity(series.channel.body, series.channel.component)
        values = (np.cumsum(series.values) - 0.5 * series.values) / RATE
        noise = series.noise / RATE * np.sqrt(np.arange(1, len(series) + 1)) + SUMMING
        summed[name] = cj.Series(channel, series.times, values, noise)
    return cj.Measurements(summed)


def fit(data: cj.Measurements, guess: dict[str, float], way: str, end_time: float) -> Attempt:
    """Fit by a search of `studies.fits.searches.ways`.

    The covariance is not checked by runs, so that the time is that of the search.
    """
    windows = [end for end in WINDOWS if end < end_time]
    fits: list[cj.results.Fit] = []

    def identify(
        data: cj.Measurements, grow: list[float], starts: cj.Starts | cj.Screening | None = None
    ) -> None:
        start = fits[-1].estimates if fits else guess
        scene, state = cj.mechanisms.double_pendulum()
        fits.append(
            cj.identify(
                scene, state, data, PARAMETERS, guess=start, grow=grow, starts=starts,
                check_runs=0, progress=False,
            )
        )  # fmt: skip

    begun = time.perf_counter()
    if way == "screened":
        identify(data, [], cj.Screening(spread=BOX))
    elif way == "velocities first":
        identify(velocities(data), windows)
        identify(data, [])
    else:
        starts = cj.Starts(12, SPREAD) if way.endswith("12 starts") else None
        identify(data, windows if way.startswith("windows") else [], starts)
    seconds = time.perf_counter() - begun
    runs = sum(search.evaluations for one in fits for search in one.searches)
    return Attempt(fits[-1], runs, seconds, sum(one.runs for one in fits[-1].screened))


def coordinates(values: dict[str, float]) -> np.ndarray:
    """Return the coordinates (p,) of values of the parameters."""
    return np.array([PARAMETERS[name].scale.coordinate(value) for name, value in values.items()])
