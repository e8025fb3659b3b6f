"""How cost grows: with the lanes of a sweep, and with the joints of a chain."""

import argparse

from studies.benchmark.sweep import OWN, clearances
from studies.benchmark.workers import Worker
from studies.common.report import Record, report

LANES, SPAN = (64, 256, 1024, 4096), 0.5
"""Lanes, and simulated time of each, s."""
RODS = (1, 2, 4, 8, 16)
WARM = 256
"""Lanes of the sweep before, at most."""
QUICK_LANES, QUICK_SPAN, QUICK_RODS = (16,), 0.01, (1,)


def scaling(options: argparse.Namespace) -> None:
    """Measure sweeps of more and more lanes, and chains of more and more joints, on one core."""
    counts, span, rods = (
        (QUICK_LANES, QUICK_SPAN, QUICK_RODS) if options.quick else (LANES, SPAN, RODS)
    )
    lanes = [lane_cost(count, span) for count in counts]
    report(None, _rows(lanes), [])
    chains = [_in_worker("studies.benchmark.chain:chain_cost", rods=number) for number in rods]
    print("\nA chain of rods, each hung on the last by a joint with clearance, single runs:\n")
    report(options.json, _rows(chains), [*lanes, *chains])


def lane_cost(lanes: int, span: float) -> Record:
    """Cost of a sweep of some lanes in a fresh process, after one that compiles."""
    arguments = {"duration": span, "devices": 1}
    with Worker(1) as worker:
        before = worker.ask(OWN + "swept", clearances=clearances(min(lanes, WARM)), **arguments)
        found = worker.ask(OWN + "swept", clearances=clearances(lanes), **arguments)
    return {
        "lanes": lanes,
        "s": found["seconds"],
        "ms a lane": 1e3 * found["seconds"] / lanes,
        "µs a lane-step": 1e6 * found["seconds"] / found["steps"],
        "waste": found["turns"] / found["steps"],
        "peak memory, MB": found["peak_memory_MB"],
        "before, MB": before["peak_memory_MB"],
    }


def _in_worker(function: str, **arguments: object) -> Record:
    with Worker(1) as worker:
        return worker.ask(function, **arguments)


def _rows(records: list[Record]) -> list[tuple[str, ...]]:
    head = tuple(records[0])
    return [head, *(tuple(f"{value:.4g}" for value in one.values()) for one in records)]
