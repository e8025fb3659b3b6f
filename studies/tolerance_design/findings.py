"""The searches of both questions, with their figures, and what was found."""

from dataclasses import replace

import numpy as np

from studies.common.output import Output
from studies.tolerance_design import figures
from studies.tolerance_design.search import RANGE, Answer, growth, settled, solve, start


def findings(answers: list[Answer], growths: dict[str, np.ndarray]) -> list[str]:
    """What was found, in words."""
    lines = []
    for answer in answers:
        title = answer.design.title
        for name, found in {**answer.alone, "both": answer.both}.items():
            lines.append(f"{title}, {name}, from {_range()}: {1e6 * found.value:.3f} µm. {found}")
    for label, sizes in growths.items():
        last = ", ".join(f"{size:.3g}" for size in sizes)
        lines.append(f"{label}: derivative of the slider's position, by revolution: {last}")
    return lines


def _range() -> str:
    return f"{1e6 * RANGE[0]:g} to {1e6 * RANGE[1]:g} µm"


def run(output: Output) -> list[str]:
    """The searches, with figures; returns the findings."""
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
    return findings(answers, growths)
