"""Absolute and joint coordinates side by side: what they cost, and how well ideal joints hold.

    python -m studies.coordinates [--quick]

Operations are those of floating point in a compiled right-hand side alone, by XLA's own count, in
which parts that were fused twice count twice. The time is that of a whole call of `simulate` at
rtol 1e-9, the least of three after one that compiles. The drift is the largest residual of a
row of the ideal joints (m or rad, and its rate), over the run, at the instants saved. Both default
to Baumgarte's stabilisation, which joint coordinates need for drivers and closed loops alone.

Measured on 2026-11-21, shared machine of four cores, under load:

| mechanism | coordinates | simulated, s | operations | attempts | ms | µs an attempt | drift |
|---|---|---|---|---|---|---|---|
| double pendulum, 0.5 mm | absolute | 1 | 933 | 34 461 | 149 | 4.3 | 2e-14 |
| | joint | | 478 | 31 415 | 76 | 2.4 | 3e-16 |
| slider-crank, 0.5 mm | absolute | 0.24 | 12 026 | 82 615 | 22 150 | 268 | 5e-10 |
| | joint | | 471 | 84 259 | 353 | 4.2 | 5e-12 |
| double pendulum, ideal | absolute | 100 | 1 493 | 15 490 | 84 | 5.4 | 1e-10 |
| | joint | | 86 | 8 838 | 17 | 1.9 | 3e-16 |
| double four-bar | absolute | 10 | 97 914 | 6 393 | 4 316 | 675 | 3e-04 |
| | joint | | 706 | 539 | 28 | 53 | 3e-11 |
| Bricard | absolute | 10 | 70 539 | 3 269 | 2 081 | 636 | 6e-14 |
| | joint | | 1 950 | 1 191 | 36 | 30 | 3e-11 |

A call takes some milliseconds beside its steps, which is most of the time of the last two in joint
coordinates.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import clearjoint as cj
from clearjoint.dynamics import state_rates
from clearjoint.mechanisms import bricard, double_four_bar
from clearjoint.vectors import structured, unpack

RTOL, REPEATS, SAVED = 1e-9, 3, 101
REVOLUTION = 60.0 / 5000.0
"""Of the slider-crank at its default speed, s."""


@dataclass(frozen=True)
class Mechanism:
    """A scene with its initial state, to be run for a span in s."""

    name: str
    make: Callable[[], tuple[cj.Scene, cj.State]]
    span: float


MECHANISMS = (
    Mechanism("double pendulum, 0.5 mm", cj.double_pendulum, 1.0),
    Mechanism("slider-crank, 0.5 mm", cj.slider_crank, 20.0 * REVOLUTION),
    Mechanism("double pendulum, ideal", lambda: cj.double_pendulum(None), 100.0),
    Mechanism("double four-bar", double_four_bar, 10.0),
    Mechanism("Bricard", bricard, 10.0),
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

    def run() -> tuple[float, cj.Solution]:
        start = time.perf_counter()
        solution = cj.simulate(
            scene,
            state,
            mechanism.span,
            save_at=times,
            rtol=RTOL,
            coordinates=COORDINATES[coordinates],
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
        f"{operations(scene, solution):.0f}",
        f"{int(solution.attempts)}",
        f"{1e3 * seconds:.4g}",
        f"{1e6 * seconds / int(solution.attempts):.3g}",
        *(f"{drift:.0e}" for drift in drifts),
    )


def operations(scene: cj.Scene, solution: cj.Solution) -> float:
    """Floating-point operations of a right-hand side at the end of a run."""
    formulation = solution.formulation
    form = structured(scene)
    start = unpack(solution.final.bodies)
    variables = formulation.coordinates.encode(unpack(form), start)
    variables = jax.tree.map(lambda value: jnp.asarray(value, dtype=float), variables)

    def rates(scene: Any, variables: Any, memory: Any, t: Any) -> Any:
        found, _ = state_rates(unpack(scene), formulation, variables, memory, t)
        return found

    compiled = (
        eqx.filter_jit(rates)
        .lower(form, variables, solution.final.memory, jnp.asarray(0.0))
        .compile()
    )
    return compiled.compiled.cost_analysis()["flops"]


def table(mechanisms: tuple[Mechanism, ...]) -> str:
    """Every mechanism in both coordinates, in Markdown."""
    rows = [COLUMNS, ("---",) * len(COLUMNS)]
    rows += [measured(mechanism, name) for mechanism in mechanisms for name in COORDINATES]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def main(arguments: list[str] | None = None) -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="the ideal double pendulum alone")
    quick = parser.parse_args(arguments).quick
    cj.configure()
    ideal = next(one for one in MECHANISMS if one.name == "double pendulum, ideal")
    print(table((ideal,) if quick else MECHANISMS))


if __name__ == "__main__":
    main()
