"""Parameters of the double pendulum recovered from many draws of a sensor's noise.

    python -m studies.recovery [--draws 50] [--sensors NAME...] [--quick]
    python -m studies.recovery coverage [--draws 50] [--cases NAME...] [--quick]

The problem and the starts of `studies.identification`, each draw fitted anew from the far starts,
in the ways of that study. If the estimates are as good as the data allow, they scatter as the
Cramér-Rao bound says, their mean is off by no more than its own error, and 95 of 100 intervals hold
the truth. The camera is fitted from the truth as well, so that draws in which a lower minimum lies
elsewhere are known: no fit can tell in them which one is right. ``--quick`` fits two draws of the
probes to 0.03 s from the truth.

The second asks how often intervals hold the truth where chi squared is rough: by the covariance at
the minimum in which a search ended, and by the runs around it that `clearjoint.identify` makes. The
scenes are a crank-rocker with clearance in one of its pins and the double pendulum, fitted from far
starts. ``--quick`` makes two draws of the crank-rocker to 0.03 s.
"""

import argparse
import sys
from collections.abc import Sequence

import clearjoint as cj
from studies.common.identification_problem import (
    PARAMETERS,
    SENSORS,
    STARTS,
    TRUTH,
    fit,
    ideal,
)
from studies.recovery import coverage
from studies.recovery.draws import HEADINGS, lower, recovery, row

STIFF, SOFT = STARTS
WAYS = (
    ("probes", STIFF, "windows", 1.0),
    ("probes", SOFT, "windows", 4.0),
    ("accelerometers", STIFF, "velocities first", 1.0),
    ("accelerometers", SOFT, "velocities first", 1.0),
    ("accelerometers", STIFF, "screened", 1.0),
    ("accelerometers", SOFT, "screened", 1.0),
    ("camera", "truth", "at once", 1.0),
    ("camera", SOFT, "windows", 1.0),
    ("camera", STIFF, "windows", 0.1),
    ("camera", STIFF, "windows, 12 starts", 0.04),
    ("camera", STIFF, "screened", 1.0),
    ("camera", SOFT, "screened", 1.0),
)
"""Sensor, start, way to fit, and how many times the draws are fitted so: 50 draws leave the scatter
uncertain by a tenth, and starts cost runs."""


def study(sensor: str, ways: Sequence[tuple[str, str, int]], end_time: float) -> None:
    """Print the bounds of a sensor and a row for each start, way and number of draws."""
    clean, bounds = ideal(sensor, end_time)
    fit(clean, TRUTH, "at once", end_time)  # compiles
    slopes = {n: p.scale.slope(p.scale.coordinate(TRUTH[n])) for n, p in PARAMETERS.items()}
    parts = (f"{name} {bounds[name] * slopes[name] / TRUTH[name]:.2g}" for name in TRUTH)
    print(f"{sensor} to {end_time} s; relative Cramér-Rao bounds: {', '.join(parts)}")
    print("| " + " | ".join(HEADINGS) + " |\n" + "|---" * len(HEADINGS) + "|")
    nearest = None
    for start, how, draws in ways:
        guess = STARTS.get(start, TRUTH)
        found = recovery(clean, bounds, guess, how, draws, end_time)
        print(row(f"{sensor}, {start}, {how}", found), flush=True)
        if start == "truth":
            nearest = found
        elif nearest is not None and how == "screened":
            print(lower(found, nearest), flush=True)


def main_of_coverage(arguments: Sequence[str]) -> None:
    """Print the table of coverage."""
    parser = argparse.ArgumentParser(
        prog="recovery coverage", description=(coverage.__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("--quick", action="store_true", help="two draws to 0.03 s")
    parser.add_argument("--draws", type=int, default=50)
    names = list(coverage.CASES)
    parser.add_argument("--cases", nargs="+", choices=names, default=names)
    options = parser.parse_args(arguments)
    cj.configure()
    if options.quick:
        coverage.table([coverage.pins("rocker foot", 1.1, 0.03)], 2)
        return
    coverage.table([coverage.CASES[name]() for name in options.cases], options.draws)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if arguments[:1] == ["coverage"]:
        main_of_coverage(arguments[1:])
        return
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="two draws of the probes to 0.03 s")
    parser.add_argument("--draws", type=int, default=50)
    parser.add_argument("--sensors", nargs="+", choices=SENSORS, default=list(SENSORS))
    options = parser.parse_args(arguments)
    cj.configure()
    if options.quick:
        study("probes", [("truth", "at once", 2)], 0.03)
        return
    for sensor in options.sensors:
        chosen = [(s, how, part) for name, s, how, part in WAYS if name == sensor]
        ways = [(s, how, max(2, round(part * options.draws))) for s, how, part in chosen]
        study(sensor, ways, 0.1)


if __name__ == "__main__":
    main()
