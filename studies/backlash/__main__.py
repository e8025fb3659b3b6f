"""Backlash in clearjoint and by MuJoCo's recipe, compared with the exact motion.

    python -m studies.backlash [--quick] [--output results/backlash]

The shaft of a motor turns against a link with backlash. Nothing drives them, so that motion, energy
and the derivative by the backlash are known in closed form. A chain of links that falls shows how
MuJoCo's limits bear loads. Needs MuJoCo: pip install -e '.[mujoco]'.
"""

import argparse

import clearjoint as cj
from studies.backlash.figures import figure
from studies.backlash.trials import derivatives, limits, motions, rows
from studies.common.output import Output, add_options
from studies.common.report import markdown


def main(arguments: list[str] | None = None) -> None:
    """Run both programs, print the tables, and draw."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    add_options(parser, "few steps and tolerances")
    options = parser.parse_args(arguments)
    cj.configure()
    runs, slopes = motions(options.quick), derivatives(options.quick)
    print(markdown(rows(runs, "error of the angles, rad", "of the energy")))
    print("\n" + markdown(rows(slopes, "error of the derivative")))
    print("\n" + markdown(limits(options.quick)))
    Output.of(__file__, options).save(figure(runs, slopes), "backlash")


if __name__ == "__main__":
    main()
