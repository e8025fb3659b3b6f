"""The largest clearance at which a slider-crank keeps its tolerances.

    python -m studies.tolerance_design [--quick] [--output FOLDER]

The slider's pin may have as much clearance as leaves the slider within a tolerance of the ideal
mechanism's position, and the pin force within a limit. `clearjoint.largest` finds the largest with
which all smaller ones hold, too.

There are two questions. When the machine starts, at full speed and with the pin in the middle of
its bearing, the play is taken up in one impact, which makes the peaks: their margins are smooth.
After a transient, at a speed at which the journal keeps to the wall, it still vibrates there, and
the phase of that makes the margins uneven. Where the journal strikes, small differences grow from
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
    print("\n".join(f"- {line}" for line in run(output)))
    print(f"Figures: {output.folder}")


if __name__ == "__main__":
    main()
