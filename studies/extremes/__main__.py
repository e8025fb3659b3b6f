"""Tested ranges of the numbers of a scene: each result is right or refused.

    python -m studies.extremes [--quick] [--output FOLDER]

The study varies one number at a time where the answer is known in closed form, then simulates 2100
random scenes that vary all numbers together. Each result must be right within a stated error, or
refused by a result code or by a `ValueError` before the run.
"""

import argparse

import clearjoint as cj
from studies.common.output import Output, add_options
from studies.extremes.figure import drawn_map
from studies.extremes.findings import QUICK_SCENES, SCENES, SEED, find, report


def main(arguments: list[str] | None = None) -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    add_options(parser, "one family and some dozen scenes")
    parser.add_argument("--scenes", type=int, help=f"random ones a family; {SCENES}")
    parser.add_argument("--seed", type=int, default=SEED)
    options = parser.parse_args(arguments)
    cj.configure()
    scenes = options.scenes or (QUICK_SCENES if options.quick else SCENES)
    findings = find(options.quick, scenes, options.seed)
    print(report(findings))
    output = Output.of(__file__, options)
    output.save(drawn_map(findings.rows, findings.batches), "extremes")
    print(f"Map: {output.folder}")
    if findings.wrong():
        raise SystemExit("error: some numbers are wrong, see above")


if __name__ == "__main__":
    main()
