"""How far the program can be pushed before it says no.

    python -m studies.extremes [--quick] [--output FOLDER]

One number after the other is driven over its range where the answer is known in closed form, then
2100 random scenes have all of them at once. Each is right within a stated error, or refused with a
reason: a result code, or a `ValueError` before anything runs. None may be wrong.
"""

import argparse

import clearjoint as cj
from studies.common.output import Output, add_options
from studies.extremes.figure import drawn_map
from studies.extremes.findings import QUICK_SCENES, SCENES, SEED, find, report


def main(arguments: list[str] | None = None) -> None:
    """Run the study from a command line."""
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
