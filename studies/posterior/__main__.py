"""Coverage of 95 % intervals of posteriors, from far guesses.

    python -m studies.posterior [--cases NAME...] [--draws 50] [--number 500] [--quick]
    python -m studies.posterior --exact [--cases NAME...] [--draws 1000] [--number 5000]
    python -m studies.posterior --fits [--cases NAME...] [--draws 10]

The row of each case is printed as it is found. Draws are kept in `draws.jsonl` in the output
folder, so that an interrupted study continues; remove the file to begin again. The figure has the
intervals of all draws. With `--exact`, `--number` runs around the truth give the posteriors of all
draws, and the exact probability in the intervals of draws in the file. With `--fits`, the intervals
are those of `cj.identify`.
"""

import argparse
from collections.abc import Sequence

import clearjoint as cj
from studies.common.output import Output, add_options
from studies.posterior import exact, fits
from studies.posterior.cases import CASES
from studies.posterior.draws import HEAD, cells, cover, figure, kept


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Return the options of a command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    add_options(parser, "one draw of the backlash with 32 points")
    parser.add_argument("--cases", nargs="+", choices=list(CASES), default=list(CASES))
    parser.add_argument("--draws", type=int, help="50; with --exact 1000")
    parser.add_argument("--number", type=int, help="500 points; with --exact 5000 runs")
    parser.add_argument("--exact", action="store_true", help="intervals of the exact posterior")
    parser.add_argument("--fits", action="store_true", help="intervals of fits, crank-rocker only")
    options = parser.parse_args(arguments)
    options.draws = options.draws or (1000 if options.exact else 50)
    options.number = options.number or (5000 if options.exact else 500)
    return options


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, and save the figure."""
    options = parse(arguments)
    cj.configure()
    if options.quick:
        options.cases, options.draws, options.number = ["backlash"], 1, 32
    head = exact.HEAD if options.exact else fits.HEAD if options.fits else HEAD
    print("| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|", flush=True)
    if options.exact:
        for name in options.cases:
            file = Output.of(__file__, options).file("draws.jsonl")
            same = [one for one in kept(file) if one.name == name]
            row = exact.cover(CASES[name](), options.number, options.draws, same)
            print("| " + " | ".join(row) + " |", flush=True)
        return
    if options.fits:
        for name in (one for one in options.cases if one in fits.CASES):
            row = fits.cover(fits.CASES[name](), options.draws)
            print("| " + " | ".join(row) + " |", flush=True)
        return
    output, found = Output.of(__file__, options), []
    for name in options.cases:
        draws = cover(name, CASES[name], options.draws, options.number, output.file("draws.jsonl"))
        print("| " + " | ".join(cells(draws)) + " |", flush=True)
        found.append(draws)
    output.save(figure(found), "posterior")


if __name__ == "__main__":
    main()
