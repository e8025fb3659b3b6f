"""Cost of error-controlled derivatives relative to the run, by the number of parameters."""

from collections.abc import Callable
from functools import cache, partial

import numpy as np

import clearjoint as cj
from studies.benchmark.table import (
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

SPAN, NO_TIME = 0.1, 1e-6
"""Simulated times, s."""
COUNTS, QUICK_COUNTS = (1, 3, 8, 12), (1,)
RTOL, LANDING = 1e-9, 1e-13
TOLERANCES = (10.0, 1e3)
"""Tolerances of the derivatives relative to those of the states: the default, and that of fits."""
AIMS = {10.0: 4.0, 1e3: 3.5}
STEP_AIM, FEW = 3.2, 8
"""Aim of the cost of a step, and largest number of parameters with aims."""
REPEATS = 30
"""Number of calls; the least time counts, since a run takes less than the rest of its call."""
REFERENCE = {
    0.012: (2.861031385e-4, -2.626347866e-6, -4.567781795e-5),
    0.1: (-3.040991498e-4, 5.228820326e-5, -2.617509723e-3),
}
"""Derivatives of arm 2's height, m, at the end time by log c (K follows c), log K and restitution,
by central differences of an event-exact solver in quadruple precision.
"""


def _inertia(body: str, axis: int) -> cj.Parameter:
    return cj.Parameter(lambda s: s.bodies[body].inertia[axis], cj.Log())


PARAMETERS = {
    "log c": cj.Parameter(lambda s: s.joints["shoulder"].clearance, cj.Log()),
    "log K": cj.Parameter(lambda s: s.joints["shoulder"].law.stiffness.young_modulus, cj.Log()),
    "e": cj.Parameter(lambda s: s.joints["shoulder"].law.restitution),
    "mass of arm 2": cj.Parameter(lambda s: s.bodies["arm 2"].mass, cj.Log()),
    "mass of arm 3": cj.Parameter(lambda s: s.bodies["arm 3"].mass, cj.Log()),
    "gravity": cj.Parameter(lambda s: s.gravity[1]),
    **{f"inertia {k} of arm 2": _inertia("arm 2", k) for k in range(3)},
    **{f"inertia {k} of arm 3": _inertia("arm 3", k) for k in range(3)},
}
"""Parameters of the derivatives, in order."""


def rows(plan: Plan) -> list[Row]:
    """Measure steps and runs with derivatives relative to those without, without the cost of a
    call.
    """
    found = []
    for count in QUICK_COUNTS if plan.quick else COUNTS:
        calls = {
            "run": lambda k: _timed(partial(_run, SPAN)),
            "call": lambda k: _timed(partial(_run, NO_TIME)),
        }
        for tolerance in TOLERANCES:
            case = partial(_derivatives, count, tolerance)
            calls[f"{tolerance:g}"] = lambda k, c=case: _timed(partial(c, SPAN))
        case = partial(_derivatives, count, TOLERANCES[0])
        calls["call with derivatives"] = lambda k, c=case: _timed(partial(c, NO_TIME))
        with on_cores(1):
            samples = interleaved(calls, plan.rounds)
        call, call_with = samples["call"], samples["call with derivatives"]
        label = f"{count} parameter" + ("s" if count > 1 else "")
        few = count <= FEW
        steps = (step_times(samples["10"], call_with), step_times(samples["run"], call))
        aim = STEP_AIM if few else None
        found.append(row(f"an attempted step, {label}", *steps, "without derivatives", aim))
        for tolerance, aim in AIMS.items():
            found.append(
                row(
                    f"derivatives, {label}, tolerance {tolerance:g}",
                    seconds(samples[f"{tolerance:g}"]) - _least(call_with),
                    seconds(samples["run"]) - _least(call),
                    "the run",
                    aim if few else None,
                )
            )
        if count == 3 or plan.quick:
            found.append(row(f"call of `sensitivities` over 1 µs, {label}", seconds(call_with)))
    return found


def _timed(call: Callable[[], int]) -> Sample:
    return processor_time(call, REPEATS)


def _least(samples: list[Sample]) -> float:
    return float(np.min(seconds(samples)))


@cache
def _pendulum() -> tuple[cj.Scene, cj.State]:
    return cj.mechanisms.double_pendulum()


def _settings(tolerance: float) -> cj.Settings:
    return cj.Settings(rtol=RTOL, landing_tolerance=LANDING, derivative_tolerance=tolerance)


def _run(span: float) -> int:
    scene, state = _pendulum()
    run = cj.simulate(scene, state, span, _settings(TOLERANCES[0]), progress=False)
    return int(run.attempts)


def _derivatives(count: int, tolerance: float, span: float) -> int:
    return int(derivatives(count, tolerance, span).attempts)


def derivatives(count: int, tolerance: float, span: float) -> cj.results.Sensitivities:
    """Return the derivatives of arm 2's final height by the first `count` parameters."""
    scene, state = _pendulum()
    return cj.sensitivities(
        scene,
        state,
        span,
        dict(list(PARAMETERS.items())[:count]),
        {"height": cj.quantities.Position("arm 2", "y")},
        [span],
        _settings(tolerance),
        progress=False,
    )
