"""Time to a first answer by the number of bodies, clearance joints and parameters.

    python -m studies.benchmark.growth [--quick] [--output FOLDER]

Each call runs alone in a fresh process without a cache, compiled natively and, where that takes
reasonable time, by XLA. Times are processor times.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

import clearjoint as cj
from clearjoint.testing import native_seconds
from studies.benchmark.chain import LENGTH, chain
from studies.common.fresh_process import in_process
from studies.common.report import Record, report

SPAN = 1e-3
"""Simulated time, s, so short that only the preparation counts."""
NUMBERS = {"ideal joints": (3, 6, 12, 24, 48), "plays": (1, 2, 4, 8), "parameters": (1, 3, 8)}
BY_XLA = {"ideal joints": (3, 6, 12), "plays": (1, 2, 4), "parameters": (1, 3)}
QUICK = {"ideal joints": (1, 2)}
FRESH = """
import sys
import clearjoint as cj
from clearjoint.testing import native_seconds
cj.configure(cache=sys.argv[1])
from studies.benchmark.growth import print_first_answer
print_first_answer(sys.argv[2], int(sys.argv[3]))
"""


def rows(quick: bool = False) -> list[Record]:
    """Measure the processor time of each first answer, s, and its parts where programs are native.

    The time outside the parts is mostly checks, and small programs before and after a run.
    """
    found = [_row(of, n, "native") for of, ns in (QUICK if quick else NUMBERS).items() for n in ns]
    by_xla = {} if quick else BY_XLA
    return found + [_row(of, n, "XLA") for of, numbers in by_xla.items() for n in numbers]


def _row(of: str, number: int, compiler: str) -> Record:
    native = {"CLEARJOINT_NATIVE": "1" if compiler == "native" else "0"}
    with tempfile.TemporaryDirectory() as cache:
        _, times = in_process(FRESH, cache, of, str(number), **native)
    return {"of": of, "number": number, "compiler": compiler, **times}


def figure(rows: Sequence[Record]) -> Figure:
    """Draw the time to a first answer against each number."""
    kinds = list(dict.fromkeys(row["of"] for row in rows))
    drawn, panels = plt.subplots(
        1, len(kinds), figsize=(3.6 * len(kinds), 3.4), sharey=True, squeeze=False, layout="tight"
    )
    for kind, panel in zip(kinds, panels[0], strict=True):
        for compiler, style in (("native", "o-"), ("XLA", "s--")):
            chosen = [row for row in rows if (row["of"], row["compiler"]) == (kind, compiler)]
            if chosen:
                numbers, times = ([row[name] for row in chosen] for name in ("number", "s"))
                panel.loglog(numbers, times, style, label=compiler)
        ticks = sorted({row["number"] for row in rows if row["of"] == kind})
        panel.set_xticks(ticks, [str(tick) for tick in ticks])
        panel.set_xticks([], minor=True)
        panel.set_xlabel(f"number of {kind}")
        panel.grid(alpha=0.3, which="both")
    panels[0][0].set_ylabel("processor time to the first answer, s")
    panels[0][0].legend()
    return drawn


def print_first_answer(of: str, number: int) -> None:
    """Call for the first time, and print the time."""
    scene, state = _scene(of, number)
    begun = time.process_time()
    if of == "parameters":
        y = {"y": cj.quantities.Position("arm 2", "y")}
        cj.sensitivities(scene, state, SPAN, _parameters(number), y, [SPAN])
    else:
        cj.simulate(scene, state, SPAN, progress=False)
    took = time.process_time() - begun
    print(json.dumps({"s": took, **native_seconds()}))


def _scene(of: str, number: int) -> tuple[cj.Scene, cj.State]:
    if of == "parameters":
        return cj.mechanisms.double_pendulum(0.5e-3, 0.9)
    return chain(number) if of == "plays" else ideal_chain(number)


def ideal_chain(rods: int) -> tuple[cj.Scene, cj.State]:
    """Return slender rods in a row along X, at rest, hinged about Z, with gravity along -Y."""
    scene, state = chain(rods)
    names, end, axis = ["ground", *scene.bodies], (0.5 * LENGTH, 0.0, 0.0), (0.0, 0.0, 1.0)
    before = [(0.0, 0.0, 0.0), *[end] * (rods - 1)]
    hinges = {
        f"hinge {k + 1}": cj.RevoluteJoint(
            names[k], names[k + 1], before[k], (-0.5 * LENGTH, 0.0, 0.0), axis, axis
        )
        for k in range(rods)
    }
    return cj.Scene(scene.bodies, hinges, gravity=scene.gravity), state


def _parameters(number: int) -> dict[str, cj.Parameter]:
    chosen = {
        "clearance": cj.Parameter(lambda s: s.joints["shoulder"].clearance, cj.Log()),
        "restitution": cj.Parameter(lambda s: s.joints["shoulder"].law.restitution),
        "mass": cj.Parameter(lambda s: s.bodies["arm 2"].mass, cj.Log()),
        "inertia": cj.Parameter(lambda s: s.bodies["arm 2"].inertia[2], cj.Log()),
        "gravity": cj.Parameter(lambda s: s.gravity[1]),
        "radius": cj.Parameter(lambda s: s.joints["shoulder"].bearing_radius, cj.Log()),
        "length": cj.Parameter(lambda s: s.joints["shoulder"].journal_length, cj.Log()),
        "journal point": cj.Parameter(lambda s: s.joints["shoulder"].journal_point[0]),
    }
    return dict(list(chosen.items())[:number])


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print the table, and write it and the figure into a folder."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="chains of one and two joints")
    parser.add_argument("--output", type=Path, default=Path("results/growth"))
    options = parser.parse_args(arguments)
    options.output.mkdir(parents=True, exist_ok=True)
    records = rows(options.quick)
    cells = [[f"{x:.2f}" if isinstance(x, float) else str(x) for x in r.values()] for r in records]
    report(options.output / "growth.json", [tuple(records[0]), *cells], records)
    figure(records).savefig(options.output / "growth.png", dpi=130)


if __name__ == "__main__":
    main()
