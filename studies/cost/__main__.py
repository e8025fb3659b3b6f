"""Cost of a step by feature and by coordinates, and drift over a day of motion.

    python -m studies.cost [features | coordinates | long-runs] [--quick] [--output results/cost]

Each part prints a table; without a name all parts run. `features` and `long-runs` draw a figure.
"""

import argparse
import warnings

import clearjoint as cj
from studies.common.output import Output, add_options
from studies.common.report import markdown
from studies.cost import coordinates, features, long_runs


def features_part(output: Output) -> str:
    """Measure the features, draw their costs, and return the table."""
    costs = features.measure(output.quick)
    output.save(features.figure(costs), "features")
    return markdown(features.table(costs))


def coordinates_part(output: Output) -> str:
    """Return the table of absolute and joint coordinates."""
    mechanisms = (coordinates.IDEAL,) if output.quick else coordinates.MECHANISMS
    return markdown(coordinates.table(coordinates.measure(mechanisms)))


def long_runs_part(output: Output) -> str:
    """Run the long runs, draw drift and memory, and return their tables."""
    cases, span = long_runs.QUICK if output.quick else (long_runs.CASES, long_runs.DAY)
    outcomes = [long_runs.run(case, span, long_runs.MAX_STEPS) for case in cases]
    output.save(long_runs.figure(outcomes), "long_runs")
    tables = [markdown(long_runs.table(outcomes))]
    if not output.quick:
        tables.append(markdown(long_runs.late_start_table(long_runs.late_starts())))
    return "\n\n".join(tables)


PARTS = {
    "features": features_part,
    "coordinates": coordinates_part,
    "long-runs": long_runs_part,
}


def main(arguments: list[str] | None = None) -> None:
    """Run the parts that the command line names."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("part", nargs="?", choices=[*PARTS, "all"], default="all")
    add_options(parser, "two features, one mechanism, a minute of two long runs")
    options = parser.parse_args(arguments)
    cj.configure()
    warnings.filterwarnings("ignore", category=cj.LeftBearingWarning)
    output = Output.of(__file__, options)
    for name in PARTS if options.part == "all" else [options.part]:
        print(f"\n{PARTS[name](output)}", flush=True)


if __name__ == "__main__":
    main()
