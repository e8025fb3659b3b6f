"""Map of the tested ranges."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from studies.extremes.entries import REFUSED, RIGHT, WRONG, Entry, Row
from studies.extremes.random_scenes import Batch

COLOURS = {RIGHT: "#7fc97f", REFUSED: "#c9c9c9", WRONG: "#d62728"}

SHORT = {
    "left_bearing": "left bearing",
    "max_steps_reached": "step limit",
    "step_too_small": "step too small",
}
"""Short names of result codes."""


def drawn_map(rows: Sequence[Row], batches: Sequence[Batch]) -> Figure:
    """Draw the cases above, a cell for each value, and the random scenes by family below."""
    heights = (len(rows), len(batches) + 1.0)
    figure = Figure(figsize=(11.0, 0.36 * sum(heights) + 1.4), layout="constrained")
    above, below = figure.subplots(2, 1, height_ratios=heights)
    _cases(above, rows)
    _families(below, batches)
    patches = [Patch(color=colour, label=name) for name, colour in COLOURS.items()]
    figure.legend(handles=patches, loc="outside upper right", ncols=3, frameon=False)
    return figure


def _cases(axes: Axes, rows: Sequence[Row]) -> None:
    for level, row in enumerate(rows):
        width = 1.0 / len(row.entries)
        for k, entry in enumerate(row.entries):
            axes.barh(
                level,
                width,
                left=k * width,
                height=0.82,
                color=COLOURS[entry.verdict],
                edgecolor="white",
                linewidth=1.5,
            )
            axes.text((k + 0.5) * width, level, _shown(entry), ha="center", va="center", fontsize=7)
        worst = "" if np.isnan(row.worst) else f"error up to {row.worst:.0e}"
        axes.text(1.01, level, worst, va="center", fontsize=8)
    units = ["" if row.unit == "1" else f", {row.unit}" for row in rows]
    labels = [row.name + unit for row, unit in zip(rows, units, strict=True)]
    _finish(axes, labels)
    axes.set_xlim(0.0, 1.16)


def _shown(entry: Entry) -> str:
    value = entry.value
    if value and not 1e-2 <= abs(value) < 1e3:
        digits, _, power = f"{value:.0e}".partition("e")
        return f"{digits}e{int(power)}"
    return f"{value:.3g}"


def _families(axes: Axes, batches: Sequence[Batch]) -> None:
    for level, one in enumerate(batches):
        codes = one.codes()
        wrong = len(one.wrong())
        parts = [(RIGHT, "successful", codes["successful"] - wrong)]
        parts += [
            (REFUSED, SHORT.get(code, code), n)
            for code, n in sorted(codes.items())
            if code != "successful"
        ]
        parts.append((WRONG, "wrong", wrong))
        left = 0.0
        for verdict, name, count in parts:
            width = count / codes.total()
            axes.barh(
                level,
                width,
                left=left,
                height=0.82,
                color=COLOURS[verdict],
                edgecolor="white",
                linewidth=1.5,
            )
            text = f"{count} {name}" if width > 0.1 else str(count)
            if width > 0.025:
                axes.text(left + width / 2, level, text, ha="center", va="center", fontsize=7)
            left += width
    _finish(axes, [one.family for one in batches])
    axes.set_xlim(0.0, 1.16)
    axes.set_title(
        f"random scenes, all numbers at once: {sum(len(one.lanes) for one in batches)}",
        fontsize=10,
        loc="left",
    )


def _finish(axes: Axes, labels: Sequence[str]) -> None:
    axes.set_yticks(range(len(labels)), labels, fontsize=9)
    axes.invert_yaxis()
    axes.set_xticks([])
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
