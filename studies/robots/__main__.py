"""Robots: which files can be loaded, and what logs tell of joints.

python -m studies.robots [PART] [--files FOLDER] [--quick], where PART is files, servo, logs or arm
"""

import argparse
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from studies.common.output import Output, run_parts
from studies.common.report import markdown
from studies.robots import arm, files, logs, servo_joint

HERE = Path(__file__).resolve().parent


def files_part(folder: Path, output: Output) -> list[str]:
    """Return the tables of the URDF and MJCF files in a folder."""
    rows = files.survey(folder)
    tables = [("robots' files", ""), *files.counts(rows)], files.table(rows)
    return [f"\n{markdown(table)}" for table in tables[: 1 if output.quick else None]]


def servo_part(output: Output) -> list[str]:
    """Return the table of fits to the log of a servo; draw the first one."""
    rows, first = servo_joint.measure(output.quick)
    output.save(servo_joint.figure(first), "servo")
    return [f"\n{markdown(rows)}"]


def logs_part(folder: Path, output: Output) -> list[str]:
    """Return the tables of public logs; draw positions that were not fitted."""
    if output.quick:
        return [f"logs of {', '.join(logs.COLLECTIONS)} take minutes: run without --quick"]
    tables, shown = logs.measure(folder)
    if shown:
        output.save(logs.figure(shown), "logs")
    return [f"\n{markdown(table)}" for table in tables]


def arm_part(output: Output) -> list[str]:
    """Return the tables of fits of an arm with play in all joints; draw the first one."""
    tables, first = arm.measure(output.quick)
    output.save(arm.figure(first), "arm")
    return [f"\n{markdown(table)}" for table in tables]


def main(arguments: Sequence[str] | None = None) -> list[str]:
    """Run the parts that the command line names."""
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--files", type=Path, default=HERE)
    options, others = parser.parse_known_args(arguments)
    parts = {"files": partial(files_part, options.files), "servo": servo_part}
    parts |= {"logs": partial(logs_part, options.files), "arm": arm_part}
    return run_parts(__file__, __doc__, parts, "short logs of one joint", others)


if __name__ == "__main__":
    main()
