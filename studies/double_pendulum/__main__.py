"""The paper's double pendulum with a clearance joint, compared with an ideal joint.

    python -m studies.double_pendulum [--quick] [--output FOLDER]

Draws figures 13 to 17 of P. Flores, J. Ambrosio, J. C. P. Claro and H. M. Lankarani, "Spatial
revolute joints with clearances for dynamic analysis of multi-body systems" (2006), section 6,
animates the journal, and compares the paper's statements with the results.
"""

import argparse

import clearjoint as cj
from clearjoint import plot
from studies.common.output import Output, add_options
from studies.double_pendulum.figures import UPWARDS, animated_instants, figures
from studies.double_pendulum.findings import Findings, find, report
from studies.double_pendulum.runs import (
    QUICK_DURATION,
    SHOULDER,
    SOLVERS,
    Settings,
    simulate_clearance,
    simulate_ideal,
)


def parse(arguments: list[str] | None) -> tuple[Settings, Output]:
    """Return settings and output of a command line."""
    default = Settings()
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    add_options(parser, "short run and coarse pictures")
    parser.add_argument("--clearance", type=float, default=default.clearance, help="radial, m")
    parser.add_argument("--restitution", type=float, default=default.restitution)
    parser.add_argument("--solver", choices=sorted(SOLVERS), default=default.solver)
    parser.add_argument("--rtol", type=float, default=default.rtol, help="relative tolerance")
    parser.add_argument(
        "--duration", type=float, help=f"s; {default.duration:g}, quick {QUICK_DURATION:g}"
    )
    options = parser.parse_args(arguments)
    duration = options.duration
    if duration is None:
        duration = QUICK_DURATION if options.quick else default.duration
    settings = Settings(
        options.clearance,
        options.restitution,
        options.solver,
        options.rtol,
        duration,
        options.quick,
    )
    return settings, Output.of(__file__, options)


def run(settings: Settings, output: Output) -> Findings:
    """Simulate both pendulums, write all figures into the output folder, and return the findings.

    **Raises:** `ValueError` if the duration is too short for three impacts.
    """
    clearance, ideal = simulate_clearance(settings), simulate_ideal(settings)
    for name, figure in figures(settings, clearance, ideal).items():
        output.save(figure, name)
    plot.animate_journal(
        clearance.saved,
        SHOULDER,
        settings.clearance,
        output.file("journal.gif"),
        animated_instants(settings, clearance),
        section=UPWARDS,
    )
    findings = find(settings, clearance, ideal)
    output.file("claims.md").write_text(report(findings), encoding="utf-8")
    return findings


def main(arguments: list[str] | None = None) -> None:
    """Run the study, and print its table."""
    settings, output = parse(arguments)
    cj.configure()
    try:
        print(report(run(settings, output)))
    except ValueError as error:
        raise SystemExit(f"error: {error}") from error
    print(
        "The motion is chaotic: from about 0.15 s on (0.5 mm, 0.9), results of single impacts "
        "hold for this run only."
    )
    print(f"Figures, animation and table: {output.folder}")


if __name__ == "__main__":
    main()
