"""Largest clearance with which a slider-crank keeps its tolerances.

    python -m studies.tolerance_design [--quick] [--output FOLDER]

The slider must stay within a tolerance of its ideal position, and the pin force within a limit.
`clearjoint.largest_feasible` finds the largest clearance for which all smaller ones comply too.

There are two questions. When the machine starts at full speed with a centred pin, the clearance is
crossed in one impact, which causes the peaks: their margins are smooth. After a transient, at a
speed at which the journal stays on the wall, it still vibrates, and the phase of the vibration
makes the margins uneven. Where the journal strikes repeatedly, small differences grow from
revolution to revolution, and derivatives with them.
"""

import argparse

import clearjoint as cj
from studies.common.output import Output, add_options
from studies.tolerance_design.findings import run


def main(arguments: list[str] | None = None) -> None:
    """Run the study, and print its findings."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    add_options(parser, "the first question only, few clearances")
    options = parser.parse_args(arguments)
    cj.configure()
    output = Output.of(__file__, options)
    print("\n".join(f"- {line}" for line in run(output).lines()))
    print(f"Figures: {output.folder}")


if __name__ == "__main__":
    main()
