"""Measured free swings of a pendulum: length and friction.

    python -m studies.real_pendulum PATH [PATH...] [--output FOLDER] [--quick]

The first swing is fitted with viscous friction, Coulomb friction, quadratic friction, and
combinations of these. All others (further swings of the same file, and of further files) test the
estimates: only their start and vertical are fitted. Files of three repositories are read, which are
not included here:

- dynamicslab/MultiArm-Pendulum (MIT), folders `ParameterEstimation/SinglePendulum` and
  `Datas/SinglePendulum`: a bench pendulum with an optical encoder, 1 or 10 kHz;
- jensen-benard/rotary-inverted-pendulum (MIT), folder
  `software/modelling/experiment/damping_coefficient`: three swings of a small one, 1 kHz;
- erwincoumans/tiny-differentiable-simulator (Apache-2.0), folder `data/schmidt-lipson-exp-data`:
  `real_pend_h_1.txt` of M. Schmidt and H. Lipson 2009, by motion tracking, unit of time unknown.
"""

import argparse
from pathlib import Path

import clearjoint as cj
from studies.common.output import Output, add_options
from studies.real_pendulum.fits import error_table, figure, prepared, study, table


def main(arguments: list[str] | None = None) -> None:
    """Fit, test, print the tables, and draw."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("paths", nargs="+", type=Path, metavar="PATH")
    add_options(parser, "eight periods of each swing")
    options = parser.parse_args(arguments)
    cj.configure()
    swings = [swing for path in options.paths for swing in prepared(path, options.quick)]
    fitted = study(swings)
    print(table(fitted))
    print(error_table(fitted))
    print(fitted.identified)
    Output.of(__file__, options).save(figure(fitted), "swings")


if __name__ == "__main__":
    main()
