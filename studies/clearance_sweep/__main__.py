"""Effect of the clearance on the paper's double pendulum.

    python -m studies.clearance_sweep sweep

map

limit [--quick] [--output FOLDER]

The double pendulum of P. Flores, J. Ambrosio, J. C. P. Claro and H. M. Lankarani, "Spatial revolute
joints with clearances for dynamic analysis of multi-body systems" (2006), section 6, is simulated
over its clearance, over clearance and restitution, and for clearances that tend to zero. Results
are stored during the run: an interrupted command continues, and a finished one only draws again.
`clearjoint.open_sweep` reads the stores.

Nothing drives the pendulum, so that no motion repeats: the figures show half a second of a decaying
transient. A stroboscopic section needs a period; the bifurcation diagram uses instead the section
of impact oscillators: a base at the wall that moves outward. Its coordinates are relative to the
speed and time of the first impact, sqrt(2 g c) and sqrt(2 c / g): a feature that does not depend on
the clearance is a horizontal line, and chaos a cloud.
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
