"""Absolute and joint coordinates side by side: what they cost, and how well ideal joints hold.

    python -m studies.coordinates [--quick]

Operations are those of floating point in a compiled right-hand side alone, by XLA's own count, in
which parts that were fused twice count twice. The time is that of a whole call of `simulate` at
rtol 1e-9, the least of three after one that compiles. The drift is the largest residual of a
row of the ideal joints (m or rad, and its rate), over the run, at the instants saved. Both default
to Baumgarte's stabilisation, which joint coordinates need for drivers and closed loops alone.
"""

import argparse

import clearjoint as cj
from studies.coordinates.table import IDEAL, MECHANISMS, table


def main(arguments: list[str] | None = None) -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="the ideal double pendulum alone")
    quick = parser.parse_args(arguments).quick
    cj.configure()
    print(table((IDEAL,) if quick else MECHANISMS))


if __name__ == "__main__":
    main()
