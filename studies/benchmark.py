"""What a run costs: clearjoint against SciPy and Exudyn, time of a first result, compiler options.

    python -m studies.benchmark pendulum [--full | --quick] [--repeats N] [--json FILE]
    python -m studies.benchmark sweep [--quick] [--devices N] [--repeats N] [--json FILE]
    python -m studies.benchmark scaling [--quick] [--json FILE]
    python -m studies.benchmark gradients [--quick] [--repeats N] [--json FILE]
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

Measured on 2026-11-21, four-core shared machine, 4 s, medians of 5 (`pendulum --full`):

| program | setting | s | right-hand sides | µs each | times clearjoint | error, m |
|---|---|---|---|---|---|---|
| clearjoint, Tsit5 | rtol 1e-6 | 0.086 | 319 000 | 0.28 | 1 | 4.8e-10 |
| clearjoint, Tsit5 | rtol 1e-8 | 0.158 | 590 000 | 0.26 | 1 | 8.1e-12 |
| clearjoint, Dopri8 | rtol 1e-6 | 0.081 | 360 000 | 0.23 | 0.94 | 2.2e-10 |
| clearjoint, Dopri8 | rtol 1e-8 | 0.149 | 640 000 | 0.23 | 0.94 | 3.3e-12 |
| SciPy, DOP853 | rtol 1e-6 | 36.9 | 416 000 | 89 | 428 | 2.0e-6 |
| SciPy, DOP853 | rtol 1e-8 | 45.7 | 524 000 | 87 | 289 | 4.6e-9 |
| Exudyn | step 1e-4 s | 4.0 | 761 000 | 5.3 | 46 | 8.7e-6 |
| Exudyn | step 5e-6 s | 20.3 | 4 460 000 | 4.5 | 235 | 1.3e-6 |

What an attempted step with Tsit5 is made of (`profile`; 1.67 µs): six right-hand sides of 0.11 µs
in a native loop alone, 38 %; sums over stages and the error, 19 %; controller, landing, memory and
acceptance, 43 %. A call of `simulate` takes 7.7 ms beside its steps. A first result of 4 s in a
fresh process (`first-result`) takes 6.6 s with an empty compilation cache and 3.4 s with a filled
one, of which imports take 1.2 s. The compiler options of `configure` (`options`) made an attempt
cost 3.0 instead of 54 µs in absolute coordinates: the native loop alone 13 µs, multi-output fusion
alone 24.

The sweep: 256 clearances, log-spaced in 0.05 to 1 mm, 0.5 s, rtol 1e-6. Each program has a process
of its own, tied to its cores, and they take turns. The slower programs run a sample of the
clearances, and times of a lane are compared (medians of 3, same day):

| program | cores | lanes run | s | µs a lane-step and core | waste | times a sweep on them |
|---|---|---|---|---|---|---|
| sweep, joint coordinates | 1 | 256 | 1.70 | 0.65 | 1.012 | 1 |
| sweep, joint coordinates | 2 | 256 | 1.12 | 0.86 | 1.013 | 1 |
| sweep, absolute coordinates | 1 | 256 | 3.04 | 1.18 | 1.125 | 1.8 |
| sweep, absolute coordinates | 2 | 256 | 3.01 | 2.33 | 1.439 | 2.7 |
| loop over `simulate` | 1 | 256 | 5.32 | 2.33 | | 3.1 |
| Exudyn, step 1e-4 | 2 | 32 | 8.49 | 23.6 | | 61 |
| SciPy, DOP853, rtol 1e-6 | 2 | 8 | 19.6 | 1381 | | 559 |

2.62 million lane-steps, 15.7 million right-hand sides; 4396 arithmetic operations a turn compiled
of 6525 traced. What a lane-turn is made of on one core (`profile`, µs), each column containing the
one before:

| places | six right-hand sides | solver's step | with controller | attempt | turn |
|---|---|---|---|---|---|
| 8 | 0.44 | 0.48 | 0.50 | 0.65 | 0.66 |
| 16 | 0.35 | 0.36 | 0.38 | 0.53 | 0.53 |
| 32 | 0.28 | 0.28 | 0.31 | 0.41 | 0.43 |
| 64 | 0.21 | 0.22 | 0.24 | 0.33 | 0.36 |
| 128 | 0.28 | 0.25 | 0.27 | 0.36 | 0.36 |

The longest lane decides how well places and cores are shared. Here it has 105 000 steps of 2.6
million (chaos: in other runs 30 000): in a program of 64 places it would keep the others waiting,
so it goes on in one of 8, whose turns are a quarter as long but cost each lane twice as much. That
is where the time above 64 places' 0.36 µs goes, and why two cores are 1.5 times as fast as one and
not twice; making and checking a scene for each lane takes 0.1 s more.
"""

import argparse
import sys
from pathlib import Path

import diffrax

import clearjoint as cj

if not __package__:  # run as a file
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from studies.benchmarks import fresh_process, gradients, pendulum, scaling, step_profile, sweep
from studies.benchmarks.report import Record, medians, report


def first_result(options: argparse.Namespace) -> None:
    """Time until a fresh process has simulated 4 s at rtol 1e-6, with empty and filled cache."""
    _report_medians(options.json, fresh_process.first_results(options.repeats))


def compiler_options(options: argparse.Namespace) -> None:
    """What XLA's options buy: time to compile, µs an attempt, native loops; in fresh processes."""
    _report_medians(options.json, fresh_process.option_costs(options.repeats))


def profile(options: argparse.Namespace) -> None:
    """What the time of an attempt is made of, in single runs and in a batch."""
    cj.configure(devices=1)
    solvers = (diffrax.Tsit5(), diffrax.Dopri8())
    runs = [record for one in solvers for record in step_profile.of_run(one, options.repeats)]
    batches = step_profile.of_batch(options.repeats)
    report(options.json, medians(runs), [*runs, *batches])
    print("\nA turn of one lane in a batch, by the number of lanes side by side:\n")
    report(None, medians(batches), [])


def _report_medians(file: Path | None, records: list[Record]) -> None:
    report(file, medians(records), records)


COMMANDS = (
    ("pendulum", pendulum.pendulum, 5),
    ("sweep", sweep.sweep, 5),
    ("scaling", scaling.scaling, 3),
    ("gradients", gradients.gradients, 9),
    ("first-result", first_result, 3),
    ("options", compiler_options, 3),
    ("profile", profile, 7),
)
"""Name, what it does, and how often it repeats."""
QUICK = {
    "pendulum": f"{pendulum.QUICK:g} s, once",
    "sweep": f"{sweep.QUICK_LANES} lanes, {sweep.QUICK_SPAN:g} s, once",
    "scaling": "few lanes and bodies, once",
    "gradients": f"{gradients.QUICK_SPAN:g} s, one tolerance and one parameter, once",
}


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The subcommand, as `measurement`, and its options from a command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    commands = parser.add_subparsers(required=True)
    for name, action, repeats in COMMANDS:
        help_text = (action.__doc__ or "").strip()
        command = commands.add_parser(name, help=help_text, description=help_text)
        command.set_defaults(measurement=action)
        command.add_argument("--repeats", type=int, default=repeats)
        command.add_argument("--json", type=Path, help="file for all numbers")
        if name in QUICK:
            command.add_argument("--quick", action="store_true", help=QUICK[name])
        if name == "pendulum":
            command.add_argument(
                "--full", action="store_true", help=f"everything over {pendulum.LONG:g} s"
            )
        if name == "sweep":
            command.add_argument("--devices", type=int, default=2, help="and as many cores")
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
