"""Measured bouncing balls: restitution over impact speed, and simulated bounces.

    python -m studies.real_bounces PATH [PATH...] [--output FOLDER] [--quick]

PATH is the folder `Coefficient_of_restitution` of giiulia/LabI-Dynamics-Thermodynamics, or its
files `Method1/data.py` (drop and rebound heights) and `Method2/data.py` (intervals between the
sounds of impacts, in steps of 1/48000 s). That repository states no licence, so its data are not
included here.

The restitution of an impact between two flights is the launch speed of the second over the landing
speed of the first. Without air both are g/2 times the interval. With drag a light ball lands slower
than it was launched, and the quotient of intervals is too low at high speed. The data lack mass and
diameter, which drag needs: the study uses the nominal ones of the sports' rules, a drag coefficient
of 0.47, and no drag for the ball without rules.
"""

import argparse
from pathlib import Path

import clearjoint as cj
from studies.common.output import Output, add_options
from studies.real_bounces.bounce_files import read_balls
from studies.real_bounces.throws import (
    chain_figure,
    chain_table,
    chains,
    fit_table,
    request_table,
    restitution_figure,
    study,
)


def main(arguments: list[str] | None = None) -> None:
    """Fit, simulate, print the tables, and draw."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("paths", nargs="+", type=Path, metavar="PATH")
    add_options(parser, "one throw a series simulated")
    options = parser.parse_args(arguments)
    cj.configure()
    balls = read_balls(options.paths)
    studies = [study(measured) for measured in balls.values() if measured.series]
    for measured in balls.values():
        if not measured.series:
            print(f"ball {measured.number} has no intervals and is left out")
    output = Output.of(__file__, options)
    print(fit_table(studies))
    print(request_table(studies))
    simulated = [list(chains(studied, options.quick)) for studied in studies]
    print(chain_table(studies, simulated))
    for studied in studies:
        for line in studied.points.left_out:
            print(f"{studied.ball.name}, left out: {line}")
    output.save(restitution_figure(studies), "restitution")
    output.save(chain_figure(studies, simulated), "intervals")


if __name__ == "__main__":
    main()
