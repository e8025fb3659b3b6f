"""Cost of accuracy: work-precision diagrams of solvers, tolerances, landing and laws.

    python -m studies.speed_accuracy [PART] [--quick] [--output FOLDER]

Parts: `diagrams` (solvers, tolerances, landing), `presets` (forces and first calls), `variants`
(stabilisation, entry speed, smoothing, precision), `statistics` (of long runs) and `gradients`;
without a name all parts run.

All runs are of the paper's double pendulum, 0.5 mm, restitution 0.9. Errors are against the
extended-precision reference in `tests/data/reference`. The number of right-hand sides of explicit
methods follows from the tableau (a test counts them); those of implicit methods are counted. Times
are processor times of a whole call of `simulate` that saves 51 states. Explicit runs end at 1.5
million attempts, implicit ones at 60 000.
"""

import argparse

import clearjoint as cj
from studies.common.output import Output, add_options
from studies.speed_accuracy.gradients import gradients
from studies.speed_accuracy.parts import diagrams, variants
from studies.speed_accuracy.preset_table import presets
from studies.speed_accuracy.runs import FULL, QUICK
from studies.speed_accuracy.statistics import statistics

PARTS = {
    "diagrams": diagrams,
    "presets": presets,
    "variants": variants,
    "statistics": statistics,
    "gradients": gradients,
}


def main(arguments: list[str] | None = None) -> None:
    """Run a part of the study, print its tables and write its figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("part", nargs="?", choices=[*PARTS, "all"], default="all")
    add_options(parser, "short runs; diagrams of one solver only")
    options = parser.parse_args(arguments)
    cj.configure()
    output = Output.of(__file__, options)
    spans = QUICK if options.quick else FULL
    whole = ["diagrams"] if options.quick else list(PARTS)
    for name in whole if options.part == "all" else [options.part]:
        for lines in PARTS[name](output, spans):
            print(lines, flush=True)
    print(f"Figures: {output.folder}")


if __name__ == "__main__":
    main()
