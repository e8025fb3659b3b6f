"""Machines that turn: curves over the angle of a shaft, and Poincaré maps."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MultipleLocator

from .style import axes_or_new, dress, lines

Curve = tuple[np.ndarray, np.ndarray]


def over_angle(
    curves: Mapping[str, Curve],
    quantity: str,
    *,
    shaft: str = "crank",
    axes: Axes | None = None,
) -> Axes:
    """Curves over the angle of a shaft.

    **Arguments:**

    - `curves`: angles (N,) in rad and values (N,), by label; later ones lie over earlier ones.
    - `quantity`: what the values are, with their unit. `shaft`: what turns.

    **Returns:** the axes; angle in degrees, ticks at quarter turns.

    >>> angle = np.linspace(0.0, 2.0 * np.pi, 73)
    >>> axes = plot.over_angle({"ideal": (angle, 100.0 * np.cos(angle))}, "force / N")
    """
    axes = axes_or_new(axes)
    for (label, (angles, values)), (colour, style) in zip(curves.items(), lines(), strict=False):
        degrees = np.degrees(angles)
        axes.plot(degrees, values, color=colour, linestyle=style, linewidth=1.4, label=label)
        axes.set_xlim(degrees[0], degrees[-1])
    axes.xaxis.set_major_locator(MultipleLocator(90.0))
    return dress(axes, f"{shaft} angle, °", quantity)


def poincare_map(
    x: np.ndarray, y: np.ndarray, labels: tuple[str, str], *, axes: Axes | None = None
) -> Axes:
    """Points where a motion stands once a period: one dot if it is periodic, a cloud if chaotic.

    **Arguments:** `x`, `y`: (N,) coordinates of the points, in order; `labels`: theirs, with units.

    **Returns:** the axes; later points are darker.

    >>> axes = plot.poincare_map(np.zeros(20), np.linspace(0, 1, 20), ("x / mm", "v / (m/s)"))
    """
    axes = axes_or_new(axes, (4.8, 4.8))
    shade = np.linspace(0.35, 1.0, len(x))
    axes.scatter(x, y, c=shade, cmap="Blues", vmin=0.0, vmax=1.0, s=14.0, linewidths=0.0, zorder=3)
    return dress(axes, *labels)
