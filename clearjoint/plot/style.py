"""What all figures share: colours, sizes, and plain axes."""

from collections.abc import Iterator

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.projections.polar import PolarAxes

from ..fields.checks import require
from ..fields.drawn_text import broken

BLUE, VERMILLION, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
SKY, ORANGE = "#56B4E9", "#E69F00"
DARK, LIGHT, GREY = "#16324F", "#BBDDF2", "#8C8C8C"
Dashes = str | tuple[int, tuple[int, ...]]
"""A line style of matplotlib."""
LINES: tuple[tuple[str, Dashes], ...] = (
    (BLUE, "-"),
    (VERMILLION, "--"),
    (GREEN, "-."),
    (PURPLE, ":"),
    (SKY, (0, (8, 2))),
    (ORANGE, (0, (6, 1, 1, 1, 1, 1))),
)
"""Colours (after M. Okabe and K. Ito, told apart by colour-blind people) with line styles."""
SIZE = (6.4, 4.0)
"""Width and height of a new figure, inches."""
TimeSpan = tuple[float, float]
"""First and last instant to show, s."""


def lines() -> Iterator[tuple[str, Dashes]]:
    """Colours and line styles for one curve after the other, without end."""
    while True:
        yield from LINES


def next_colour(axes: Axes) -> str:
    """The first of the colours in which no line is drawn on the axes; once all are, the one of the
    fewest lines."""
    drawn = [line.get_color() for line in axes.get_lines()]
    return min((colour for colour, _ in LINES), key=drawn.count)


def axes_or_new(axes: Axes | None, size: tuple[float, float] = SIZE) -> Axes:
    """The given axes, or those of a new figure of the given size in inches."""
    if axes is not None:
        return axes
    return plt.subplots(figsize=size, layout="constrained")[1]


def polar_or_new(axes: Axes | None, size: tuple[float, float] = (4.8, 5.0)) -> PolarAxes:
    """The given axes, or those of a new figure, polar ones: angles in a bearing's cross-section,
    from its x to the right to its y upwards.

    **Raises:** `ValueError` for axes that are not polar.
    """
    if axes is None:
        made = plt.figure(figsize=size, layout="constrained").add_subplot(projection="polar")
        axes = made
    remedy = 'make them by subplots(subplot_kw={"projection": "polar"})'
    kind = type(axes).__name__
    require(isinstance(axes, PolarAxes), "axes", kind, "polar axes", remedy)
    assert isinstance(axes, PolarAxes)
    axes.grid(True, color="0.85", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.set_xticks(np.arange(0.0, 2.0 * np.pi, 0.25 * np.pi))
    return axes


def dress(axes: Axes, x: str, y: str) -> Axes:
    """Label the axes, draw a faint grid behind the curves, and drop the frame's idle sides."""
    axes.set_xlabel(broken(x))
    axes.set_ylabel(broken(y))
    axes.grid(True, color="0.9", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    return axes


def hide_legend(axes: Axes) -> None:
    """Let a legend be, if there is one, but unseen."""
    legend = axes.get_legend()
    if legend is not None:
        legend.set_visible(False)


def show(axes: Axes, times: np.ndarray, window: TimeSpan | None) -> np.ndarray:
    """Let axes over time end at the window; all stays in view without one.

    **Arguments:** `window` and rising `times` (N,), in the unit of the axes.

    **Returns:** (N,) which times to draw: those in the window, and the one before and behind it, so
    that curves reach its edges.
    """
    if window is None:
        return np.full(np.shape(times), True)
    axes.set_xlim(*window)
    first, last = np.searchsorted(times, window[0], "right") - 1, np.searchsorted(times, window[1])
    number = np.arange(len(times))
    return (number >= first) & (number <= last)


def inside(times: np.ndarray, window: TimeSpan | None) -> np.ndarray:
    """Which of the (N,) times lie in the window; all of them without one."""
    if window is None:
        return np.full(np.shape(times), True)
    return (times >= window[0]) & (times <= window[1])
