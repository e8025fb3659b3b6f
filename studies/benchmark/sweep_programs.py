"""A sweep over clearances in clearjoint, measured in the process that calls these functions.

Times are those of whole calls after a first one, which compiles.
"""

import resource
import time
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import numpy as np

import clearjoint as cj
from clearjoint.testing import programs_of_sweeps
from studies.common.operations import jaxpr_operations

RESTITUTION = 0.9
STAGES = 6
"""Right-hand sides an attempt with Tsit5; one more begins a lane."""
COORDINATES = {
    "joint": cj.JointCoordinates,
    "absolute": cj.AbsoluteCoordinates,
}
Record = dict[str, Any]


def clearance_axis(values: Any) -> cj.Axis:
    """Radial clearances of the pendulum, m."""
    return cj.Axis(lambda scene: scene.joints["shoulder"].clearance, values)


def swept(
    clearances: Sequence[float], duration: float, devices: int, coordinates: str = "joint"
) -> Record:
    """One call of `sweep` over clearances (m) for `duration` s.

    Returns wall time, s, lanes, steps tried, right-hand sides, turns given to lanes and empty
    columns, and the largest memory the process has ever had, MB.
    """
    cj.configure(threads=devices)
    scene, state = cj.double_pendulum(restitution=RESTITUTION)
    axes = {"clearance": clearance_axis(clearances)}
    with programs_of_sweeps() as programs:
        start = time.perf_counter()
        results = cj.sweep(
            scene,
            state,
            duration,
            axes,
            settings=cj.Settings(coordinates=COORDINATES[coordinates]()),
            progress=False,
        )
        seconds = time.perf_counter() - start
    record = _record(seconds, results.attempts.values)
    return record | {
        "turns": programs[0].turns,
        "peak_memory_MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def looped(clearances: Sequence[float], duration: float) -> Record:
    """A loop over single runs, on one core."""
    cj.configure(threads=1)
    attempts = []
    start = time.perf_counter()
    for clearance in clearances:
        scene, state = cj.double_pendulum(clearance, RESTITUTION)
        solution = cj.simulate(scene, state, duration, cj.Settings(rtol=1e-6), progress=False)
        attempts.append(int(solution.attempts))
    return _record(time.perf_counter() - start, np.array(attempts))


def counted(clearances: Sequence[float], coordinates: str) -> Record:
    """Operations of a turn, which tries one step, as JAX traces them."""
    cj.configure(threads=1)
    scene, state = cj.double_pendulum(restitution=RESTITUTION)
    axes = {"clearance": clearance_axis(clearances)}
    with programs_of_sweeps() as programs:
        cj.sweep(
            scene,
            state,
            1e-4,
            axes,
            settings=cj.Settings(coordinates=COORDINATES[coordinates]()),
            progress=False,
        )
    turn = eqx.filter_make_jaxpr(programs[0].turn)(programs[0].lane)[0]
    return {"operations traced": jaxpr_operations(turn.jaxpr)}


def _record(seconds: float, attempts: np.ndarray) -> Record:
    steps = int(attempts.sum())
    return {
        "seconds": seconds,
        "lanes": len(attempts),
        "steps": steps,
        "right_hand_sides": STAGES * steps + len(attempts),
    }
