"""Pictures of studies whose results are tables, drawn from the tables in their README.md.

    python -m studies.common.pictures

So a number that is drawn stands in one place.
"""

import re
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from clearjoint.plot import style

STUDIES = Path(__file__).resolve().parents[1]
COLOURS = (style.BLUE, style.VERMILLION, style.GREEN)
Rows = list[dict[str, str]]


def table(study: str, column: str) -> Rows:
    """The rows by column of the first table in a study's README.md that has the column; empty cells
    of the first column repeat the one above."""
    text = (STUDIES / study / "README.md").read_text(encoding="utf-8")
    for block in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE):
        head, _, *lines = (_cells(line) for line in block.splitlines())
        if column in head:
            rows = [dict(zip(head, cells, strict=True)) for cells in lines]
            for above, row in zip(rows, rows[1:], strict=False):
                row[head[0]] = row[head[0]] or above[head[0]]
            return rows
    raise ValueError(f"Argument `column` must be that of a table of {study}, but is {column!r}.")


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


def bars(names: list[str], values: dict[str, list[float]], title: str, log: bool) -> Figure:
    """A group of bars for each name, one for each series."""
    layout = ConstrainedLayoutEngine(w_pad=0.12)
    drawn = Figure(figsize=(8.0, 1.2 + 0.45 * len(names)), layout=layout)
    axes = drawn.subplots()
    height = 0.8 / len(values)
    for k, (label, series) in enumerate(values.items()):
        places = [row + (k - 0.5 * (len(values) - 1)) * height for row in range(len(names))]
        bar = axes.barh(places, series, 0.9 * height, color=COLOURS[k], label=label)
        axes.bar_label(bar, [f"{value:g}" for value in series], padding=3, fontsize=8)
    axes.set_yticks(range(len(names)), [name.replace("`", "") for name in names])
    axes.invert_yaxis()
    if log:
        axes.set_xscale("log")
    axes.margins(x=0.15)
    style.dress(axes, title, "")
    if len(values) > 1:
        drawn.legend(loc="outside lower center", ncols=len(values), frameon=False)
    return drawn


def coordinates() -> Figure:
    """Time of an attempted step by mechanism."""
    rows = table("coordinates", "µs an attempt")
    names = list(dict.fromkeys(row["mechanism"] for row in rows))
    series = {
        kind: [float(r["µs an attempt"]) for r in rows if r["coordinates"] == kind]
        for kind in ("absolute", "joint")
    }
    return bars(names, series, "time of an attempted step, µs", True)


def recovery() -> Figure:
    """Scatter of the estimates over the bound."""
    kept = [row for row in table("recovery", "scatter / bound") if row["scatter / bound"]]
    scatter = [[float(x) for x in row["scatter / bound"].split(",")] for row in kept]
    names = [row["sensor, start"] for row in kept]
    labels = ("Young's modulus", "restitution", "clearance")
    series = {label: [row[k] for row in scatter] for k, label in enumerate(labels)}
    return bars(names, series, "scatter of the estimates / Cramér-Rao bound", False)


def identification() -> Figure:
    """Share of searches that succeed."""
    rows = table("identification", "near: successes")
    series = {kind: [_share(row[f"{kind}: successes"]) for row in rows] for kind in ("near", "far")}
    return bars([row[""] for row in rows], series, "searches that succeed, %", False)


def _share(cell: str) -> float:
    part, whole = (int(number) for number in cell.split(" of "))
    return 100.0 * part / whole


def main() -> None:
    """Draw them all, each beside its study."""
    plt.switch_backend("Agg")
    for draw in (coordinates, recovery, identification):
        draw().savefig(STUDIES / draw.__name__ / f"{draw.__name__}.png", dpi=110)


if __name__ == "__main__":
    main()
