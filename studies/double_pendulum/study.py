"""Runs, figures and results of the study."""

from clearjoint import plot
from studies.common.output import Output
from studies.double_pendulum.figures import UPWARDS, animated_instants, figures
from studies.double_pendulum.findings import Findings, find, report
from studies.double_pendulum.runs import SHOULDER, Settings, simulate_clearance, simulate_ideal


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
