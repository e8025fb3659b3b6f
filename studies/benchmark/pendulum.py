"""The paper's double pendulum, one run after the other: clearjoint, SciPy and Exudyn."""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from importlib.util import find_spec
from statistics import median
from typing import Any

import diffrax
import numpy as np

import clearjoint as cj
from studies.common.report import Record, report

CLEARANCE, RESTITUTION = 0.5e-3, 0.9
"""m and 1."""
LONG, SHORT, QUICK = 4.0, 1.0, 0.02
"""Simulated spans, s: of clearjoint alone, of all candidates, and of a quick run."""
CHECKED = 0.1
"""Instant, s, at which errors are taken: after eleven contacts, before chaos."""
NUDGE = 1e-6
"""By this share the clearance grows from round to round: another motion once it is chaotic."""
RTOLS = (1e-6, 1e-8)
EXUDYN_STEPS = (1e-4, 5e-6)
"""Largest steps, s: what a user would begin with, and what takes its error at 0.1 s to 1e-6 m."""
YARDSTICK = "clearjoint, Tsit5"


@dataclass(frozen=True)
class Outcome:
    """One run: arm 2's centre at its end (3,) m, what was counted, and its wall time in s."""

    r2: np.ndarray
    tried: int | None
    accepted: int
    right_hand_sides: int
    seconds: float


@dataclass(frozen=True)
class Candidate:
    """A program with its setting, set against the yardstick at `rtol`; runs span s, clearance m."""

    name: str
    setting: str
    rtol: float
    run: Callable[[float, float], Outcome]


@dataclass
class Series:
    """Runs over `span` s, error at the `first` one's end, m, and ratio to the yardstick's time."""

    candidate: Candidate
    span: float
    first: Outcome
    error: float = float("nan")
    runs: list[Outcome] = field(default_factory=list)
    ratio: float = float("nan")

    @property
    def seconds(self) -> list[float]:
        """Wall times, s."""
        return [run.seconds for run in self.runs]


def clearjoint_run(
    solver: diffrax.AbstractERK, rtol: float, span: float, clearance: float = CLEARANCE
) -> Outcome:
    """One call of `simulate`, its checks included. It returns host values, so nothing is pending.

    Right-hand sides: one a stage and attempt, but for the first stage, which the last attempt left.
    Not counted: one at the start, and one an onset for the entry speed.
    """
    scene, state = cj.double_pendulum(clearance, RESTITUTION)
    start = time.perf_counter()
    solution = cj.simulate(
        scene, state, span, cj.Settings(solver=solver, rtol=rtol), progress=False
    )
    seconds = time.perf_counter() - start
    attempts, tableau = int(solution.attempts), solver.tableau
    assert isinstance(tableau, diffrax.ButcherTableau) and tableau.fsal
    r2 = np.asarray(solution.final.bodies["arm 2"].position)
    evaluations = attempts * (tableau.num_stages - 1)
    return Outcome(r2, attempts, int(solution.accepted), evaluations, seconds)


def clearjoint_candidates() -> list[Candidate]:
    """clearjoint with its default solver, and with one of order eight."""
    return [
        Candidate(
            f"clearjoint, {type(solver).__name__}",
            f"rtol {rtol:g}",
            rtol,
            partial(clearjoint_run, solver, rtol),
        )
        for solver in (diffrax.Tsit5(), diffrax.Dopri8())
        for rtol in RTOLS
    ]


def baseline_candidates() -> list[Candidate]:
    """SciPy, and Exudyn if it is installed."""
    from studies.common.baselines import scipy_pendulum

    def scipy_run(rtol: float, span: float, clearance: float) -> Outcome:
        return _outcome(scipy_pendulum.run(span, rtol, 1e-3 * rtol, clearance, RESTITUTION))

    name = "SciPy, DOP853"
    found = [Candidate(name, f"rtol {rtol:g}", rtol, partial(scipy_run, rtol)) for rtol in RTOLS]
    if find_spec("exudyn") is None:
        print("Exudyn is not installed (pip install 'exudyn>=1.13'): its rows are left out.")
        return found
    from studies.common.baselines import exudyn_pendulum

    def exudyn_run(step: float, span: float, clearance: float) -> Outcome:
        return _outcome(exudyn_pendulum.run(span, step, clearance, RESTITUTION))

    return found + [
        Candidate("Exudyn", f"step {step:g} s", RTOLS[0], partial(exudyn_run, step))
        for step in EXUDYN_STEPS
    ]


def _outcome(run: Any) -> Outcome:
    return Outcome(run.r2, None, run.steps, run.right_hand_sides, run.seconds)


def measure(candidates: list[Candidate], span: float, repeats: int) -> list[Series]:
    """Run the candidates in turn, `repeats` times round, each once before to warm up."""
    checked = min(CHECKED, span)
    series = [Series(one, span, one.run(checked, CLEARANCE)) for one in candidates]
    reference = clearjoint_run(diffrax.Dopri8(), 1e-11, checked).r2
    for turn in range(repeats):
        for one in series:
            one.runs.append(one.candidate.run(span, CLEARANCE * (1.0 + NUDGE * turn)))
    yardsticks = {
        one.candidate.rtol: median(one.seconds) for one in series if one.candidate.name == YARDSTICK
    }
    for one in series:
        one.error = float(np.linalg.norm(one.first.r2 - reference))
        one.ratio = median(one.seconds) / yardsticks[one.candidate.rtol]
    return series


COLUMNS: tuple[str, ...] = (
    "program", "setting", "simulated, s", "steps tried", "accepted", "right-hand sides",
    "median, ms", "least", "most", "µs a step", "µs a right-hand side", "spread",
    "times clearjoint", "error of r2, m",
)  # fmt: skip


def pendulum_rows(series: list[Series]) -> list[tuple[str, ...]]:
    """The table: medians over the runs; a step is an accepted one.

    The spread is the range of the time of a right-hand side over its median: the machine's noise.
    """
    rows = [COLUMNS]
    for one in series:
        runs, times = one.runs, sorted(1e3 * seconds for seconds in one.seconds)
        tried = [run.tried for run in runs if run.tried is not None]
        costs = sorted(1e6 * run.seconds / run.right_hand_sides for run in runs)
        rows.append((
            one.candidate.name,
            one.candidate.setting,
            f"{one.span:g}",
            f"{median(tried):.0f}" if tried else "–",
            f"{median(run.accepted for run in runs):.0f}",
            f"{median(run.right_hand_sides for run in runs):.0f}",
            *(f"{milliseconds:.4g}" for milliseconds in (median(times), times[0], times[-1])),
            f"{median(1e6 * run.seconds / run.accepted for run in runs):.3g}",
            f"{median(costs):.3g}",
            f"{(costs[-1] - costs[0]) / median(costs):.0%}",
            f"{one.ratio:.3g}",
            f"{one.error:.1e}",
        ))  # fmt: skip
    return rows


def pendulum(options: argparse.Namespace) -> None:
    """Measure the double pendulum, print the table, and write JSON if asked."""
    cj.configure()
    ours, others = clearjoint_candidates(), baseline_candidates()
    short = QUICK if options.quick else LONG if options.full else SHORT
    series = measure(ours + others, short, options.repeats)
    if short == SHORT:
        series = measure(ours, LONG, options.repeats) + series
    report(options.json, pendulum_rows(series), [_record(one) for one in series])
    print(
        f"\nError of r2 at {min(CHECKED, short):g} s, against clearjoint with Dopri8 at rtol 1e-11."
        "\nTimes clearjoint: median over that of Tsit5 over the same span at the same rtol "
        f"(Exudyn: {RTOLS[0]:g}); {options.repeats} rounds, of slightly different clearances."
        "\nFirst calls, which compile, are not in the times: see `first-result`."
    )


def _record(one: Series) -> Record:
    return {
        "program": one.candidate.name,
        "setting": one.candidate.setting,
        "simulated_s": one.span,
        "steps_tried": [run.tried for run in one.runs],
        "steps_accepted": [run.accepted for run in one.runs],
        "right_hand_sides": [run.right_hand_sides for run in one.runs],
        "seconds": one.seconds,
        "times_clearjoint": one.ratio,
        "first_call_s": one.first.seconds,
        "error_m": one.error,
        "r2_m": one.first.r2.tolist(),
    }
