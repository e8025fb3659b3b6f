"""The searches of both questions, with their figures, and what was found."""

from dataclasses import replace

import numpy as np

import clearjoint as cj
from studies.common.output import Output
from studies.tolerance_design import figures
from studies.tolerance_design.search import RANGE, Answer, growth, settled, solve, start


def findings(answers: list[Answer], growths: dict[str, np.ndarray]) -> list[str]:
    """What was found, in words."""
    lines = []
    for answer in answers:
        title = answer.design.title
        for name, alone in answer.alone.items():
            found = alone.found
            lines.append(
                f"{title}, {name} alone: {_micrometres(found.place)} in {len(found.path)} looks; "
                f"bisection takes {alone.bisection}, Brent's method {alone.brent}"
            )
        both = answer.both
        lines.append(
            f"{title}, both: {_micrometres(both.place)} in {len(both.path)} looks; from {_range()} "
            f"all hold up to {1e6 * answer.safe:.3f} µm: {answer.safest}"
        )
        shares = (f"{name} {predicted(answer.lanes, name):.0%}" for name in answer.design.limits)
        lines.append(
            f"{title}: shares of steps from one of them to the next in which the derivatives tell "
            f"the margin's change within 0.01: {', '.join(shares)}"
        )
    for label, sizes in growths.items():
        last = ", ".join(f"{size:.3g}" for size in sizes)
        lines.append(f"{label}: derivative of the slider's position, by revolution: {last}")
    return lines


def predicted(lanes: list[cj.Margins], name: str, within: float = 0.01) -> float:
    """Share of neighbouring lanes between which the mean slope tells the change of the margin."""
    places = np.array([lane.place for lane in lanes])
    margins, slopes = (
        np.array([part[name] for part in parts])
        for parts in ([lane.margins for lane in lanes], [lane.slopes for lane in lanes])
    )
    told = 0.5 * (slopes[1:] + slopes[:-1]) * np.diff(places)
    return float(np.mean(np.abs(told - np.diff(margins)) <= within))


def around(answer: Answer) -> str:
    """The smallest margins half a per cent below and above the safe clearance."""
    place = np.log(answer.safe)
    below, above = (answer.design.look(place + np.log(factor)).margin for factor in (0.995, 1.005))
    return (
        f"{answer.design.title}: margin {below:+.4f} at 0.995 and {above:+.4f} at 1.005 of the last"
    )


def _micrometres(place: float) -> str:
    return f"{1e6 * np.exp(place):.3f} µm"


def _range() -> str:
    return f"{1e6 * RANGE[0]:g} to {1e6 * RANGE[1]:g} µm"


def run(output: Output) -> list[str]:
    """The searches, with figures; returns the findings."""
    transient, lanes = (1.5, 5) if output.quick else (11.5, 49)
    late = settled(transient)
    designs = [start()] if output.quick else [start(), late]
    answers = [solve(design, lanes) for design in designs]
    safe = answers[-1].safe
    rough = replace(late, title="5000 1/min", speed=5000.0)
    cases = ((late, safe), (late, RANGE[1]), (rough, safe), (rough, RANGE[1]))
    growths = {
        f"{design.speed:g} 1/min, {1e6 * clearance:.3g} µm": growth(design, clearance)
        for design, clearance in cases
    }
    output.save(figures.margins(answers), "margin")
    output.save(figures.motion(late, safe, growths), "motion")
    return findings(answers, growths) + [around(answer) for answer in answers]
