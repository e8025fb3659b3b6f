"""Statistics of a slider-crank past its predictability horizon.

    python -m studies.statistics [ensemble|derivatives|sensitivity] [--quick] [--output FOLDER]

Without a part all three run: the spread of forces and the Lyapunov exponent over the clearance,
derivatives of mean forces by the nominal clearance compared with differences of large ensembles,
and the parameters that drive the peak force.
"""

from collections.abc import Callable

from studies.common.output import Output, run_parts
from studies.statistics import parts

PARTS: dict[str, Callable[[Output], list[str]]] = {
    "ensemble": parts.ensemble,
    "derivatives": parts.derivatives,
    "sensitivity": parts.sensitivity,
}


def main(arguments: list[str] | None = None) -> list[str]:
    """Run the study, print its findings, and return them."""
    return run_parts(__file__, __doc__, PARTS, "small ensembles", arguments)


if __name__ == "__main__":
    main()
