"""A day of a pendulum's motion, or a hundred million steps: what drifts, and what memory it takes.

    python -m studies.endurance [--quick] [--output results/endurance]

A rod of 1 m and 1 kg falls from the horizontal, on an ideal pin and on one with clearance; a top
spins freely. Each run is a single call of `simulate` at rtol 1e-4, of 24 h or 1e8 steps, whichever
comes first; ideal pendulums run at tighter tolerances too, since at 1e-4 their energy doesn't last.

Residuals are the largest of the ideal joints' rows (m and rad) in the first and in the last quarter
of the run; norms those of the Euler parameters at any saved instant. Energy is what mechanical
energy and ledger don't account for at the end, in parts of what the fall to the lowest point gives,
or of the top's. The process's memory is sampled every half second.

Then 0.1 s of the double pendulum, begun at time zero and after 24 h: what of a step of a
microsecond is lost when it is added to 86 400 s.
"""

import argparse

import clearjoint as cj
from studies.common.output import Output, add_options
from studies.common.report import markdown
from studies.endurance.runs import CASES, COLUMNS, DAY, MOST_STEPS, figure, late_start, row, run

QUICK = (CASES[0], CASES[8])


def main(arguments: list[str] | None = None) -> None:
    """Run the cases, and print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    add_options(parser, "a minute of two of the runs")
    options = parser.parse_args(arguments)
    cj.configure()
    cases, span = (QUICK, 60.0) if options.quick else (CASES, DAY)
    outcomes = [run(case, span, MOST_STEPS) for case in cases]
    print(markdown([COLUMNS, *map(row, outcomes)]))
    if not options.quick:
        print("\n" + markdown(late_start()))
    Output.of(__file__, options).save(figure(outcomes), "endurance")


if __name__ == "__main__":
    main()
