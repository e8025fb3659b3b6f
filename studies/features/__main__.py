"""What each feature of a scene costs, and what it costs where it is absent: nothing.

    python -m studies.features [--quick] [--output results/features]

A ladder of scenes, each with one feature more: equations (and arithmetic operations) of the traced
right-hand side and of an attempted step, and their times in native loops, medians over rounds in
which all take turns. Each rung's program is traced a second time with the code of all features
above it missing (any call of it raises), and must be the same word by word.

Then planar scenes: the spatial program beside planar ones of the same motion, law and solver
(`studies.features.planar`), in single runs and with 64 lanes side by side.
"""

import argparse

import clearjoint as cj
from studies.common.output import Output, add_options
from studies.common.report import markdown
from studies.features.tables import figure, ladder, planar


def main(arguments: list[str] | None = None) -> None:
    """Measure, and print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    add_options(parser, "the first two rungs, few turns")
    options = parser.parse_args(arguments)
    cj.configure()
    rows, names, numbers = ladder(options.quick)
    print(markdown(rows), flush=True)
    if not options.quick:
        print("\n" + markdown(planar()))
    Output.of(__file__, options).save(figure(names, numbers), "features")


if __name__ == "__main__":
    main()
