"""What a run costs: clearjoint against SciPy and Exudyn, time of a first result, compiler options.

    python -m studies.benchmark pendulum [--full | --quick] [--repeats N] [--json FILE]
    python -m studies.benchmark first-result | options | profile

The paper's double pendulum (0.5 mm, restitution 0.9) in all programs. They run in turn, A B C A B
C, after a first run each that compiles. clearjoint's time is that of a whole call of `simulate`,
checks included; of SciPy and Exudyn it is the integration alone. From 0.15 s on the motion is
chaotic, and runs of equal length cost unequally: SciPy took 4.7 to 18 s for the same second. So
each round has another clearance, by a millionth, and medians are compared. What does not depend on
the motion is the time of a step or of a right-hand side, and the error at 0.1 s, which is taken
against clearjoint with Dopri8 at rtol 1e-11 (3e-13 m off the extended-precision reference).

Right-hand sides of clearjoint are attempts times stages (6 of Tsit5, 13 of Dopri8: the first is the
last of the step before); SciPy counts its own; Exudyn's are Newton iterations.

Measured on 2026-11-21, two-core shared machine, 4 s, medians of 3 (`pendulum --full`):

| program | setting | s | right-hand sides | µs each | times clearjoint | error, m |
|---|---|---|---|---|---|---|
| clearjoint, Tsit5 | rtol 1e-6 | 0.163 | 379 000 | 0.44 | 1 | 9.5e-10 |
| clearjoint, Tsit5 | rtol 1e-8 | 0.272 | 643 000 | 0.42 | 1 | 1.5e-11 |
| clearjoint, Dopri8 | rtol 1e-6 | 0.277 | 555 000 | 0.50 | 1.7 | 2.3e-11 |
| clearjoint, Dopri8 | rtol 1e-8 | 0.366 | 734 000 | 0.50 | 1.3 | 4.6e-12 |
| SciPy, DOP853 | rtol 1e-6 | 21.4 | 282 000 | 77 | 131 | 2.0e-6 |
| SciPy, DOP853 | rtol 1e-8 | 39.9 | 524 000 | 76 | 147 | 4.6e-9 |
| Exudyn | step 1e-4 s | 3.20 | 761 000 | 4.2 | 20 | 8.7e-6 |
| Exudyn | step 5e-6 s | 16.4 | 4 460 000 | 3.6 | 101 | 1.3e-6 |

What an attempted step with Tsit5 is made of (`profile`; 2.6 µs): six right-hand sides of 0.26 µs
in a native loop alone, 60 %; sums over stages and the error, 21 %; controller, 3 %; landing, memory
and acceptance, 16 %. A call of `simulate` takes 5.2 ms beside its steps. A first result of 4 s in a
fresh process (`first-result`) takes 5.3 s with an empty compilation cache and 2.5 s with a filled
one, of which imports take 0.7 s. The compiler options of `configure` (`options`) make an attempt
cost 3.0 instead of 54 µs: the native loop alone 13 µs, multi-output fusion alone 24 µs.
"""

import argparse
import json
import os
import platform
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Any

import diffrax
import numpy as np

import clearjoint as cj

ROOT = Path(__file__).resolve().parents[1]
if not __package__:  # run as a file
    sys.path.insert(0, str(ROOT))

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
    solution = cj.simulate(scene, state, span, rtol=rtol, solver=solver, progress=False)
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
    from studies.baselines import scipy_pendulum

    def scipy_run(rtol: float, span: float, clearance: float) -> Outcome:
        return _outcome(scipy_pendulum.run(span, rtol, 1e-3 * rtol, clearance, RESTITUTION))

    name = "SciPy, DOP853"
    found = [Candidate(name, f"rtol {rtol:g}", rtol, partial(scipy_run, rtol)) for rtol in RTOLS]
    if find_spec("exudyn") is None:
        print("Exudyn is not installed (pip install 'exudyn>=1.13'): its rows are left out.")
        return found
    from studies.baselines import exudyn_pendulum

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


def markdown(rows: list[tuple[str, ...]]) -> str:
    """A Markdown table; the first row is its head."""
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([lines[0], "|" + "---|" * len(rows[0]), *lines[1:]])


def pendulum(options: argparse.Namespace) -> None:
    """Measure the double pendulum, print the table, and write JSON if asked."""
    cj.configure()
    ours, others = clearjoint_candidates(), baseline_candidates()
    short = QUICK if options.quick else LONG if options.full else SHORT
    series = measure(ours + others, short, options.repeats)
    if short == SHORT:
        series = measure(ours, LONG, options.repeats) + series
    _report(options.json, pendulum_rows(series), [_record(one) for one in series])
    print(
        f"\nError of r2 at {min(CHECKED, short):g} s, against clearjoint with Dopri8 at rtol 1e-11."
        "\nTimes clearjoint: median over that of Tsit5 over the same span at the same rtol "
        f"(Exudyn: {RTOLS[0]:g}); {options.repeats} rounds, of slightly different clearances."
        "\nFirst calls, which compile, are not in the times: see `first-result`."
    )


def _record(one: Series) -> dict[str, Any]:
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


def _report(file: Path | None, rows: list[tuple[str, ...]], records: list[dict[str, Any]]) -> None:
    """Print the rows as a table, and write the records as JSON if there is a file to write to."""
    print(markdown(rows))
    if file is None:
        return
    packages = ("jax", "jaxlib", "diffrax", "numpy", "scipy", "exudyn")
    found = {name: version(name) for name in packages if find_spec(name)}
    about = {
        "time": time.strftime("%Y-%m-%dT%H:%M:%S%z"),
        "machine": f"{platform.platform()}, {os.cpu_count()} cores",
        "python": platform.python_version(),
        "packages": found,
        "rows": records,
    }
    file.write_text(json.dumps(about, indent=1), encoding="utf-8")


def first_result(options: argparse.Namespace) -> None:
    """Time until a fresh process has simulated 4 s at rtol 1e-6, with empty and filled cache."""
    from studies.fresh_process import first_results

    _report_medians(options.json, first_results(options.repeats))


def compiler_options(options: argparse.Namespace) -> None:
    """What XLA's options buy: time to compile, µs an attempt, native loops; in fresh processes."""
    from studies.fresh_process import option_costs

    _report_medians(options.json, option_costs(options.repeats))


def profile(options: argparse.Namespace) -> None:
    """What the time of an attempt is made of."""
    from studies.step_profile import time_of_parts

    cj.configure()
    solvers = (diffrax.Tsit5(), diffrax.Dopri8())
    found = [record for one in solvers for record in time_of_parts(one, options.repeats)]
    _report_medians(options.json, found)


def _report_medians(file: Path | None, records: list[dict[str, Any]]) -> None:
    """Report repeated measurements: a row for each value of the first entry, medians of others."""
    key, *others = records[0]
    rows = [(key, *(f"{name} (least)" for name in others))]
    for value in dict.fromkeys(record[key] for record in records):
        chosen = [record for record in records if record[key] == value]
        columns = ([record[name] for record in chosen] for name in others)
        rows.append((value, *(f"{median(cells):.3g} ({min(cells):.3g})" for cells in columns)))
    _report(file, rows, records)


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The subcommand, as `measurement`, and its options from a command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    commands = parser.add_subparsers(required=True)
    for name, action, repeats in (
        ("pendulum", pendulum, 5),
        ("first-result", first_result, 3),
        ("options", compiler_options, 3),
        ("profile", profile, 7),
    ):
        help_text = (action.__doc__ or "").strip()
        command = commands.add_parser(name, help=help_text, description=help_text)
        command.set_defaults(measurement=action)
        command.add_argument("--repeats", type=int, default=repeats)
        command.add_argument("--json", type=Path, help="file for all numbers")
        if action is pendulum:
            command.add_argument("--quick", action="store_true", help=f"{QUICK:g} s, once")
            command.add_argument("--full", action="store_true", help=f"everything over {LONG:g} s")
    options = parser.parse_args(arguments)
    if getattr(options, "quick", False):
        options.repeats = 1
    if options.repeats < 1:
        parser.error("--repeats must be at least 1")
    return options


def main(arguments: list[str] | None = None) -> None:
    """Measure what the command line asks for, and print it."""
    options = parse(arguments)
    options.measurement(options)


if __name__ == "__main__":
    main()
