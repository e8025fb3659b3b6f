"""The largest clearance at which a slider-crank keeps its tolerances, by gradient.

    python -m studies.tolerance_design [--quick] [--output FOLDER]

The slider's pin may have as much clearance as leaves the slider within a tolerance of the ideal
mechanism's position, and the pin force within a limit. The margins of both peaks come with their
derivatives (`clearjoint.sensitivities`), and Newton's method finds where the smaller one is zero;
bisection and Brent's method on the same margins are counted beside it. The margins over a range of
clearances then tell whether all smaller ones hold; if not, the search begins anew below the first
that does not.

There are two questions. When the machine starts, at full speed and with the pin in the middle of
its bearing, the play is taken up in one impact, which makes the peaks: their margins are smooth.
After a transient, at a speed at which the journal keeps to the wall, the motion has forgotten its
start, and so have the derivatives; but the journal still vibrates on the wall, and the phase of
that makes the margins uneven. Where it strikes, small differences grow from revolution to
revolution, and derivatives with them: correct, and of no use.
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
    print("\n".join(f"- {line}" for line in run(output)))
    print(f"Figures: {output.folder}")


if __name__ == "__main__":
    main()
