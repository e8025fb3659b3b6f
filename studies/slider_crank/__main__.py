"""Driven slider-crank with clearance at the slider pin, compared with the ideal mechanism.

    python -m studies.slider_crank [--quick] [--output FOLDER]

    python -m studies.slider_crank sweep [--quick] [--output FOLDER]

The first command draws motion of the slider and moment on the crank over the crank angle, the orbit
of the journal, and Poincaré maps, and prints the closed-form values of the ideal mechanism and the
results. The second draws bifurcation diagrams: see `studies.slider_crank.sweep`.
"""

import argparse
import sys
from typing import Any

import clearjoint as cj
from studies.common.output import Output, add_options
from studies.slider_crank import sweep
from studies.slider_crank.runs import SHOWN, Settings, run

FIELDS = ("clearance", "restitution", "revolutions_a_minute", "revolutions", "rtol")


def parse(arguments: list[str] | None = None) -> tuple[Settings, Output]:
    """Return settings and output of a command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--clearance", type=float, help="radial, m")
    parser.add_argument("--restitution", type=float)
    parser.add_argument("--rpm", dest="revolutions_a_minute", type=float, help="crank speed, 1/min")
    parser.add_argument("--revolutions", type=int, help="of the crank; the last two are drawn")
    parser.add_argument("--rtol", type=float, help="relative tolerance of a step")
    add_options(parser, "three revolutions, small pictures")
    options = parser.parse_args(arguments)
    given: dict[str, Any] = {k: v for k in FIELDS if (v := getattr(options, k)) is not None}
    if options.quick:
        given.setdefault("revolutions", 3)
    settings = Settings(**given)
    if settings.revolutions <= SHOWN:
        parser.error(f"--revolutions must be more than the {SHOWN} that are drawn")
    return settings, Output.of(__file__, options)


def main_of_sweep(arguments: list[str]) -> None:
    """Run the sweeps, and print the findings."""
    parser = argparse.ArgumentParser(
        prog="slider_crank sweep", description=(sweep.__doc__ or "").partition("\n")[0]
    )
    add_options(parser, "few lanes and revolutions")
    output = Output.of(__file__, parser.parse_args(arguments))
    cj.configure()
    try:
        lines = sweep.run(output)
    except ValueError as error:
        raise SystemExit(f"error: {error}") from error
    print("\n".join(f"- {line}" for line in lines))
    print(f"Figures and stores: {output.folder}")


def main(arguments: list[str] | None = None) -> None:
    """Run the study."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if arguments[:1] == ["sweep"]:
        main_of_sweep(arguments[1:])
        return
    settings, output = parse(arguments)
    cj.configure()
    print(run(settings, output).table)
    print(f"Figures in {output.folder}")


if __name__ == "__main__":
    main()
