"""Cost and drift of mechanisms in absolute and in joint coordinates."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

import clearjoint as cj

RTOL, REPEATS, SAVED = 1e-9, 3, 101
COORDINATES = {"absolute": cj.AbsoluteCoordinates(), "joint": cj.JointCoordinates()}


@dataclass(frozen=True)
class Mechanism:
    """A scene with its initial state, and the time to simulate, s."""

    name: str
    make: Callable[[], tuple[cj.Scene, cj.State]]
    span: float


IDEAL = Mechanism("double pendulum, ideal", lambda: cj.mechanisms.double_pendulum(None), 100.0)
MECHANISMS = (
    Mechanism("double pendulum, 0.5 mm", cj.mechanisms.double_pendulum, 1.0),
    IDEAL,
    Mechanism("double four-bar", cj.mechanisms.double_four_bar, 10.0),
    Mechanism("Bricard", cj.mechanisms.bricard, 10.0),
)


@dataclass(frozen=True)
class Row:
    """A mechanism in one kind of coordinates.

    - `seconds`: least time of several calls of `simulate` after one that compiles, s.
    - `drift`, `drift_rate`: largest residual of an ideal joint at the saved times, m or rad, and
      its rate, m/s or rad/s.
    """

    mechanism: Mechanism
    coordinates: str
    attempts: int
    seconds: float
    drift: float
    drift_rate: float


def measure(mechanisms: Sequence[Mechanism]) -> list[Row]:
    """Measure each mechanism in both kinds of coordinates."""
    return [_measure(mechanism, name) for mechanism in mechanisms for name in COORDINATES]


def _measure(mechanism: Mechanism, coordinates: str) -> Row:
    scene, state = mechanism.make()
    settings = cj.Settings(rtol=RTOL, coordinates=COORDINATES[coordinates])
    save = cj.Saving(np.linspace(0.0, mechanism.span, SAVED))

    def run() -> tuple[float, cj.results.Solution]:
        begun = time.perf_counter()
        solution = cj.simulate(scene, state, mechanism.span, settings, save=save, progress=False)
        return time.perf_counter() - begun, solution

    _, solution = run()
    seconds = min(run()[0] for _ in range(REPEATS))
    observed = cj.observe(scene, solution)
    drift, drift_rate = (
        max(float(np.max(residuals)) for residuals in family.values())
        for family in (observed.drift, observed.drift_rate)
    )
    return Row(mechanism, coordinates, int(solution.attempts), seconds, drift, drift_rate)


def table(rows: Sequence[Row]) -> list[tuple[str, ...]]:
    """Return the table as text."""
    head = (
        "mechanism", "coordinates", "simulated, s", "attempts", "time, ms", "µs an attempt",
        "drift", "drift rate, 1/s",
    )  # fmt: skip
    cells = [
        (
            row.mechanism.name, row.coordinates, f"{row.mechanism.span:g}", f"{row.attempts}",
            f"{1e3 * row.seconds:.3g}", f"{1e6 * row.seconds / row.attempts:.3g}",
            f"{row.drift:.0e}", f"{row.drift_rate:.0e}",
        )
        for row in rows
    ]  # fmt: skip
    return [head, *cells]
