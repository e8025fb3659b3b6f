"""The paper's demonstration: a double pendulum with a clearance joint, against an ideal one.

Draws figures 13 to 17 of P. Flores, J. Ambrosio, J. C. P. Claro and H. M. Lankarani, "Spatial
revolute joints with clearances for dynamic analysis of multi-body systems" (2006), section 6,
animates the journal, and sets the paper's statements beside what came out:

    python -m studies.double_pendulum
    python -m studies.double_pendulum --quick
"""

import argparse
from pathlib import Path

import clearjoint as cj
from clearjoint import plot
from studies.output import save_picture
from studies.pendulum.figures import UPWARDS, animated_instants, figures
from studies.pendulum.findings import Findings, find, report
from studies.pendulum.runs import (
    QUICK_DURATION,
    SHOULDER,
    SOLVERS,
    Settings,
    simulate_clearance,
    simulate_ideal,
)


def run(settings: Settings) -> Findings:
    """Simulate both pendulums, write all figures into the output folder, and return the findings.

    **Raises:** `ValueError` if the duration is too short for three impacts.
    """
    clearance, ideal = simulate_clearance(settings), simulate_ideal(settings)
    settings.output.mkdir(parents=True, exist_ok=True)
    for name, figure in figures(settings, clearance, ideal).items():
        save_picture(figure, settings.output / f"{name}.png", 100 if settings.quick else 150)
    plot.animate_journal(
        clearance.saved,
        SHOULDER,
        settings.clearance,
        settings.output / "journal.gif",
        animated_instants(settings, clearance),
        section=UPWARDS,
    )
    findings = find(settings, clearance, ideal)
    (settings.output / "claims.md").write_text(report(findings), encoding="utf-8")
    return findings


def parse(arguments: list[str] | None) -> Settings:
    """The settings from a command line."""
    default = Settings()
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="short run and coarse pictures")
    parser.add_argument("--clearance", type=float, default=default.clearance, help="radial, m")
    parser.add_argument("--restitution", type=float, default=default.restitution)
    parser.add_argument("--solver", choices=sorted(SOLVERS), default=default.solver)
    parser.add_argument("--rtol", type=float, default=default.rtol, help="relative tolerance")
    parser.add_argument(
        "--duration", type=float, help=f"s; {default.duration:g}, quick {QUICK_DURATION:g}"
    )
    parser.add_argument("--output", type=Path, default=default.output, help="folder")
    chosen = vars(parser.parse_args(arguments))
    if chosen["duration"] is None:
        chosen["duration"] = QUICK_DURATION if chosen["quick"] else default.duration
    return Settings(**chosen)


def main(arguments: list[str] | None = None) -> None:
    """Run the study from a command line, and print its table."""
    settings = parse(arguments)
    cj.configure()
    try:
        print(report(run(settings)))
    except ValueError as error:
        raise SystemExit(f"error: {error}") from error
    print(
        "The motion is chaotic: from about 0.15 s on (0.5 mm, 0.9), what depends on single impacts "
        "holds for this run only."
    )
    print(f"Figures, animation and table: {settings.output}")


if __name__ == "__main__":
    main()
