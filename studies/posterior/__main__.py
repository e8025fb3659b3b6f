"""Coverage of 95 % intervals of posteriors, from far guesses.

    python -m studies.posterior [--cases NAME...] [--draws 50] [--number 300] [--quick]
    python -m studies.posterior --fits [--cases NAME...] [--draws 10]

The row of each case is printed as it is found; the figure has the points of the last case. With
`--fits`, the intervals are those of `cj.identify`.
"""

import argparse
from collections.abc import Sequence

import clearjoint as cj
from studies.common.output import Output, add_options
from studies.posterior import fits
from studies.posterior.cases import CASES
from studies.posterior.draws import HEAD, cover, figure


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Return the options of a command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    add_options(parser, "one draw of the backlash with 64 points")
    parser.add_argument("--cases", nargs="+", choices=list(CASES), default=list(CASES))
    parser.add_argument("--draws", type=int, default=50)
    parser.add_argument("--number", type=int, default=300, help="points of each posterior")
    parser.add_argument("--fits", action="store_true", help="intervals of fits, crank-rocker only")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, and save the figure."""
    options = parse(arguments)
    cj.configure()
    if options.quick:
        options.cases, options.draws, options.number = ["backlash"], 1, 64
    head = fits.HEAD if options.fits else HEAD
    print("| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|", flush=True)
    if options.fits:
        for name in (one for one in options.cases if one in fits.CASES):
            row = fits.cover(fits.CASES[name](), options.draws)
            print("| " + " | ".join(row) + " |", flush=True)
        return
    for name in options.cases:
        row = cover(CASES[name](), options.draws, options.number)
        print("| " + " | ".join(row.cells()) + " |", flush=True)
        Output.of(__file__, options).save(figure(row), "posterior")


if __name__ == "__main__":
    main()
