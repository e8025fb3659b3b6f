"""Colours and line styles of all figures, and functions that give figures the same look."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import cycle

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.projections.polar import PolarAxes

from ..fields.checks import require
from ..fields.drawn_text import broken
from ..fields.types import ArrayLike

BLUE, VERMILLION, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
SKY, ORANGE = "#56B4E9", "#E69F00"
DARK, LIGHT, GREY = "#16324F", "#BBDDF2", "#8C8C8C"
Dashes = str | tuple[int, tuple[int, ...]]
"""A line style of matplotlib: its symbol, or an offset and the lengths of dashes and gaps."""
LINES: tuple[tuple[str, Dashes], ...] = (
    (BLUE, "-"),
    (VERMILLION, "--"),
    (GREEN, "-."),
    (PURPLE, ":"),
    (SKY, (0, (8, 2))),
    (ORANGE, (0, (6, 1, 1, 1, 1, 1))),
)
"""Colours (of M. Okabe and K. Ito, which colour-blind people can distinguish) and line styles."""
TimeSpan = tuple[float, float]
"""Start and end of the drawn time, s."""


def lines() -> Iterator[tuple[str, Dashes]]:
    """Return an iterator without end over colours and line styles for successive curves."""
    return cycle(LINES)


def next_colour(axes: Axes) -> str:
    """Return the first colour without a line on the axes, or the colour with the fewest lines."""
    drawn = [line.get_color() for line in axes.get_lines()]
    return min((colour for colour, _ in LINES), key=drawn.count)


def axes_or_new(axes: Axes | None, size: tuple[float, float] = (6.4, 4.0)) -> Axes:
    """Return `axes`, or for None the axes of a new figure of width and height `size`, inches."""
    if axes is not None:
        return axes
    return plt.subplots(figsize=size, layout="constrained")[1]


def polar_or_new(axes: Axes | None) -> PolarAxes:
    """Return `axes`, or for None new polar axes, with grid lines at every 45°.

    **Raises:** `ValueError` for axes that are not polar.
    """
    if axes is None:
        figure = plt.figure(figsize=(4.8, 5.0), layout="constrained")
        axes = figure.add_subplot(projection="polar")
    remedy = 'make them by subplots(subplot_kw={"projection": "polar"})'
    require(isinstance(axes, PolarAxes), "axes", type(axes).__name__, "polar axes", remedy)
    assert isinstance(axes, PolarAxes)
    axes.grid(True, color="0.85", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.set_xticks(np.arange(0.0, 2.0 * np.pi, 0.25 * np.pi))
    return axes


def dress(axes: Axes, x: str, y: str) -> Axes:
    """Give axes the common look of figures, and return them: the texts `x` and `y` as labels, a
    faint grid behind the curves, and no frame above and on the right."""
    axes.set_xlabel(broken(x))
    axes.set_ylabel(broken(y))
    axes.grid(True, color="0.9", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    return axes


def draw_lines(
    axes: Axes, curves: Iterable[tuple[str, ArrayLike, ArrayLike]], linewidth: float = 1.5
) -> None:
    """Draw curves that differ by colour and line style.

    **Arguments:** `curves`: label, x (N,) and y (N,) of each curve; `linewidth`: points.
    """
    for (label, x, y), (colour, style) in zip(curves, lines(), strict=False):
        axes.plot(x, y, color=colour, linestyle=style, linewidth=linewidth, label=label)


def legend_above(
    axes: Axes,
    columns: int = 1,
    *,
    handles: Sequence[Artist] | None = None,
    handlelength: float | None = None,
    height: float = 1.0,
) -> None:
    """Add a legend without a frame above the axes.

    **Arguments:** `columns`: number of columns; `handles`: drawn samples, by default those of all
    labelled curves; `handlelength`: length of the samples in font sizes; `height`: lower edge of
    the legend as a fraction of the axes' height.
    """
    axes.legend(
        handles=handles,
        loc="lower center",
        bbox_to_anchor=(0.5, height),
        ncols=columns,
        frameon=False,
        handlelength=handlelength,
    )


def show(axes: Axes, times: np.ndarray, window: TimeSpan | None) -> np.ndarray:
    """Limit a time axis to a window, if one is given.

    **Arguments:** `times`: (N,), increasing, and `window`, both in the unit of the axis.

    **Returns:** mask (N,) of the times to draw: those in the window and the nearest one on either
    side, so that curves reach the window's edges; all times without a window.
    """
    if window is None:
        return np.full(np.shape(times), True)
    axes.set_xlim(*window)
    first, last = np.searchsorted(times, window[0], "right") - 1, np.searchsorted(times, window[1])
    index = np.arange(len(times))
    return (index >= first) & (index <= last)


def inside(times: np.ndarray, window: TimeSpan | None) -> np.ndarray:
    """Return a mask (N,) that is true for those of the times (N,) that lie in the window or at its
    ends, or for all times if `window` is None. Times and window have the same unit.

    **Raises:** `ValueError` if no time lies in the window.
    """
    first, last = (-np.inf, np.inf) if window is None else window
    mask = (times >= first) & (times <= last)
    expected, remedy = "an interval with observed times", "widen it, or observe at more instants"
    require(window is None or mask.any(), "window", window, expected, remedy)
    return mask
