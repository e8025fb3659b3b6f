"""A sweep over clearances: clearjoint on one core and on more, and the same in other ways."""

import argparse
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib.util import find_spec
from statistics import median
from typing import Any

import numpy as np

from studies.benchmark.pendulum import EXUDYN_STEPS, RTOLS
from studies.benchmark.workers import Worker
from studies.common.report import Record, markdown, report

LEAST, MOST, LANES, SPAN = 5e-5, 1e-3, 256, 0.5
"""Radial clearances, m, log-spaced; their number; and simulated time, s."""
QUICK_LANES, QUICK_SPAN = 8, 0.02
SAMPLES = {"Exudyn": 32, "SciPy": 8}
"""Lanes that the slower programs run of all."""
OWN = "studies.benchmark.sweep_programs:"
OTHERS = "studies.common.baselines.variations:"


@dataclass
class Program:
    """A program on some cores: what to ask of a worker, and the records that it gave."""

    name: str
    cores: int
    function: str
    arguments: dict[str, Any]
    first_call: float = float("nan")
    found: list[Record] = field(default_factory=list)

    def run(self, worker: Worker) -> Record:
        """One measurement."""
        return worker.ask(self.function, **self.arguments)

    def lane_time(self) -> float:
        """Median time of a lane, s."""
        return median(record["seconds"] / record["lanes"] for record in self.found)


def clearances(lanes: int) -> list[float]:
    """Log-spaced radial clearances, m."""
    return np.geomspace(LEAST, MOST, lanes).tolist()


def sample(values: Sequence[float], count: int) -> list[float]:
    """About as many values, evenly spread."""
    stride = max(1, len(values) // count)
    return list(values[stride // 2 :: stride])


def programs(lanes: int, span: float, devices: int, coordinates: Sequence[str]) -> list[Program]:
    """clearjoint's sweep on one core and on all; a loop over single runs; other programs."""
    values = clearances(lanes)
    found = [
        Program(
            f"sweep, {kind} coordinates",
            cores,
            OWN + "swept",
            {"clearances": values, "duration": span, "devices": cores, "coordinates": kind},
        )
        for kind in coordinates
        for cores in sorted({1, devices})
    ]
    found.append(
        Program("loop over simulate", 1, OWN + "looped", {"clearances": values, "duration": span})
    )
    settings = {"Exudyn": ("exudyn_lanes", "step", EXUDYN_STEPS[0])}
    settings["SciPy"] = ("scipy_lanes", "rtol", RTOLS[0])
    for name, (function, setting, value) in settings.items():
        if name == "Exudyn" and find_spec("exudyn") is None:
            print("Exudyn is not installed (pip install 'exudyn>=1.13'): its row is left out.")
            continue
        chosen = sample(values, min(SAMPLES[name], max(lanes // 8, 2)))
        arguments = {"clearances": chosen, "duration": span, "cores": devices, setting: value}
        title = f"{name}, {setting} {value:g}"
        found.append(Program(title, devices, OTHERS + function, arguments))
    return found


def measure(found: Sequence[Program], repeats: int) -> None:
    """Run the programs in turn, each in a process of its own, after a first call that compiles."""
    with ExitStack() as stack:
        workers = [stack.enter_context(Worker(program.cores)) for program in found]
        for program, worker in zip(found, workers, strict=True):
            if program.function.startswith(OWN):
                program.first_call = program.run(worker)["seconds"]
        for _ in range(repeats):
            for program, worker in zip(found, workers, strict=True):
                program.found.append(program.run(worker))


COLUMNS: tuple[str, ...] = (
    "program", "cores", "lanes run", "s (least)", "lane-steps", "right-hand sides",
    "µs a lane-step and core", "waste", "ms a lane", "times a sweep on as many cores",
    "first call, s",
)  # fmt: skip


def sweep_rows(found: Sequence[Program]) -> list[tuple[str, ...]]:
    """The table: medians over the rounds."""
    yardsticks = {p.cores: p.lane_time() for p in found if p.name.startswith("sweep, joint")}
    rows = [COLUMNS]
    for program in found:
        record, seconds = program.found[0], [record["seconds"] for record in program.found]
        turns = record.get("turns")
        rows.append((
            program.name,
            str(program.cores),
            str(record["lanes"]),
            f"{median(seconds):.4g} ({min(seconds):.4g})",
            str(record["steps"]),
            str(record["right_hand_sides"]),
            f"{1e6 * median(seconds) * program.cores / record['steps']:.3f}",
            "–" if turns is None else f"{turns / record['steps']:.3f}",
            f"{1e3 * program.lane_time():.3g}",
            f"{program.lane_time() / yardsticks[program.cores]:.3g}",
            f"{program.first_call:.3g}",
        ))  # fmt: skip
    return rows


def sweep(options: argparse.Namespace) -> None:
    """Measure 256 clearances, 0.5 s each, on one core and on several, beside other programs."""
    lanes, span = (QUICK_LANES, QUICK_SPAN) if options.quick else (LANES, SPAN)
    coordinates = ("joint",) if options.quick else ("joint", "absolute")
    found = programs(lanes, span, options.devices, coordinates)
    measure(found, options.repeats)
    counts = []
    with Worker(1) as worker:
        for kind in coordinates:
            arguments = {"clearances": clearances(lanes), "coordinates": kind}
            counts.append({"coordinates": kind, **worker.ask(OWN + "counted", **arguments)})
    report(options.json, sweep_rows(found), [*map(_record, found), *counts])
    for one, *others in _sides(found):
        ratio = median(
            a["seconds"] / b["seconds"] for a, b in zip(one.found, others[0].found, strict=True)
        )
        print(f"\n{one.name}: {ratio:.2f} times as fast on {others[0].cores} cores as on one.")
    print("\nArithmetic of a turn, which tries one step, as traced:\n")
    cells = [[f"{v:.3g}" if isinstance(v, float) else str(v) for v in c.values()] for c in counts]
    print(markdown([list(counts[0]), *cells]))


def _sides(found: Sequence[Program]) -> list[list[Program]]:
    """Sweeps on one core, each with the same on more."""
    names = dict.fromkeys(program.name for program in found)
    groups = [[program for program in found if program.name == name] for name in names]
    return [group for group in groups if len(group) > 1]


def _record(program: Program) -> Record:
    return {
        "program": program.name,
        "cores": program.cores,
        "first_call_s": program.first_call,
        "runs": program.found,
    }
