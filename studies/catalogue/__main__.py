"""Every entry of the catalogue compared with an independent result.

    python -m studies.catalogue [--quick] [--output FOLDER]

Prints the tables of the README, draws the families that no other study draws, and ends with an
error if an entry is further off than allowed.
"""

import argparse
from types import ModuleType

import clearjoint as cj
from studies.catalogue import (
    cylinders,
    films,
    frictions,
    joints,
    laws,
    mechanisms,
    mechanisms_with_play,
    plays,
)
from studies.catalogue.check import HEAD, Check
from studies.common.output import Output, add_options
from studies.common.report import markdown

FAMILIES: dict[str, ModuleType] = {
    "Normal laws": laws,
    "Line contact": cylinders,
    "Friction": frictions,
    "Films": films,
    "Clearance joints": plays,
    "Ideal joints and elements": joints,
    "Mechanisms": mechanisms,
    "Mechanisms with clearance": mechanisms_with_play,
}
"""Modules that check the families, and draw those with a function `figure`."""


def main(arguments: list[str] | None = None) -> None:
    """Print the tables, and draw."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    add_options(parser, "few of the checks that integrate, and no figures")
    options = parser.parse_args(arguments)
    cj.configure()
    output = Output.of(__file__, options)
    rows: list[Check] = []
    for name, family in FAMILIES.items():
        found: list[Check] = family.checks(options.quick)
        print(f"\n## {name}\n\n" + markdown([HEAD, *(row.cells() for row in found)]))
        rows += found
        if hasattr(family, "figure") and not options.quick:
            output.save(family.figure(), family.__name__.rpartition(".")[2])
    wrong = [row.entry for row in rows if not row.holds]
    print(f"\n{len(rows) - len(wrong)} of {len(rows)} hold")
    if wrong:
        raise SystemExit(f"further off than allowed: {', '.join(wrong)}")


if __name__ == "__main__":
    main()
