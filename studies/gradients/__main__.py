"""Gradients in reverse mode across impacts: accuracy, cost, and fits of many numbers.

python -m studies.gradients [PART] [--quick], where PART is accuracy, joints, memory, lanes,
friction, wall or torque
"""

from collections.abc import Sequence

from studies.common.output import Output, run_parts
from studies.common.report import markdown
from studies.gradients import accuracy, friction, joints, lanes, memory, torque, wall
from studies.gradients.searches import search_table


def accuracy_part(output: Output) -> list[str]:
    """Return the table of errors and costs by the number of parameters."""
    return [f"\n{markdown(accuracy.table(accuracy.measure(output.quick)))}"]


def joints_part(output: Output) -> list[str]:
    """Return the table of thirty joints with backlash."""
    heading = "thirty joints with backlash", ""
    return [f"\n{markdown([heading, *joints.table(output.quick)])}"]


def memory_part(output: Output) -> list[str]:
    """Return the tables of long runs and of first gradients."""
    tables = memory.long_run(output.quick), memory.firsts(output.quick)
    return [f"\n{markdown(table)}" for table in tables]


def lanes_part(output: Output) -> list[str]:
    """Return the table of batches of gradients."""
    return [f"\n{markdown(lanes.table(lanes.measure(output.quick)))}"]


def friction_part(output: Output) -> list[str]:
    """Fit a friction law, draw it, and return the table."""
    fit = friction.measure(output.quick)
    output.save(friction.figure(fit), "friction")
    return [f"\n{markdown([('friction law', ''), *friction.table(fit)])}"]


def wall_part(output: Output) -> list[str]:
    """Fit the wall of a worn bearing, draw it, and return the tables."""
    fitted = wall.measure(output.quick)
    output.save(wall.figure(fitted), "wall")
    tables = wall.table(fitted), search_table({"wall": fitted.search})
    return [f"\n{markdown(table)}" for table in tables]


def torque_part(output: Output) -> list[str]:
    """Search a torque, draw it, and return the tables."""
    improved = torque.measure(output.quick)
    output.save(torque.figure(improved), "torque")
    tables = torque.table(improved), search_table({"torque": improved.search})
    return [f"\n{markdown(table)}" for table in tables]


PARTS = {
    "accuracy": accuracy_part,
    "joints": joints_part,
    "memory": memory_part,
    "lanes": lanes_part,
    "friction": friction_part,
    "wall": wall_part,
    "torque": torque_part,
}


def main(arguments: Sequence[str] | None = None) -> list[str]:
    """Run the parts that the command line names."""
    return run_parts(__file__, __doc__, PARTS, "one row of each table", arguments)


if __name__ == "__main__":
    main()
