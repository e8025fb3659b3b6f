"""Statistics of long runs by setting, in sweeps over clearances that differ by rounding."""

import time
from dataclasses import replace
from typing import Any

import numpy as np

import clearjoint as cj
from clearjoint.testing import optimise_programs
from studies.common.forces import largest_at_a_base
from studies.common.output import Output
from studies.common.report import markdown
from studies.speed_accuracy.preset_table import named
from studies.speed_accuracy.runs import CLEARANCE, NUDGE, Spans

LANES = 256
NAMES = ("impacts", "peak", "dissipated")


def statistics(output: Output, spans: Spans) -> list[str]:
    """Return the table of means with standard errors over the lanes."""
    del output
    rows: list[tuple[str, ...]] = [
        ("setting", "impacts", "largest force, kN", "dissipated, J", "ms a lane")
    ]
    cases = {**named(), "default, not landing": replace(cj.presets.default, landing_tolerance=None)}
    for name, settings in cases.items():
        _lanes(spans.long, settings, LANES)
        optimise_programs()
        begun = time.process_time()
        found = _lanes(spans.long, settings, LANES)
        seconds = time.process_time() - begun
        cells = (_mean(found[key].values * (1e-3 if key == "peak" else 1.0)) for key in NAMES)
        rows.append((name, *cells, f"{1e3 * seconds / LANES:.1f}"))
    return [f"\nStatistics of {spans.long:g} s, {LANES} lanes\n\n{markdown(rows)}"]


def _lanes(end: float, settings: cj.Settings, lanes: int) -> Any:
    scene, state = cj.mechanisms.double_pendulum()
    clearances = CLEARANCE * (1.0 + NUDGE * np.linspace(-1.0, 1.0, lanes))
    return cj.sweep(
        scene,
        state,
        end,
        {"clearance": cj.Axis(_clearance, clearances)},
        {
            "impacts": cj.ImpactCount("shoulder"),
            "peak": cj.Peak(largest_at_a_base("shoulder"), "N"),
            "dissipated": cj.DissipatedEnergy(),
        },
        replace(settings, ledger=True),
        threads=1,
        progress=False,
    )


def _mean(values: np.ndarray) -> str:
    return f"{values.mean():.4g} ± {values.std(ddof=1) / np.sqrt(values.size):.2g}"


def _clearance(scene: Any) -> Any:
    return scene.joints["shoulder"].clearance
