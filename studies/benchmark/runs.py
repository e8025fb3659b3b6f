"""Single runs of the paper's pendulum compared with C++, SciPy and Exudyn; the cost of a call."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec

import diffrax
import numpy as np

import clearjoint as cj
from studies.benchmark.table import (
    SHORT,
    Plan,
    Row,
    Sample,
    interleaved,
    on_cores,
    processor_time,
    row,
    seconds,
    step_times,
)
from studies.benchmark.yardstick import CHECKED_SPAN, CLEARANCE, RESTITUTION, SCALAR
from studies.common.baselines import scipy_pendulum
from studies.common.baselines.scipy_pendulum import BaselineRun

SPAN, QUICK_SPAN = 4.0, 0.2
"""Simulated times, s."""
BESIDE_OTHERS, QUICK_BESIDE_OTHERS = 0.5, 0.02
"""Simulated times of the comparison with slower programs, s."""
NO_TIME = 1e-6
"""Simulated time of a call that has only the constant cost, s."""
RTOL, EXUDYN_STEP = 1e-6, 1e-4
"""Tolerance, and Exudyn's longest step, s."""
NUDGE = 1e-6
"""Relative change of the clearance from round to round, which changes a chaotic motion."""
FEW = 3
"""Largest number of rounds of the slower programs."""


def rows(plan: Plan) -> list[Row]:
    """Measure a run of 4 s relative to scalar C++, and the cost of a call."""
    span = QUICK_SPAN if plan.quick else SPAN
    calls = {"run": lambda k: _run(span, k), "call": lambda k: _run(NO_TIME, k)}
    yardstick = plan.yardstick
    if yardstick is not None:

        def scalar(k: int) -> Sample:
            # A few chaotic motions overflow the C++, which has no limit of its steps.
            for other in range(k, k + 10 * plan.rounds, plan.rounds):
                clearance = _clearance(other)
                found = yardstick.run(SCALAR, span, RTOL, (clearance, clearance, 1))
                if np.isfinite(found.positions).all():
                    return Sample(found.seconds, int(found.attempts[0]))
            raise RuntimeError(f"The yardstick overflows at clearances near {clearance} m.")

        calls["C++"] = scalar
    with on_cores(1):
        found = interleaved(calls, plan.rounds)
    whole, step = seconds(found["run"]), step_times(found["run"], found["call"])
    there = found.get("C++")
    theirs = (seconds(there), step_times(there)) if there else (None, None)
    return [
        row(f"run of {span:g} s", whole, theirs[0], SCALAR, 1.5),
        row("an attempted step of it", step, theirs[1], SCALAR, 1.5),
        row("call of `simulate` over 1 µs", seconds(found["call"]), aim=1e-3),
    ]


def others(plan: Plan) -> list[Row]:
    """Measure a run relative to SciPy's `solve_ivp` and Exudyn, with errors before chaos."""
    span = QUICK_BESIDE_OTHERS if plan.quick else BESIDE_OTHERS
    programs = [_Program("SciPy, DOP853, rtol 1e-6", _scipy)]
    if find_spec("exudyn") is None:
        print("Exudyn is not installed (pip install 'exudyn>=1.13'): its row is left out.")
    else:
        programs.append(_Program(f"Exudyn, steps up to {EXUDYN_STEP:g} s", _exudyn))
    checked = min(CHECKED_SPAN, span)
    reference = _end(checked, 0, cj.Settings(solver=diffrax.Dopri8(), rtol=1e-11))
    error = np.linalg.norm(_end(checked, 0, _settings()) - reference)
    found = []
    for program in programs:
        calls = {
            "here": lambda k: _run(span, k),
            "there": lambda k, program=program: processor_time(
                lambda: program.run(span, _clearance(k)).steps
            ),
        }
        with on_cores(1):
            samples = interleaved(calls, min(plan.rounds, FEW))
            off = np.linalg.norm(program.run(checked, CLEARANCE).r2 - reference)
        label = f"run of {span:g} s; errors at {checked:g} s: {error:.0e} and {off:.0e} m"
        here, there = (seconds(times) for times in samples.values())
        found.append(row(label, here, there, program.name))
    return found


@dataclass(frozen=True)
class _Program:
    """A program that simulates a span, s, with a clearance, m."""

    name: str
    run: Callable[[float, float], BaselineRun]


def _clearance(k: int) -> float:
    return CLEARANCE * (1.0 + NUDGE * k)


def _settings() -> cj.Settings:
    return cj.Settings(rtol=RTOL)


def _run(span: float, k: int) -> Sample:
    scene, state = cj.mechanisms.double_pendulum(_clearance(k), RESTITUTION)

    def call() -> int:
        return int(cj.simulate(scene, state, span, _settings(), progress=False).attempts)

    return processor_time(call, SHORT)


def _end(span: float, k: int, settings: cj.Settings) -> np.ndarray:
    scene, state = cj.mechanisms.double_pendulum(_clearance(k), RESTITUTION)
    final = cj.simulate(scene, state, span, settings, progress=False).final
    return np.asarray(final.bodies["arm 2"].position)


def _scipy(span: float, clearance: float) -> BaselineRun:
    return scipy_pendulum.run(span, RTOL, 1e-3 * RTOL, clearance, RESTITUTION)


def _exudyn(span: float, clearance: float) -> BaselineRun:
    from studies.common.baselines import exudyn_pendulum

    return exudyn_pendulum.run(span, EXUDYN_STEP, clearance, RESTITUTION)
