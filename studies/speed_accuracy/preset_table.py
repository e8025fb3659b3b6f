"""Errors of onsets and forces with the presets, and their cost: the table of README.md."""

import csv
from tempfile import TemporaryDirectory

import diffrax
import numpy as np

import clearjoint as cj
from clearjoint.testing import optimise_programs
from studies.common.forces import largest_at_a_base
from studies.common.fresh_process import in_process
from studies.common.output import Output
from studies.common.report import markdown
from studies.speed_accuracy.runs import (
    CLEARANCE,
    REFERENCE,
    SAVED,
    Spans,
    medians,
    run,
    truth,
)

CRUDE = cj.Settings(solver=diffrax.Bosh3(), rtol=1e-3)


def named() -> dict[str, cj.Settings]:
    """Return the presets by name, and a coarser setting."""
    names = ("default", "preview", "accurate", "reference")
    return {"Bosh3, rtol 1e-3": CRUDE, **{name: getattr(cj.presets, name) for name in names}}


def presets(output: Output, spans: Spans) -> list[str]:
    """Return the table of errors to the horizon and costs of the long run."""
    del output
    rows: list[tuple[str, ...]] = [
        ("setting", "position, m", "onset, s", "peak force", "largest, by `Peak`", "ledger",
         "attempts", "ms", "first call, s")
    ]  # fmt: skip
    expected = onsets_and_peaks(spans.short)
    for name, settings in named().items():
        goal = truth(spans.short)
        short = run(*cj.mechanisms.double_pendulum(), goal.times, settings, impacts=True)
        found = _table(short)
        onset, peak = np.abs(found - expected).max(axis=0) / (1.0, expected[:, 1].max())
        sweep_peak = abs(largest(spans.short, settings) / expected[:, 1].max() - 1.0)
        _warmed(spans.long, settings)
        attempts, seconds, residual = medians(settings, spans)
        costs = (f"{attempts:.0f}", f"{1e3 * seconds:.0f}", f"{first_call(name):.1f}")
        errors = (f"{x:.0e}" for x in (goal.error(short), onset, peak, sweep_peak, residual))
        rows.append((name, *errors, *costs))
    return [f"\nPresets, {spans.short:g} s and {spans.long:g} s\n\n{markdown(rows)}"]


def onsets_and_peaks(end: float) -> np.ndarray:
    """Return onsets, s, and peak forces, N, of the contacts that end in time, (N, 2)."""
    file = REFERENCE / "double_pendulum_c0.0005_e0.9_impacts.csv"
    with open(file) as lines:
        rows = [row for row in csv.DictReader(lines) if float(row["t_off"]) < end]
    return _sorted([(row["base"], float(row["t_on"]), float(row["F_peak"])) for row in rows])


def _table(solution: cj.results.Solution) -> np.ndarray:
    impacts = solution.impacts
    assert impacts is not None
    return _sorted([
        (base, onset, peak)
        for base in "VW"
        for onset, peak in zip(
            impacts.of("shoulder", base).onset,
            impacts.of("shoulder", base).peak_force,
            strict=True,
        )
    ])  # fmt: skip


def _sorted(rows: list[tuple[str, float, float]]) -> np.ndarray:
    """Return the rows sorted by base and time."""
    return np.array([row[1:] for row in sorted(rows)])


def largest(end: float, settings: cj.Settings) -> float:
    """Return the largest force at a base in accepted steps, as a sweep finds it, N."""
    scene, state = cj.mechanisms.double_pendulum()
    axis = cj.Axis(lambda s: s.joints["shoulder"].clearance, [CLEARANCE])
    force = cj.Peak(largest_at_a_base("shoulder"), "N")
    found = cj.sweep(
        scene, state, end, {"clearance": axis}, {"peak": force}, settings, progress=False
    )
    return float(found["peak"].values[0])


def _warmed(end: float, settings: cj.Settings) -> None:
    run(*cj.mechanisms.double_pendulum(), np.linspace(0.0, end, SAVED), settings)
    optimise_programs()


FIRST_CALL = """
import json, sys, time
import clearjoint as cj
cj.configure(cache=sys.argv[2])
from studies.speed_accuracy.preset_table import named
settings, begun = named()[sys.argv[1]], time.perf_counter()
cj.simulate(*cj.mechanisms.double_pendulum(), 2.0, settings, progress=False)
print(json.dumps(time.perf_counter() - begun))
"""


def first_call(name: str) -> float:
    """Return the time of a first call of `simulate` without a cache, s."""
    with TemporaryDirectory() as folder:
        return in_process(FIRST_CALL, name, folder)[1]
