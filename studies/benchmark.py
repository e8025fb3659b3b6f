"""What a run costs: clearjoint against SciPy and Exudyn, time of a first result, compiler options.

    python -m studies.benchmark pendulum [--full | --quick] [--repeats N] [--json FILE]
    python -m studies.benchmark sweep [--quick] [--devices N] [--repeats N] [--json FILE]
    python -m studies.benchmark scaling [--quick] [--json FILE]
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

The sweep: 256 clearances, log-spaced in 0.05 to 1 mm, 0.5 s, rtol 1e-6. Each program has a process
of its own, tied to its cores, and they take turns. The slower programs run a sample of the
clearances, and times of a lane are compared. What the 0.51 µs of a lane-turn are made of at 32
places on one core (`profile`, 2026-11-21, shared machine, least of 5), each column containing the
one before:

| places | six right-hand sides | solver's step | with controller | attempt | turn |
|---|---|---|---|---|---|
| 8 | 0.53 | 0.56 | 0.60 | 0.74 | 0.75 |
| 16 | 0.45 | 0.44 | 0.46 | 0.61 | 0.63 |
| 32 | 0.37 | 0.35 | 0.38 | 0.51 | 0.51 |
| 64 | 0.30 | 0.31 | 0.33 | 0.44 | 0.44 |
| 128 | 0.35 | 0.33 | 0.36 | 0.48 | 0.49 |

So at 32 places right-hand sides and stage sums take 69 %, the controller 5 %, landing, memory and
acceptance 25 %, reductions' frame 1 %. A whole sweep of 256 lanes takes 0.16 s more on the host,
which makes and checks a scene a lane, and 5 % more for slices. Compiled, a turn in joint
coordinates has fewer arithmetic operations than traced (4472 of 6307): nothing is computed twice.

The longest lane sets how well cores are shared: with 40 000 steps of 2.7 million, two devices of 32
places each cannot do better than 95 % of their capacity, and guessing what is left makes it 84 %.

A chain (`scaling`), single runs: a right-hand side of 1, 2 and 4 rods takes 0.10, 0.23 and 0.53 µs,
an attempt of 1, 2, 4 and 8 rods 1.2, 2.9, 6.9 and 17 µs; the first call 2.8, 7.0, 19, 66 and (16
rods) 195 s: the program is one function of unrolled arithmetic, whose compilation grows faster than
its length.
"""

import argparse
import sys
from pathlib import Path

import diffrax

import clearjoint as cj

if not __package__:  # run as a file
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from studies.benchmarks import fresh_process, pendulum, scaling, step_profile, sweep
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
    ("first-result", first_result, 3),
    ("options", compiler_options, 3),
    ("profile", profile, 7),
)
"""Name, what it does, and how often it repeats."""
QUICK = {
    "pendulum": f"{pendulum.QUICK:g} s, once",
    "sweep": f"{sweep.QUICK_LANES} lanes, {sweep.QUICK_SPAN:g} s, once",
    "scaling": "few lanes and bodies, once",
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
