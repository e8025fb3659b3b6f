"""Many clearances in SciPy and in Exudyn, on several cores, as their users would run them."""

import multiprocessing
import time
from collections.abc import Sequence
from functools import partial
from typing import Any

from studies.common.baselines import scipy_pendulum


def scipy_lanes(
    clearances: Sequence[float], duration: float, rtol: float, cores: int
) -> dict[str, Any]:
    """A pool of processes, each with one clearance (m) at a time; starting them is not timed."""
    lane = partial(_scipy_lane, duration, rtol)
    with multiprocessing.get_context("spawn").Pool(cores) as pool:
        pool.map(partial(_scipy_lane, 1e-3, rtol), [clearances[0]] * cores, chunksize=1)
        start = time.perf_counter()
        found = pool.map(lane, clearances, chunksize=1)
        seconds = time.perf_counter() - start
    return _record(seconds, found)


def _scipy_lane(duration: float, rtol: float, clearance: float) -> tuple[int, int]:
    run = scipy_pendulum.run(duration, rtol, 1e-3 * rtol, clearance)
    return run.steps, run.right_hand_sides


def exudyn_lanes(
    clearances: Sequence[float], duration: float, step: float, cores: int
) -> dict[str, Any]:
    """`exudyn.processing.ParameterVariation` over the clearances (m), steps of at most `step` s."""
    from exudyn.processing import ParameterVariation

    start = time.perf_counter()
    _, found = ParameterVariation(
        partial(_exudyn_lane, duration, step),
        {"clearance": list(clearances)},
        useMultiProcessing=True,
        numberOfThreads=cores,
        showProgress=False,
    )
    return _record(time.perf_counter() - start, found)


def _exudyn_lane(duration: float, step: float, values: dict[str, float]) -> tuple[int, int]:
    from studies.common.baselines import exudyn_pendulum

    run = exudyn_pendulum.run(duration, step, values["clearance"])
    return run.steps, run.right_hand_sides


def _record(seconds: float, found: Sequence[tuple[int, int]]) -> dict[str, Any]:
    """Wall time, s, lanes, and what was counted in all of them."""
    steps, right_hand_sides = map(sum, zip(*found, strict=True))
    return {
        "seconds": seconds,
        "lanes": len(found),
        "steps": steps,
        "right_hand_sides": right_hand_sides,
    }
