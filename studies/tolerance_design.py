"""The largest clearance at which a slider-crank keeps its tolerances, by gradient.

    python -m studies.tolerance_design [--quick] [--output FOLDER]

The slider's pin may have as much clearance as leaves the slider within a tolerance of the ideal
mechanism's position, and the pin force within a limit. The margins of both peaks come with their
derivatives (`clearjoint.sensitivities`), and Newton's method finds where the smaller one is zero;
bisection and Brent's method on the same margins are counted beside it. The margins over a range of
clearances then tell whether all smaller ones hold; if not, the search begins anew below the first
that does not.

There are two questions. When the machine starts, at full speed and with the pin in the middle of
its bearing, the play is taken up in one impact, which makes the peaks: their margins are smooth.
After a transient, at a speed at which the journal keeps to the wall, the motion has forgotten its
start, and so have the derivatives; but the journal still vibrates on the wall, and the phase of
that makes the margins uneven. Where it strikes, small differences grow from revolution to
revolution, and derivatives with them: correct, and of no use.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

import clearjoint as cj
from studies import tolerance_figures as figures
from studies.margins import predicted
from studies.output import Output
from studies.tolerance_search import RANGE, Answer, growth, settled, solve, start


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
            f"{title}, both: {_micrometres(both.place)} in {len(both.path)} looks; of "
            f"{len(answer.lanes)} clearances from {_range()}, and as many just below that, all "
            f"hold up to {1e6 * answer.safe:.3f} µm"
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
    output.folder.mkdir(parents=True, exist_ok=True)
    output.save(figures.margins(answers), "margin")
    output.save(figures.motion(late, safe, growths), "motion")
    return findings(answers, growths) + [around(answer) for answer in answers]


def main(arguments: list[str] | None = None) -> None:
    """Run the study, and print its findings."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "--quick", action="store_true", help="the first question only, few clearances"
    )
    parser.add_argument("--output", type=Path, default=Path("results/tolerance_design"))
    chosen = parser.parse_args(arguments)
    cj.configure()
    output = Output(chosen.output / "quick" if chosen.quick else chosen.output, chosen.quick)
    print("\n".join(f"- {line}" for line in run(output)))
    print(f"Figures: {output.folder}")


if __name__ == "__main__":
    main()
