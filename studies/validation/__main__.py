"""Comparison with published results of other programs.

    python -m studies.validation [--quick] [--damper PATH [PATH...]] [--output FOLDER]

PATH is a record of ARTS-Laboratory/Dataset-Friction-Damper-with-Backlash, such as
`data/dataset-2/characterization datasets/0.5Hz30lbtension1amplitude.json`, of which none is
included here. Play, stiffness and friction are fitted to each record.
"""

import argparse
import warnings
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

import clearjoint as cj
from studies.common.output import Output, add_options
from studies.common.report import markdown
from studies.validation.benchmarks import benchmarks
from studies.validation.bounce import bounce, mujoco_orders
from studies.validation.chain import double_pendulum
from studies.validation.check import Check
from studies.validation.collision import collision
from studies.validation.damper import damper_figure, damper_table, fit_damper
from studies.validation.identification import bristle_friction, joint_friction, journal_friction
from studies.validation.modelica import Example, backlash, elasto_gap
from studies.validation.programs import has
from studies.validation.rigid_ball import rigid_ball
from studies.validation.siconos import Comparison, four_bar_checks


def table(checks: list[Check]) -> list[list[str]]:
    """Return the table of reference values as text."""
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
    return [["source", "quantity", "reference", "clearjoint", "relative difference"], *rows]


def convergence_table(linkage: Comparison) -> list[list[str]]:
    """Return the table of differences for each length of step as text."""
    rows = [
        [f"{step:.3g}", f"{difference:.1e}"]
        for step, difference in zip(linkage.steps, linkage.differences, strict=True)
    ]
    head = ["step, s", "largest difference of an angle, rad"]
    return [head, *rows, ["extrapolated to 0", f"{linkage.extrapolated:.1e}"]]


def figure(examples: list[Example], linkage: Comparison) -> Figure:
    """Draw the motions with the published times, and the linkage's differences against steps."""
    drawn, panels = plt.subplots(1, 3, figsize=(12.0, 3.4), layout="tight")
    labels = ("angle, rad", "position, m")
    for example, panel, label in zip(examples, panels[:2], labels, strict=True):
        motion = example.motion["position"]
        panel.plot(motion["time"], motion, color="0.2")
        times = [check.published for check in example.checks if check.unit == "s"]
        panel.plot(times, motion.interp(time=times), "o", label="published times")
        panel.set(title=example.name, xlabel="time, s", ylabel=label)
        panel.grid(alpha=0.3)
        panel.legend()
    last = panels[2]
    last.loglog(linkage.steps, linkage.differences, "o-", color="0.2", label="steps of this length")
    last.axhline(linkage.extrapolated, ls="--", label="extrapolated to step 0")
    label = "largest difference of an angle, rad"
    last.set(title="Siconos, four-bar linkage", xlabel="step, s", ylabel=label)
    last.grid(alpha=0.3)
    last.legend()
    return drawn


def main(arguments: list[str] | None = None) -> list[Check]:
    """Run the examples, print the table, draw, and return the checks."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    add_options(parser, "fewer steps in the linkage, and of the IFToMM benchmarks the first alone")
    parser.add_argument(
        "--damper", nargs="+", type=Path, default=[], metavar="PATH", help="measured records"
    )
    options = parser.parse_args(arguments)
    cj.configure()
    with warnings.catch_warnings():
        # A backlash of 45 degrees and springs of 10 N/m are unusual for joints of machines.
        warnings.simplefilter("ignore", cj.UnusualValueWarning)
        examples = [backlash(), elasto_gap()]
        checks = [*examples[0].checks, *examples[1].checks, *collision(), *bounce()]
    linkage = four_bar_checks(options.quick)
    checks += [*linkage.checks, *rigid_ball(options.quick), *benchmarks(options.quick)]
    checks += [*joint_friction(), *bristle_friction()]
    checks += [] if options.quick else journal_friction()
    checks += double_pendulum()
    print(markdown(table(checks)))
    print()
    print(markdown(convergence_table(linkage)))
    if has("mujoco"):
        height, velocity = mujoco_orders()
        print(f"\nOrder of MuJoCo's bounce: {height:.2f} (height), {velocity:.2f} (velocity)")
    output = Output.of(__file__, options)
    output.save(figure(examples, linkage), "validation")
    if options.damper:
        fits = [fit_damper(path) for path in options.damper]
        print()
        print(markdown(damper_table(fits)))
        output.save(damper_figure(fits), "damper")
    return checks


if __name__ == "__main__":
    main()
