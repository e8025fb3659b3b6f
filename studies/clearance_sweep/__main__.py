"""What the size of the clearance does to the paper's double pendulum.

The double pendulum of P. Flores, J. Ambrosio, J. C. P. Claro and H. M. Lankarani, "Spatial revolute
joints with clearances for dynamic analysis of multi-body systems" (2006), section 6, over its
clearance, over clearance and restitution, and towards no clearance at all:

    python -m studies.clearance_sweep sweep | map | limit [--quick] [--output FOLDER]

Results are stored as they come: a command that was interrupted continues, and one that was finished
only draws again. `clearjoint.open_sweep` reads the stores.

Nothing drives the pendulum, so that no motion repeats: what is drawn is half a second of a decaying
transient. In place of a stroboscopic section, which needs a period, the bifurcation diagram takes
the section of impact oscillators: a base at the wall, on its way in. Its coordinates are in units
of the first impact's speed and time, sqrt(2 g c) and sqrt(2 c / g); a feature that does not
depend on the clearance is a level line in it, and chaos a cloud.
"""

import argparse
from collections.abc import Callable

import clearjoint as cj
from studies.clearance_sweep.limit import limit
from studies.clearance_sweep.sweeps import restitution_map, sweep
from studies.common.output import Output, add_options

COMMANDS: dict[str, Callable[[Output], list[str]]] = {
    "sweep": sweep,
    "map": restitution_map,
    "limit": limit,
}


def main(arguments: list[str] | None = None) -> None:
    """Run one command, and print its findings."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("command", choices=COMMANDS)
    add_options(parser, "few lanes and coarse pictures")
    options = parser.parse_args(arguments)
    output = Output.of(__file__, options)
    cj.configure()
    try:
        findings = COMMANDS[options.command](output)
    except ValueError as error:
        raise SystemExit(f"error: {error}") from error
    print("\n".join(f"- {line}" for line in findings))
    print(f"Figures and stores: {output.folder}")


if __name__ == "__main__":
    main()
