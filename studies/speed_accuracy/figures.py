"""Figures of `studies.speed_accuracy`."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from clearjoint.plot import style
from studies.speed_accuracy.front import Measure, finite, front
from studies.speed_accuracy.runs import Point
from studies.speed_accuracy.variants import Rounded, Row

COLOURS = (
    style.BLUE,
    style.VERMILLION,
    style.GREEN,
    style.PURPLE,
    "#E69F00",
    "#56B4E9",
    "#6A3D9A",
    "#7F5539",
    "#222222",
)
MARKERS = "osD^vP*Xh"


def diagrams(
    points: Sequence[Point], presets: Sequence[Point], measures: Sequence[tuple[str, str, Measure]]
) -> Figure:
    """Draw error against cost for each measure: a curve for each family, the Pareto front, and the
    presets.
    """
    figure = Figure(figsize=(12.5, 6.2), layout="constrained")
    panels = figure.subplots(1, len(measures), squeeze=False)[0]
    for axes, (x, y, measure) in zip(panels, measures, strict=True):
        _front(axes, points, measure)
        _families(axes, points, measure)
        _presets(axes, presets, measure)
        axes.set_xscale("log")
        axes.set_yscale("log")
        style.dress(axes, x, y)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False)
    return figure


def _families(axes: Axes, points: Sequence[Point], measure: Measure) -> None:
    solvers = list(dict.fromkeys(point.setting.solver for point in points))
    for family in dict.fromkeys(point.setting.family for point in points):
        members = [point for point in points if point.setting.family == family]
        setting = members[0].setting
        number = solvers.index(setting.solver)
        shown = np.array([measure(point) for point in finite(members, measure)]).reshape(-1, 2)
        colour = COLOURS[number % len(COLOURS)]
        axes.plot(
            *shown.T,
            marker=MARKERS[number % len(MARKERS)],
            color=colour,
            linestyle="-" if setting.lands else ":",
            markerfacecolor=colour if setting.lands else "white",
            linewidth=1.1,
            markersize=4.5,
            label=family if "fixed" not in family else setting.solver,
        )


def _front(axes: Axes, points: Sequence[Point], measure: Measure) -> None:
    best = np.array([measure(point) for point in front(points, measure)])
    axes.step(
        *best.T, where="post", color=style.LIGHT, linewidth=7.0, zorder=0, label="Pareto front"
    )


def _presets(axes: Axes, presets: Sequence[Point], measure: Measure) -> None:
    for point in finite(presets, measure):
        cost, error = measure(point)
        axes.plot(
            cost, error, "o", markersize=13, markerfacecolor="none", color=style.DARK, zorder=5
        )
        axes.annotate(
            point.setting.solver,
            (cost, error),
            (-10, -14),
            textcoords="offset points",
            ha="right",
            color=style.DARK,
            weight="bold",
        )


def variants(
    smooth: dict[bool, list[Row]], precise: dict[str, list[Rounded]], stable: list[Row]
) -> Figure:
    """Draw the effects of smoothing widths, precisions and stabilisations."""
    figure = Figure(figsize=(12.5, 4.2), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    _smoothing(left, smooth)
    for (name, rows), colour, marker in zip(
        precise.items(), (style.BLUE, style.VERMILLION), "os", strict=True
    ):
        tolerances = [row.rtol for row in rows]
        middle.loglog(
            tolerances, [row.error for row in rows], f"{marker}-", color=colour, label=name
        )
    style.dress(middle, "rtol", "largest error of a position\nbefore 0.1 s, m")
    middle.legend(frameon=False)
    right.semilogx(
        [row.drift for row in stable], [row.name for row in stable], "o", color=style.BLUE
    )
    right.invert_yaxis()
    style.dress(right, "largest drift of the hinge, m", "")
    return figure


def _smoothing(axes: Axes, smooth: dict[bool, list[Row]]) -> None:
    for lands, rows in smooth.items():
        exact, *others = rows
        colour, label = (style.BLUE, "landing") if lands else (style.VERMILLION, "not landing")
        widths = [float(row.name) for row in others]
        errors = [row.error for row in others]
        axes.loglog(widths, errors, "o-" if lands else "s:", color=colour, label=label)
        axes.axhline(exact.error, color=colour, linewidth=0.8, linestyle="--")
    axes.plot([], [], "--", color=style.GREY, linewidth=0.8, label="exact law")
    style.dress(axes, "smoothing width, m", "largest error of a position\nbefore 0.1 s, m")
    axes.legend(frameon=False)
