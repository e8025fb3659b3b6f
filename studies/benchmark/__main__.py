"""What a run costs: clearjoint against SciPy and Exudyn, time of a first result, compiler options.

    python -m studies.benchmark pendulum [--full | --quick] [--repeats N] [--json FILE]
    python -m studies.benchmark sweep [--quick] [--devices N] [--repeats N] [--json FILE]
    python -m studies.benchmark scaling [--quick] [--json FILE]
    python -m studies.benchmark gradients [--quick] [--repeats N] [--json FILE]
    python -m studies.benchmark first-calls [--quick] [--repeats N] [--json FILE]
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
"""

import argparse
from pathlib import Path

import diffrax

import clearjoint as cj
from studies.benchmark import (
    cold_start,
    first_calls,
    gradients,
    pendulum,
    scaling,
    step_profile,
    sweep,
)
from studies.common.report import Record, medians, report


def first_result(options: argparse.Namespace) -> None:
    """Time until a fresh process has simulated 4 s at rtol 1e-6, with empty and filled cache."""
    _report_medians(options.json, cold_start.first_results(options.repeats))


def calls_of_fresh_processes(options: argparse.Namespace) -> None:
    """Import, first runs, sweeps and derivatives of fresh processes, and what they should take."""
    records = first_calls.first_calls(options.repeats, options.quick)
    rows = [tuple(records[0]), *(tuple(map(_shown, record.values())) for record in records)]
    report(options.json, rows, records)


def _shown(value: str | float) -> str:
    return value if isinstance(value, str) else f"{value:.2f}"


def compiler_options(options: argparse.Namespace) -> None:
    """What XLA's options buy: time to compile, µs an attempt, native loops; in fresh processes."""
    _report_medians(options.json, cold_start.option_costs(options.repeats))


def profile(options: argparse.Namespace) -> None:
    """What the time of an attempt is made of, in single runs and in a batch."""
    cj.configure(threads=1)
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
    ("first-calls", calls_of_fresh_processes, 3),
    ("options", compiler_options, 3),
    ("profile", profile, 7),
)
"""Name, what it does, and how often it repeats."""
QUICK = {
    "pendulum": f"{pendulum.QUICK:g} s, once",
    "sweep": f"{sweep.QUICK_LANES} lanes, {sweep.QUICK_SPAN:g} s, once",
    "scaling": "few lanes and bodies, once",
    "first-calls": "the import and the pendulum's first run, once",
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
