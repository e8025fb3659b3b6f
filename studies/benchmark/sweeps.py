"""Sweeps over the pendulum's clearance compared with C++, and on two threads with one."""

from collections.abc import Callable
from functools import partial

import numpy as np

import clearjoint as cj
from studies.benchmark.table import (
    Plan,
    Row,
    Sample,
    cores,
    interleaved,
    on_cores,
    processor_time,
    row,
    seconds,
    step_times,
    wall_time,
)
from studies.benchmark.yardstick import EIGHT, RESTITUTION, SCALAR

LEAST, MOST = 5e-5, 1e-3
"""Range of the radial clearances, m."""
SWEEPS, QUICK_SWEEPS = ((256, 0.5), (1024, 0.2)), ((16, 0.02), (32, 0.012))
"""Numbers of lanes, and simulated time of each, s."""
RTOL = 1e-6
THREADS = 2


def rows(plan: Plan) -> list[Row]:
    """Measure sweeps on one thread relative to C++, also with a peak, and on two threads relative
    to one.
    """
    few, many = QUICK_SWEEPS if plan.quick else SWEEPS
    found = []
    for (lanes, span), peak in ((few, False), (few, True), (many, False)):
        name = f"{lanes} lanes of {span:g} s" + (" with a peak of a force" if peak else "")
        calls: dict[str, Callable[[int], Sample]] = {
            "": lambda k, case=(lanes, span, peak): processor_time(partial(swept, *case, 1))
        }
        if plan.yardstick is not None:
            for kind in (SCALAR, EIGHT):
                calls[kind] = partial(_yardstick, plan, kind, lanes, span)
        with on_cores(1):
            samples = interleaved(calls, plan.rounds)
        here = seconds(samples.pop(""))
        for kind, aim in ((SCALAR, 0.45), (EIGHT, 1.2)):
            there = seconds(samples[kind]) if kind in samples else None
            found.append(row(f"{name}, one thread", here, there, kind, aim))
        found += _on_threads(plan, name, lanes, span, peak)
    with on_cores(1):
        calls = {
            str(lanes): lambda k, case=(lanes, span): processor_time(
                partial(swept, *case, False, 1)
            )
            for lanes, span in (few, many)
        }
        steps = interleaved(calls, plan.rounds)
    here, there = (step_times(steps[str(lanes)]) for lanes, _ in (many, few))
    label = f"an attempted step of a lane, {many[0]} lanes"
    return [*found, row(label, here, there, f"{few[0]} lanes", 1.1)]


def _on_threads(plan: Plan, name: str, lanes: int, span: float, peak: bool) -> list[Row]:
    """Measure the sweep on two threads relative to one, by wall time."""
    if 0 < len(cores()) < THREADS:
        print(f"{name} on {THREADS} threads: left out, as there is one core.")
        return []
    calls = {
        str(count): lambda k, count=count: wall_time(partial(swept, lanes, span, peak, count))
        for count in (THREADS, 1)
    }
    two, one = (seconds(times) for times in interleaved(calls, plan.rounds).values())
    return [row(f"{name}, two threads", two, one, "one thread", 0.55)]


def swept(lanes: int, span: float, peak: bool, threads: int) -> int:
    """Sweep the clearances, and return the number of attempted steps."""
    scene, state = cj.mechanisms.double_pendulum(restitution=RESTITUTION)
    axis = cj.Axis(lambda s: s.joints["shoulder"].clearance, np.geomspace(LEAST, MOST, lanes))
    outputs = {"force": cj.Peak(cj.quantities.ContactForce("shoulder"), "N")} if peak else {}
    results = cj.sweep(
        scene,
        state,
        span,
        {"clearance": axis},
        outputs,
        cj.Settings(rtol=RTOL),
        threads=threads,
        progress=False,
    )
    return int(results.attempts.sum())


def _yardstick(plan: Plan, kind: str, lanes: int, span: float, k: int) -> Sample:
    del k
    assert plan.yardstick is not None
    found = plan.yardstick.run(kind, span, RTOL, (LEAST, MOST, lanes))
    return Sample(found.seconds, int(found.attempts.sum()))
