"""Cost of runs, sweeps, derivatives and first calls, compared with C++ of the same model and
others.

    python -m studies.benchmark [NAME ...] [--quick] [--rounds N] [--output FOLDER] [--write]

Measures the named groups, or all; writes one table, a JSON file and a figure. `--write` also
replaces the table and the figure in the study's folder by those of a full run.
"""

import argparse
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

import clearjoint as cj
from studies.benchmark import backlash_chain, derivatives, first_calls, runs, sweeps
from studies.benchmark.table import HEAD, Plan, Row, figure, replace_table
from studies.benchmark.yardstick import WIDTHS, build
from studies.common.report import markdown, report

HERE = Path(__file__).resolve().parent
GROUPS: dict[str, Callable[[Plan], list[Row]]] = {
    "runs": runs.rows,
    "sweeps": sweeps.rows,
    "derivatives": derivatives.rows,
    "backlash": backlash_chain.rows,
    "others": runs.others,
    "first-calls": first_calls.rows,
}
"""Groups of the command line, and functions that measure them."""
ROUNDS = 5


def prepare(quick: bool, rounds: int, output: Path) -> Plan:
    """Return the plan of the measurements, after building the C++ program in `output` and checking
    it.
    """
    warnings.filterwarnings("ignore", category=cj.LeftBearingWarning)
    output.mkdir(parents=True, exist_ok=True)
    yardstick = build(output)
    if yardstick is not None:
        for kind in WIDTHS:
            yardstick.agreement(kind).check()
    return Plan(quick, 1 if quick else rounds, yardstick)


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Return the options of a command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(GROUPS))
    parser.add_argument("--quick", action="store_true", help="short runs, few of each, one round")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="of each row")
    parser.add_argument("--output", type=Path, default=Path("results/benchmark"))
    parser.add_argument(
        "--write", action="store_true", help="table and picture into the study's folder"
    )
    options = parser.parse_args(arguments)
    if unknown := set(options.names) - set(GROUPS):
        parser.error(f"NAME must be of {', '.join(GROUPS)}, but is {', '.join(sorted(unknown))}")
    if options.rounds < 1:
        parser.error(f"--rounds must be at least 1, but is {options.rounds}")
    if options.write and (options.quick or options.names):
        parser.error("--write needs a full run: leave out NAME and --quick")
    return options


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print and write what the command line names."""
    options = parse(arguments)
    cj.configure()
    output, rows, cells = options.output, [], [HEAD]
    plan = prepare(options.quick, options.rounds, output)
    for name in GROUPS:
        if name in options.names or not options.names:
            print(f"{name} …", file=sys.stderr, flush=True)
            rows += GROUPS[name](plan)
            cells = [HEAD, *(row.cells() for row in rows)]
            # After each group, so that a run that is stopped leaves what it has.
            (output / "benchmark.md").write_text(markdown(cells) + "\n", encoding="utf-8")
    report(output / "benchmark.json", cells, [asdict(row) for row in rows])
    for folder in (output, *[HERE] * options.write):
        figure(rows).savefig(folder / "benchmark.png", dpi=110)
    if options.write:
        replace_table(HERE / "README.md", markdown(cells))


if __name__ == "__main__":
    main()
