"""Searches of both questions, with figures and findings."""

from dataclasses import dataclass, replace

import numpy as np

from studies.common.output import Output
from studies.tolerance_design import figures
from studies.tolerance_design.search import RANGE, Answer, growth, settled, solve, start


@dataclass(frozen=True)
class Findings:
    """Results of both questions, and derivatives of the slider's position by revolution."""

    answers: list[Answer]
    growths: dict[str, np.ndarray]

    def lines(self) -> list[str]:
        """Return the findings as text."""
        lines = []
        for answer in self.answers:
            title = f"{answer.design.title}, {1e6 * RANGE[0]:g} to {1e6 * RANGE[1]:g} µm"
            for name, found in {**answer.alone, "both": answer.both}.items():
                lines.append(f"{title}, {name}: {1e6 * found.value:.3f} µm. {found}")
        for label, sizes in self.growths.items():
            values = ", ".join(f"{size:.3g}" for size in sizes)
            lines.append(f"{label}: derivative of the slider's position, by revolution: {values}")
        return lines


def run(output: Output) -> Findings:
    """Run the searches, draw, and return the findings."""
    transient, lanes = (1.5, 5) if output.quick else (11.5, 49)
    late = settled(transient)
    designs = [start()] if output.quick else [start(), late]
    answers = [solve(design, lanes) for design in designs]
    safe = answers[-1].both.value
    rough = replace(late, title="5000 1/min", speed=5000.0)
    cases = ((late, safe), (late, RANGE[1]), (rough, safe), (rough, RANGE[1]))
    growths = {
        f"{design.speed:g} 1/min, {1e6 * clearance:.3g} µm": growth(design, clearance)
        for design, clearance in cases
    }
    output.save(figures.margins(answers), "margin")
    output.save(figures.motion(late, safe, growths), "motion")
    return Findings(answers, growths)
