"""Comparison with published results of other programs.

python -m studies.validation [--quick] [--output results/validation]
"""

import argparse
import warnings

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

import clearjoint as cj
from studies.common.output import Output, add_options
from studies.common.report import markdown
from studies.validation.check import Check
from studies.validation.collision import collision
from studies.validation.modelica import Example, backlash, elasto_gap


def table(checks: list[Check]) -> list[list[str]]:
    """Return the table of published values as text."""
    rows = [
        [
            check.source,
            check.name,
            f"{check.published:.10g} {check.unit}".strip(),
            f"{check.ours:.10g} {check.unit}".strip(),
            f"{check.difference:.0e}",
        ]
        for check in checks
    ]
    return [["source", "quantity", "published", "clearjoint", "relative difference"], *rows]


def figure(examples: list[Example]) -> Figure:
    """Draw the motions, with the published times."""
    drawn, panels = plt.subplots(1, len(examples), figsize=(9.0, 3.4), layout="tight")
    for example, panel, label in zip(examples, panels, ("angle, rad", "position, m"), strict=True):
        motion = example.motion["position"]
        panel.plot(motion["time"], motion, color="0.2")
        times = [check.published for check in example.checks if check.unit == "s"]
        panel.plot(times, motion.interp(time=times), "o", label="published times")
        panel.set(title=example.name, xlabel="time, s", ylabel=label)
        panel.grid(alpha=0.3)
        panel.legend()
    return drawn


def main(arguments: list[str] | None = None) -> list[Check]:
    """Run the examples, print the table, draw, and return the checks."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    add_options(parser, "the same: it takes seconds")
    options = parser.parse_args(arguments)
    cj.configure()
    with warnings.catch_warnings():
        # A backlash of 45 degrees and a spring of 10 N/m are unusual for joints of machines.
        warnings.simplefilter("ignore", cj.UnusualValueWarning)
        examples = [backlash(), elasto_gap()]
        checks = [*examples[0].checks, *examples[1].checks, *collision()]
    print(markdown(table(checks)))
    Output.of(__file__, options).save(figure(examples), "validation")
    return checks


if __name__ == "__main__":
    main()
