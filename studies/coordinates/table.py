"""A mechanism in absolute and in joint coordinates, measured."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import numpy as np

import clearjoint as cj
from clearjoint.testing import RunProgram

RTOL, REPEATS, SAVED = 1e-9, 3, 101
REVOLUTION = 60.0 / 5000.0
"""Of the slider-crank at its default speed, s."""


@dataclass(frozen=True)
class Mechanism:
    """A scene with its initial state, to be run for a span in s."""

    name: str
    make: Callable[[], tuple[cj.Scene, cj.State]]
    span: float


IDEAL = Mechanism("double pendulum, ideal", lambda: cj.mechanisms.double_pendulum(None), 100.0)
MECHANISMS = (
    Mechanism("double pendulum, 0.5 mm", cj.mechanisms.double_pendulum, 1.0),
    Mechanism("slider-crank, 0.5 mm", cj.mechanisms.slider_crank, 20.0 * REVOLUTION),
    IDEAL,
    Mechanism("double four-bar", cj.mechanisms.double_four_bar, 10.0),
    Mechanism("Bricard", cj.mechanisms.bricard, 10.0),
)
COORDINATES = {"absolute": cj.AbsoluteCoordinates(), "joint": cj.JointCoordinates()}
COLUMNS = (
    "mechanism", "coordinates", "simulated, s", "operations", "attempts", "time, ms",
    "µs an attempt", "drift", "drift rate, 1/s",
)  # fmt: skip


def measured(mechanism: Mechanism, coordinates: str) -> tuple[str, ...]:
    """A row of the table."""
    scene, state = mechanism.make()
    times = np.linspace(0.0, mechanism.span, SAVED)

    def run() -> tuple[float, cj.results.Solution]:
        start = time.perf_counter()
        solution = cj.simulate(
            scene,
            state,
            mechanism.span,
            cj.Settings(rtol=RTOL, coordinates=COORDINATES[coordinates]),
            save=cj.Saving(times),
            progress=False,
        )
        return time.perf_counter() - start, solution

    _, solution = run()
    seconds = min(run()[0] for _ in range(REPEATS))
    observed = cj.observe(scene, solution)
    drifts = [
        max(float(np.max(residuals)) for residuals in family.values())
        for family in (observed.drift, observed.drift_rate)
    ]
    return (
        mechanism.name,
        coordinates,
        f"{mechanism.span:g}",
        f"{operations(scene, state, coordinates):.0f}",
        f"{int(solution.attempts)}",
        f"{1e3 * seconds:.4g}",
        f"{1e6 * seconds / int(solution.attempts):.3g}",
        *(f"{drift:.0e}" for drift in drifts),
    )


def operations(scene: cj.Scene, state: cj.State, coordinates: str) -> float:
    """Floating-point operations of a right-hand side."""
    program = RunProgram.of(scene, state, cj.Settings(coordinates=COORDINATES[coordinates]))

    def rates(program: RunProgram) -> Any:
        return program.stepper().rates(program.step)

    compiled = eqx.filter_jit(rates).lower(program).compile()
    return compiled.compiled.cost_analysis()["flops"]


def table(mechanisms: tuple[Mechanism, ...]) -> str:
    """Every mechanism in both coordinates, in Markdown."""
    rows = [COLUMNS, ("---",) * len(COLUMNS)]
    rows += [measured(mechanism, name) for mechanism in mechanisms for name in COORDINATES]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)
