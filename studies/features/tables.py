"""What the rungs and the planar programs cost, as tables and a figure."""

from statistics import median

import numpy as np
from matplotlib.figure import Figure

from clearjoint.plot import style
from studies.features.planar import planar_programs
from studies.features.program import Program
from studies.features.rungs import LADDER

TURNS, ROUNDS, LANES = 100_000, 9, 64
Table = list[tuple[str, ...]]


def times(
    programs: dict[str, Program], lanes: int, turns: int, rounds: int, solver: bool = False
) -> dict[str, tuple[float, ...]]:
    """Median times in µs of the parts of each program, measured in turn."""
    loops = {name: program.loops(lanes, turns, solver) for name, program in programs.items()}
    for group in loops.values():
        for call in group:
            call()
    samples = {name: [[] for _ in group] for name, group in loops.items()}
    for _ in range(rounds):
        for name, group in loops.items():
            for sample, call in zip(samples[name], group, strict=True):
                sample.append(call())
    return {name: tuple(median(sample) for sample in group) for name, group in samples.items()}


def ladder(quick: bool) -> tuple[Table, list[str], np.ndarray]:
    """The table of rungs; their names, and (rungs, 4) operations and times of right-hand side and
    step."""
    programs = {name: make() for name, make in list(LADDER.items())[: 2 if quick else None]}
    found = times(programs, 1, TURNS // 100 if quick else TURNS, 1 if quick else ROUNDS)
    rows: Table = [
        (
            "scene", "numbers integrated", "equations: rates, step", "operations: rates, step",
            "rates, µs", "step, µs",
        )
    ]  # fmt: skip
    numbers = []
    for name, program in programs.items():
        operations, equations = program.operations(), program.equations()
        numbers.append((*operations, *found[name]))
        rows.append((
            name, f"{program.variables}", "{}, {}".format(*equations),
            "{}, {}".format(*operations), *(f"{value:.2g}" for value in found[name]),
        ))  # fmt: skip
    return rows, list(programs), np.array(numbers)


def planar(rounds: int = ROUNDS) -> Table:
    """The table of planar programs beside the spatial ones, and the gains."""
    parts = ("rates", "solver's step", "step")
    rows: Table = [
        (
            "scene", "program", "numbers integrated", "operations: rates, step",
            *(f"{part}, µs" for part in parts), *(f"{part} of a lane, µs" for part in parts),
            "gain a step", "gain a lane-step",
        )
    ]  # fmt: skip
    for scene, programs in planar_programs().items():
        alone, together = (times(programs, lanes, TURNS, rounds, True) for lanes in (1, LANES))
        spatial = next(iter(programs))
        for name, program in programs.items():
            gains = (found[spatial][-1] / found[name][-1] for found in (alone, together))
            rows.append((
                scene, name, f"{program.variables}", "{}, {}".format(*program.operations()),
                *(f"{value:.2g}" for value in (*alone[name], *together[name])),
                *(f"{gain:.2f}" for gain in gains),
            ))  # fmt: skip
    return rows


def figure(names: list[str], numbers: np.ndarray) -> Figure:
    """Operations and times of right-hand side and step, rung by rung; see `ladder`."""
    drawn = Figure(figsize=(9.0, 3.8), layout="constrained")
    left, right = drawn.subplots(1, 2, sharey=True)
    places = np.arange(len(names))
    titles = ("arithmetic operations", "time, µs")
    for axes, title, pair in zip(
        (left, right), titles, (numbers[:, :2], numbers[:, 2:]), strict=True
    ):
        for shift, values, colour, label in (
            (-0.2, pair[:, 0], style.BLUE, "right-hand side"),
            (0.2, pair[:, 1], style.VERMILLION, "attempted step"),
        ):
            bars = axes.barh(places + shift, values, 0.38, color=colour, label=label)
            axes.bar_label(
                bars,
                [f"{value:.2g}" if value < 10 else f"{value:.0f}" for value in values],
                padding=3,
                fontsize=8,
            )
        style.dress(axes, title, "")
        axes.set_xscale("log")
        axes.set_xlim(0.5 * pair.min(), 3.0 * pair.max())
    left.set_yticks(places, names)
    left.invert_yaxis()
    drawn.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return drawn
