"""Statistics of a slider-crank past its predictability horizon.

    python -m studies.statistics [ensemble|derivatives|sensitivity] [--quick] [--output FOLDER]

Without a part all three run: the spread of forces and the Lyapunov exponent over the clearance,
derivatives of mean forces by the nominal clearance compared with differences of large ensembles,
and the parameters that drive the peak force.
"""

import argparse
from collections.abc import Callable

import clearjoint as cj
from studies.common.output import Output, add_options
from studies.statistics import parts

PARTS: dict[str, Callable[[Output], list[str]]] = {
    "ensemble": parts.ensemble,
    "derivatives": parts.derivatives,
    "sensitivity": parts.sensitivity,
}


def main(arguments: list[str] | None = None) -> list[str]:
    """Run the study, print its findings, and return them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("part", nargs="?", choices=list(PARTS), help="by default all")
    add_options(parser, "small ensembles")
    options = parser.parse_args(arguments)
    cj.configure()
    output = Output.of(__file__, options)
    names = list(PARTS) if options.part is None else [options.part]
    lines = [line for name in names for line in PARTS[name](output)]
    print("\n".join(f"- {line}" for line in lines), flush=True)
    print(f"Figures: {output.folder}")
    return lines


if __name__ == "__main__":
    main()
