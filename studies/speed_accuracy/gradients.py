"""Derivatives by `sensitivities` with the presets."""

import time
from collections.abc import Callable
from statistics import median
from typing import Any

import numpy as np

import clearjoint as cj
from clearjoint.testing import optimise_programs
from studies.benchmark.derivatives import PARAMETERS, REFERENCE
from studies.common.output import Output
from studies.common.report import markdown
from studies.speed_accuracy.runs import Spans

REPEATS = 5
THREE = {name: PARAMETERS[name] for name in ("log c", "log K", "e")}


def gradients(output: Output, spans: Spans) -> list[str]:
    """Return the table of errors of the derivatives of arm 2's height, and of their cost."""
    del output
    expected = np.array(REFERENCE[spans.short])
    rows: list[tuple[str, ...]] = [
        ("setting", *(f"by {name}" for name in THREE), "attempts", "ms", "a run alone, ms")
    ]
    for name in ("preview", "accurate", "reference", "derivatives"):
        preset = getattr(cj.presets, name)
        seconds, found = _timed(lambda end, preset=preset: _derivatives(end, preset), spans.short)
        alone, _ = _timed(lambda end, preset=preset: _simulated(end, preset), spans.short)
        errors = np.abs(found.derivatives["height"][0] / expected - 1.0)
        cells = (*(f"{error:.0e}" for error in errors), f"{found.attempts}")
        rows.append((name, *cells, f"{1e3 * seconds:.0f}", f"{1e3 * alone:.0f}"))
    return [f"\nDerivatives at {spans.short:g} s by `sensitivities`\n\n{markdown(rows)}"]


def _derivatives(end: float, preset: cj.Settings) -> cj.results.Sensitivities:
    scene, state = cj.mechanisms.double_pendulum()
    height = {"height": cj.quantities.Position("arm 2", "y")}
    return cj.sensitivities(scene, state, end, THREE, height, [end], preset)


def _simulated(end: float, preset: cj.Settings) -> cj.results.Solution:
    return cj.simulate(*cj.mechanisms.double_pendulum(), end, preset, progress=False)


def _timed(call: Callable[[float], Any], end: float) -> tuple[float, Any]:
    """Return the median time of several calls after one that compiles, s, and the result."""
    found, times = call(end), []
    optimise_programs()
    for _ in range(REPEATS):
        begun = time.perf_counter()
        found = call(end)
        times.append(time.perf_counter() - begun)
    return median(times), found
