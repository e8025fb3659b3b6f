"""Parameter estimation from simulated measurements of the double pendulum and a crank-rocker.

    python -m studies.fits searches [--sensors NAME...] [--quick]
    python -m studies.fits baselines [--starts 10] [--quick]
    python -m studies.fits draws [--draws 50] [--sensors NAME...] [--quick]
    python -m studies.fits coverage [--draws 50] [--cases NAME...] [--quick]
    python -m studies.fits horizon [--quick]

- `searches`: which search finds the parameters from which start.
- `baselines`: searches with derivatives compared with SciPy and Exudyn without derivatives.
- `draws`: scatter of the estimates over many draws of the noise, against the Cramér-Rao bound.
- `coverage`: how often 95 % intervals contain the true value.
- `horizon`: the longest record that a single run can fit, predicted and tried.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence

import clearjoint as cj
from studies.common.output import Output, add_options
from studies.fits import baselines, coverage, draws, horizon, searches
from studies.fits.problem import SENSORS

Cells = tuple[str, ...]


def _searches(options: argparse.Namespace) -> Iterator[Cells]:
    yield searches.HEAD
    sensors, end_time = (["probes"], 0.03) if options.quick else (options.sensors, 0.1)
    for sensor in sensors:
        ways = ["at once"] if options.quick else searches.ways(sensor)
        yield from (row.cells() for row in searches.rows(sensor, ways, end_time))


def _baselines(options: argparse.Namespace) -> Iterator[Cells]:
    yield baselines.HEAD
    for row in baselines.rows(options.quick, options.starts):
        yield row.cells()


def _draws(options: argparse.Namespace) -> Iterator[Cells]:
    yield draws.HEAD
    sensors, end_time = (["probes"], 0.03) if options.quick else (options.sensors, 0.1)
    for sensor in sensors:
        if options.quick:
            trials = [draws.Trial("probes", "truth", "at once", 2)]
        else:
            trials = draws.trials(sensor, options.draws)
        yield from (found.cells() for found in draws.recoveries(sensor, trials, end_time))


def _coverage(options: argparse.Namespace) -> Iterator[Cells]:
    yield coverage.HEAD
    if options.quick:
        cases, number = [coverage.pins("rocker foot", 1.1, 0.03)], 2
    else:
        cases, number = [coverage.CASES[name]() for name in options.cases], options.draws
    for case in cases:
        yield coverage.cover(case, number).cells()


def _horizon(options: argparse.Namespace) -> Iterator[Cells]:
    predicted = horizon.predict(0.05 if options.quick else horizon.END)
    print(f"{predicted}\n")
    Output.of(__file__, options).save(horizon.figure(predicted), "horizon")
    lengths = () if options.quick else horizon.LENGTHS
    yield horizon.head(predicted, lengths)
    for row in horizon.rows(predicted, lengths):
        yield row.cells()


PARTS: dict[str, tuple[Callable[[argparse.Namespace], Iterator[Cells]], str]] = {
    "searches": (_searches, "the probes to 0.03 s"),
    "baselines": (_baselines, "two near starts, 0.03 s, without Exudyn"),
    "draws": (_draws, "two draws of the probes to 0.03 s"),
    "coverage": (_coverage, "two draws of the crank-rocker to 0.03 s"),
    "horizon": (_horizon, "a prediction for 0.05 s, without fits"),
}
"""Functions that yield the rows of each table, and the reduction by `--quick`."""


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Return the options of a command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parsers = parser.add_subparsers(dest="part", required=True)
    for name, (_, quick) in PARTS.items():
        part = parsers.add_parser(name)
        if name == "horizon":
            add_options(part, quick)
        else:
            part.add_argument("--quick", action="store_true", help=quick)
        if name in ("searches", "draws"):
            part.add_argument("--sensors", nargs="+", choices=SENSORS, default=list(SENSORS))
        if name in ("draws", "coverage"):
            part.add_argument("--draws", type=int, default=50)
        if name == "baselines":
            part.add_argument("--starts", type=int, default=10, help="near and far, each")
        if name == "coverage":
            cases = list(coverage.CASES)
            part.add_argument("--cases", nargs="+", choices=cases, default=cases)
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a part of the study, and print its table row by row."""
    options = parse(arguments)
    cj.configure()
    rows = PARTS[options.part][0](options)
    head = next(rows)
    print("| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|", flush=True)
    for row in rows:
        print("| " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
