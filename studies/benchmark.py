"""What a run costs: clearjoint against SciPy and Exudyn, time of a first result, compiler options.

DOCSTRING
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Any

import diffrax
import equinox as eqx
import jax.numpy as jnp
import numpy as np

import clearjoint as cj
from clearjoint.dynamics import Formulation
from clearjoint.impacts import Landing
from clearjoint.runtime import settings, xla_flags
from clearjoint.segments import segment
from clearjoint.simulate import begin_compiled, default_controller
from clearjoint.stepping import Method

ROOT = Path(__file__).resolve().parents[1]
if not __package__:  # run as a file
    sys.path.insert(0, str(ROOT))

CLEARANCE, RESTITUTION = 0.5e-3, 0.9
"""m and 1."""
LONG, SHORT, QUICK = 4.0, 1.0, 0.02
"""Simulated spans, s: of clearjoint alone, of all candidates, and of a quick run."""
CHECKED = 0.1
"""Instant, s, at which the candidates' errors are taken: after five impacts, before chaos."""
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
    """A program with its accuracy setting; it is set against the yardstick at `rtol`."""

    name: str
    setting: str
    rtol: float
    run: Callable[[float], Outcome]


@dataclass
class Series:
    """Repeated runs of a candidate over `span` s, and its error at the checked instant, m."""

    candidate: Candidate
    span: float
    error: float
    runs: list[Outcome] = field(default_factory=list)
    ratio: float = float("nan")

    @property
    def seconds(self) -> list[float]:
        """Wall times, s."""
        return [run.seconds for run in self.runs]


def clearjoint_run(solver: diffrax.AbstractERK, rtol: float, span: float) -> Outcome:
    """One call of `simulate`, its checks included. It returns host values, so nothing is pending.

    Right-hand sides: one a stage and attempt, but for the first stage, which the last attempt left.
    Not counted: one at the start, and one an onset for the entry speed.
    """
    scene, state = cj.double_pendulum(CLEARANCE, RESTITUTION)
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
            lambda span, solver=solver, rtol=rtol: clearjoint_run(solver, rtol, span),
        )
        for solver in (diffrax.Tsit5(), diffrax.Dopri8())
        for rtol in RTOLS
    ]


def baseline_candidates() -> list[Candidate]:
    """SciPy, and Exudyn if it is installed."""
    from studies.baselines import scipy_pendulum

    def outcome(run: Any) -> Outcome:
        return Outcome(run.r2, None, run.steps, run.right_hand_sides, run.seconds)

    found = [
        Candidate(
            "SciPy, DOP853",
            f"rtol {rtol:g}",
            rtol,
            lambda span, rtol=rtol: outcome(scipy_pendulum.run(span, rtol, 1e-3 * rtol)),
        )
        for rtol in RTOLS
    ]
    if find_spec("exudyn") is None:
        print("Exudyn is not installed (pip install 'exudyn>=1.13'): its rows are left out.")
        return found
    from studies.baselines import exudyn_pendulum

    return found + [
        Candidate(
            "Exudyn",
            f"step {step:g} s",
            RTOLS[0],
            lambda span, step=step: outcome(exudyn_pendulum.run(span, step)),
        )
        for step in EXUDYN_STEPS
    ]


def measure(candidates: list[Candidate], span: float, repeats: int) -> list[Series]:
    """Run the candidates in turn, `repeats` times round, each once before to warm up.

    A ratio is the median over the rounds: the machine's speed changes, but less within a round.
    """
    checked = min(CHECKED, span)
    reference = clearjoint_run(diffrax.Dopri8(), 1e-11, checked).r2
    series = [
        Series(candidate, span, float(np.linalg.norm(candidate.run(checked).r2 - reference)))
        for candidate in candidates
    ]
    for _ in range(repeats):
        for one in series:
            one.runs.append(one.candidate.run(span))
    yardsticks = {
        one.candidate.rtol: one.seconds for one in series if one.candidate.name == YARDSTICK
    }
    for one in series:
        pairs = zip(one.seconds, yardsticks[one.candidate.rtol], strict=True)
        one.ratio = median(own / other for own, other in pairs)
    return series


COLUMNS = (
    "program", "setting", "simulated, s", "steps tried", "accepted", "right-hand sides",
    "median, ms", "least, ms", "spread", "µs a step", "µs a right-hand side",
    "times clearjoint", "error of r2, m",
)  # fmt: skip


def pendulum_table(series: list[Series]) -> str:
    """The Markdown table; a step is an accepted one, spread the range over the median."""
    rows = [COLUMNS, ("---",) * len(COLUMNS)]
    for one in series:
        run, middle = one.runs[-1], median(one.seconds)
        rows.append((
            one.candidate.name,
            one.candidate.setting,
            f"{one.span:g}",
            "–" if run.tried is None else str(run.tried),
            str(run.accepted),
            str(run.right_hand_sides),
            f"{1e3 * middle:.4g}",
            f"{1e3 * min(one.seconds):.4g}",
            f"{(max(one.seconds) - min(one.seconds)) / middle:.0%}",
            f"{1e6 * middle / run.accepted:.3g}",
            f"{1e6 * middle / run.right_hand_sides:.3g}",
            f"{one.ratio:.3g}",
            f"{one.error:.1e}",
        ))  # fmt: skip
    return markdown(rows)


def markdown(rows: list[tuple[str, ...]]) -> str:
    """A Markdown table of rows that are strings already."""
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def pendulum(options: argparse.Namespace) -> None:
    """Measure the double pendulum, print the table, and write JSON if asked."""
    cj.configure()
    ours, others = clearjoint_candidates(), baseline_candidates()
    short = QUICK if options.quick else LONG if options.full else SHORT
    series = measure(ours + others, short, options.repeats)
    if short == SHORT:
        series = measure(ours, LONG, options.repeats) + series
    print(pendulum_table(series))
    print(
        f"\nError of r2 at {min(CHECKED, short):g} s, against clearjoint with Dopri8 at rtol 1e-11."
        "\nTimes clearjoint: per simulated second, against Tsit5 over the same span at the same "
        f"rtol (Exudyn: {RTOLS[0]:g}); median of {options.repeats} rounds."
    )
    _write(options.json, [_record(one) for one in series])


def _record(one: Series) -> dict[str, Any]:
    run = one.runs[-1]
    return {
        "program": one.candidate.name,
        "setting": one.candidate.setting,
        "simulated_s": one.span,
        "steps_tried": run.tried,
        "steps_accepted": run.accepted,
        "right_hand_sides": run.right_hand_sides,
        "seconds": one.seconds,
        "times_clearjoint": one.ratio,
        "error_m": one.error,
        "r2_m": run.r2.tolist(),
    }


def _write(file: Path | None, rows: list[dict[str, Any]]) -> None:
    if file is None:
        return
    packages = ("jax", "jaxlib", "diffrax", "numpy", "scipy", "exudyn")
    found = {name: version(name) for name in packages if find_spec(name)}
    about = {
        "time": time.strftime("%Y-%m-%dT%H:%M:%S%z"),
        "machine": f"{platform.platform()}, {os.cpu_count()} cores",
        "python": platform.python_version(),
        "packages": found,
        "rows": rows,
    }
    file.write_text(json.dumps(about, indent=1), encoding="utf-8")


FIRST_RESULT = """
import json, sys, time
times = [time.perf_counter()]
import clearjoint as cj
times.append(time.perf_counter())
cj.configure(cache=sys.argv[1])
scene, state = cj.double_pendulum(0.5e-3, 0.9)
for _ in range(2):
    cj.simulate(scene, state, 4.0, rtol=1e-6, progress=False)
    times.append(time.perf_counter())
print(json.dumps([after - before for before, after in zip(times, times[1:])]))
"""


def in_process(code: str, *arguments: str, **variables: str) -> tuple[float, Any]:
    """Run code in a fresh Python that has none of clearjoint's settings but the given variables.

    Returns wall time of the process, s, and what it printed, as JSON.
    """
    known = {*settings(), "CLEARJOINT_CACHE"}
    kept = {name: value for name, value in os.environ.items() if name not in known}
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        env=kept | variables, cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    seconds = time.perf_counter() - start
    if done.returncode:
        raise RuntimeError(f"A measuring process failed:\n{done.stderr}")
    return seconds, json.loads(done.stdout.splitlines()[-1])


def first_result(options: argparse.Namespace) -> None:
    """Time until a fresh process has simulated 4 s at rtol 1e-6, without and with a filled cache."""
    found: dict[str, list[list[float]]] = {"empty": [], "filled": []}
    for _ in range(options.repeats):
        with tempfile.TemporaryDirectory() as folder:
            for cache in found:
                process, parts = in_process(FIRST_RESULT, folder)
                found[cache].append([process, *parts])
    names = ("process", "import", "configure and first run", "second run")
    rows = [("cache", *(f"{name}, s" for name in names), "least process, s"), ("---",) * 6]
    for cache, times in found.items():
        columns = list(zip(*times, strict=True))
        middles = [f"{median(column):.3f}" for column in columns]
        rows.append((cache, *middles, f"{min(columns[0]):.3f}"))
    print(markdown(rows))
    records = [{"cache": c, **dict(zip(names, t, strict=True))} for c in found for t in found[c]]
    _write(options.json, records)


FUSION, LOOP = "use_multi_output_fusion=true", "small_while_loop_byte_threshold=10000000"
OPTIONS = {
    "neither": "",
    "loop option": f"--xla_backend_extra_options=xla_cpu_{LOOP}",
    "fusion option": f"--xla_backend_extra_options=xla_cpu_{FUSION}",
    "configure(): both": xla_flags(),
}
"""Values of ``XLA_FLAGS`` by name."""


def native_calls() -> int:
    """Native loops in the compiled segment of the pendulum; 0 if every kernel starts alone."""
    scene, state = cj.double_pendulum(CLEARANCE, RESTITUTION)
    landing = Landing(jnp.asarray(1e-12))
    method = Method(diffrax.Tsit5(), default_controller(1e-6, 1e-9), Formulation(), landing)
    start, end, step = (jnp.asarray(time) for time in (0.0, 1.0, 1e-6))
    now = begin_compiled(method, scene, state, start, end, step, None, None)
    lowered = eqx.filter_jit(segment).lower(method, scene, now, end, jnp.asarray(1000))
    return (lowered.compile().as_text() or "").count("xla_cpu_small_call")


def under_these_flags() -> None:
    """Print what a run of 1 s costs with the compiler options of this process, as JSON."""
    solver = diffrax.Tsit5()
    compiling = clearjoint_run(solver, 1e-6, 1e-4).seconds
    runs = [clearjoint_run(solver, 1e-6, 1.0) for _ in range(3)]
    cost = min(run.seconds / (run.tried or 1) for run in runs)
    print(json.dumps([compiling, 1e6 * cost, native_calls()]))


def compiler_options(options: argparse.Namespace) -> None:
    """What XLA's options buy: time to compile, µs an attempt, native loops; in fresh processes."""
    code = "from studies.benchmark import under_these_flags; under_these_flags()"
    found: dict[str, list[Any]] = {name: [] for name in OPTIONS}
    for _ in range(options.repeats):
        for name, flags in OPTIONS.items():
            found[name].append(in_process(code, JAX_ENABLE_X64="1", XLA_FLAGS=flags)[1])
    rows = [("options", "first call, s", "µs an attempt", "least", "native loops"), ("---",) * 5]
    for name, results in found.items():
        first, cost, calls = zip(*results, strict=True)
        numbers = (f"{median(first):.2f}", f"{median(cost):.3g}", f"{min(cost):.3g}")
        rows.append((name, *numbers, str(max(calls))))
    print(markdown(rows))
    names = ("first_call_s", "microseconds_an_attempt", "native_loops")
    records = [{"options": n, **dict(zip(names, r, strict=True))} for n in found for r in found[n]]
    _write(options.json, records)


def profile(options: argparse.Namespace) -> None:
    """What the time of an attempt is made of."""
    from studies.step_profile import PARTS, time_of_parts

    cj.configure()
    rows = [("solver", *(f"{part}, µs" for part in PARTS)), ("---",) * (1 + len(PARTS))]
    records = []
    for solver in (diffrax.Tsit5(), diffrax.Dopri8()):
        times = time_of_parts(solver, options.repeats)
        rows.append((type(solver).__name__, *(f"{1e6 * t:.3g}" for t in times)))
        records.append({"solver": rows[-1][0], **dict(zip(PARTS, times, strict=True))})
    print(markdown(rows))
    _write(options.json, records)


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
