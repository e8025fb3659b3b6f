"""Variants of the default: stabilisation, entry speed, smoothing and precision."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from statistics import median
from types import MappingProxyType
from typing import Any

import jax.numpy as jnp
import numpy as np

import clearjoint as cj
from clearjoint.extend import AbstractStiffness, Gap, result_number, result_numbers
from studies.common.fresh_process import in_process
from studies.speed_accuracy.runs import (
    CLEARANCE,
    NUDGE,
    SAVED,
    Spans,
    centres,
    compared,
    cost,
    ledger_residual,
    run,
    truth,
)

STABILISATIONS: Mapping[str, cj.extend.AbstractStabilisation] = MappingProxyType(
    {
        "none": cj.Unstabilised(),
        "Baumgarte 5": cj.Baumgarte(5.0, 5.0),
        "Baumgarte 50": cj.Baumgarte(50.0, 50.0),
        "Baumgarte 500": cj.Baumgarte(500.0, 500.0),
        "projection": cj.Projection(),
    }
)
WIDTHS = (1e-10, 1e-9, 1e-8, 1e-7, 1e-6)
"""Widths of the smoothing, m."""
SINGLE_TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6)
SINGLE_LANDING = 1e-9
"""Landing tolerance in single precision, m, which resolves eccentricities to about 3e-11."""
SPEED = 0.1
"""Entry speed for which the fixed damping is set, m/s: that of the first impact."""


class MemorylessDamping(cj.extend.AbstractContactLaw):
    """Lankarani and Nikravesh's damping, fixed for one entry speed, m/s."""

    stiffness: AbstractStiffness
    restitution: Any
    entry_speed: Any
    uses_entry_speed = False
    force_jumps = False

    def force(self, gap: Gap, entry_speed: Any) -> Any:
        """Return the normal force, N."""
        del entry_speed
        factor = 1.0 + 0.75 * (1.0 - self.restitution**2) * gap.rate / self.entry_speed
        return self.elastic_force(gap) * jnp.maximum(factor, 0.0)

    def elastic_force(self, gap: Gap) -> Any:
        """Return the elastic force K delta^1.5, N."""
        return cj.laws.Hertz(stiffness=self.stiffness).elastic_force(gap)

    def stored_energy(self, gap: Gap) -> Any:
        """Return the elastic energy 2/5 K delta^2.5, J."""
        return cj.laws.Hertz(stiffness=self.stiffness).stored_energy(gap)


@dataclass(frozen=True)
class Row:
    """Measurements of a variant.

    Fields are those of `runs.Point`, the largest `peak` force in the short run, N, and in the long
    run the energy `dissipated`, J, and the `drift` of the hinge, m.
    """

    name: str
    error: float
    peak: float
    dissipated: float
    drift: float
    residual: float
    attempts: float
    seconds: float


Make = Callable[[float], tuple[cj.Scene, cj.State]]
"""Function that returns the double pendulum for a clearance, m."""


def measured(
    name: str, make: Make, settings: cj.Settings, spans: Spans, restitution: float = 0.9
) -> Row:
    """Measure a variant against the reference with a restitution."""
    goal = truth(spans.short, restitution)
    short = run(*make(CLEARANCE), goal.times, settings, impacts=True)
    assert short.impacts is not None
    peak = float(short.impacts.peak_force.max())
    times = np.linspace(0.0, spans.long, SAVED)
    draws = []
    for draw in range(spans.draws):
        scene, state = make(CLEARANCE * (1.0 + NUDGE * draw))
        kept = run(scene, state, times, replace(settings, ledger=True))
        observed = cj.observe(scene, kept)
        dissipated, drift = observed.energies["normal damping"][-1], observed.drift["elbow"].max()
        lost = ledger_residual(scene, kept)
        run(scene, state, times, settings)
        draws.append((dissipated, drift, lost, *cost(scene, state, times, settings)))
    medians = (float(median(column)) for column in zip(*draws, strict=True))
    return Row(name, goal.error(short), peak, *medians)


def with_law(law: cj.extend.AbstractContactLaw) -> Make:
    """Return a function that makes the double pendulum with a law."""
    return partial(cj.mechanisms.double_pendulum, law=law)


def stabilisations(spans: Spans) -> list[Row]:
    """Measure stabilisations in absolute coordinates, where the hinge is a constraint, and joint
    coordinates.
    """
    cases = {
        name: cj.Settings(coordinates=cj.AbsoluteCoordinates(), stabilisation=way)
        for name, way in STABILISATIONS.items()
    }
    cases["joint coordinates"] = cj.presets.default
    return [
        measured(name, cj.mechanisms.double_pendulum, each, spans) for name, each in cases.items()
    ]


def memories(spans: Spans) -> list[Row]:
    """Measure laws with and without dependence on the entry speed."""
    laws = {
        "Lankarani-Nikravesh, 1": (
            cj.laws.LankaraniNikravesh(restitution=1.0, stiffness=cj.mechanisms.STEEL),
            1.0,
        ),
        "Hertz": (cj.laws.Hertz(stiffness=cj.mechanisms.STEEL), 1.0),
        "Lankarani-Nikravesh, 0.9": (
            cj.laws.LankaraniNikravesh(restitution=0.9, stiffness=cj.mechanisms.STEEL),
            0.9,
        ),
        f"its damping at {SPEED:g} m/s": (
            MemorylessDamping(stiffness=cj.mechanisms.STEEL, restitution=0.9, entry_speed=SPEED),
            0.9,
        ),
    }
    return [
        measured(name, with_law(law), cj.presets.default, spans, restitution)
        for name, (law, restitution) in laws.items()
    ]


def smoothings(spans: Spans) -> dict[bool, list[Row]]:
    """Measure smoothing widths against the exact law, with and without landing."""
    found: dict[bool, list[Row]] = {}
    for lands in (True, False):
        usual = cj.presets.default
        settings = usual if lands else replace(usual, landing_tolerance=None)
        rows = [measured("exact", cj.mechanisms.double_pendulum, settings, spans)]
        for width in WIDTHS:
            law = cj.laws.LankaraniNikravesh(
                restitution=0.9, stiffness=cj.mechanisms.STEEL, smoothing=width
            )
            rows.append(measured(f"{width:g}", with_law(law), settings, spans))
        found[lands] = rows
    return found


IN_PRECISION = (
    "import sys; from studies.speed_accuracy.variants import in_this_precision;"
    " in_this_precision(*map(float, sys.argv[1:]))"
)


@dataclass(frozen=True)
class Rounded:
    """Result of a run in one of the precisions, with fields as those of `runs.Point`."""

    rtol: float
    error: float
    result: str
    residual: float
    attempts: float
    seconds: float


def precisions(spans: Spans) -> dict[str, list[Rounded]]:
    """Measure tolerances in 32 and in 64 bits, each in a separate process."""
    goal, found = truth(spans.short), {}
    for name, switch in (("float64", "1"), ("float32", "0")):
        variables = {"JAX_ENABLE_X64": switch, "XLA_FLAGS": cj.XLA_FLAGS}
        lengths = (str(spans.short), str(spans.long))
        _, rows = in_process(IN_PRECISION, *lengths, **variables)
        found[name] = [
            Rounded(rtol, _error(np.array(positions), goal.centres), *others)
            for rtol, positions, *others in rows
        ]
    return found


def _error(positions: np.ndarray, expected: np.ndarray) -> float:
    """Return the largest error of a position, m; NaN for a run that ended early."""
    if positions.shape != expected.shape:
        return float("nan")
    return float(np.abs(positions - expected).max())


def in_this_precision(short: float, long: float) -> None:
    """Print centres and costs by tolerance in JAX's present precision."""
    scene, state = cj.mechanisms.double_pendulum()
    rows = []
    for rtol in SINGLE_TOLERANCES:
        settings = cj.Settings(rtol=rtol, landing_tolerance=SINGLE_LANDING, allow_float32=True)
        solution = run(scene, state, compared(short), settings)
        times = np.linspace(0.0, long, SAVED)
        residual = ledger_residual(scene, run(scene, state, times, replace(settings, ledger=True)))
        run(scene, state, times, settings)
        costs = cost(scene, state, times, settings)
        rows.append((rtol, centres(solution).tolist(), name_of(solution), residual, *costs))
    print(json.dumps(rows))


def name_of(solution: cj.results.Solution) -> str:
    """Return the name of the result code."""
    number = int(result_number(solution.result))
    return next(name for name, code in result_numbers().items() if code == number)
