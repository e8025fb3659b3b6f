"""Draw motions of bodies, and curves over the angle of a shaft, for several runs in one figure."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MultipleLocator

from ..fields.checks import require
from ..fields.drawn_text import shown
from ..simulation.results.observe import Observation
from ..simulation.results.solution import Trajectory
from .observed import named
from .style import (
    TimeSpan,
    axes_or_new,
    draw_lines,
    dress,
    inside,
    legend_above,
    limit_to_window,
    lines,
)

Curve = tuple[np.ndarray, np.ndarray]
"""Pair of arrays: angles in rad or times in s, (N,), and the values at these, (N,) or (N, 3)."""


def position(
    trajectories: Mapping[str, Trajectory],
    body: str,
    component: str = "Y",
    *,
    window: TimeSpan | None = None,
    axes: Axes | None = None,
) -> Axes:
    """Draw one global coordinate of a body's centre of mass over time, a curve for each run.

    **Arguments:**

    - `trajectories`: trajectory of each run, such as `solution.saved`, by the curve's label in the
      legend; later curves cover earlier ones.
    - `body`: name of the body.
    - `component`: "X", "Y" or "Z" of the global frame.
    - `window`: start and end of the drawn time, s, by default all times; `axes`: axes to draw on,
      by default new ones.

    **Returns:** the axes, which show time in s, position in m.

    **Raises:** `ValueError` for an unknown body or component, and for a window outside of the times
    of a curve.

    >>> axes = plot.position({"with clearance": solution.saved}, "arm 2", "Y")
    """
    curves = {
        label: (trajectory.times, named("body", body, trajectory.states.bodies).position)
        for label, trajectory in trajectories.items()
    }
    quantity = f"position of {shown(body)}'s centre, m"
    return _over_time(curves, component, quantity, window, axes, 1.5)


def acceleration(
    observations: Mapping[str, Observation],
    body: str,
    component: str = "Y",
    *,
    window: TimeSpan | None = None,
    axes: Axes | None = None,
) -> Axes:
    """Draw one global component of the acceleration of a body's centre of mass over time, a curve
    for each run.

    **Arguments:**

    - `observations`: observation of each run, from `cj.observe`, by the curve's label in the
      legend; later curves cover earlier ones. Observe every accepted step, so that no peak is
      missed.
    - `body`: name of the body.
    - `component`: "X", "Y" or "Z" of the global frame.
    - `window`: start and end of the drawn time, s, by default all times; `axes`: axes to draw on,
      by default new ones.

    **Returns:** the axes, which show time in s, acceleration in m/s^2.

    **Raises:** `ValueError` for an unknown body or component, and for a window outside of the times
    of a curve.

    >>> axes = plot.acceleration({"with clearance": observed}, "arm 2", "Y")
    """
    curves = {
        label: (observation.times, named("body", body, observation.accelerations).linear)
        for label, observation in observations.items()
    }
    quantity = f"acceleration of {shown(body)}'s centre, m/s²"
    return _over_time(curves, component, quantity, window, axes, 1.0)


def path(
    trajectories: Mapping[str, Trajectory],
    body: str,
    plane: tuple[str, str] = ("X", "Y"),
    *,
    window: TimeSpan | None = None,
    axes: Axes | None = None,
) -> Axes:
    """Draw the path of a body's centre of mass, projected on a plane of the global frame, a curve
    for each run.

    **Arguments:**

    - `trajectories`: trajectory of each run, such as `solution.saved`, by the curve's label; later
      curves cover earlier ones.
    - `body`: name of the body.
    - `plane`: the two global coordinates, "X", "Y" or "Z", that are drawn to the right and upwards.
    - `window`: start and end of the drawn time, s; by default the whole trajectories.
    - `axes`: axes to draw on, by default new ones.

    **Returns:** the axes, of equal scale; positions in m. A dot marks the start. No legend is
    drawn; `axes.legend()` adds one.

    **Raises:** `ValueError` for an unknown body or coordinate, and for a window without times of a
    trajectory.

    >>> axes = plot.path({"with clearance": solution.saved}, "arm 3", ("Y", "Z"))
    """
    axes = axes_or_new(axes, (5.0, 5.0))
    right, up = map(_number, plane)
    # Not strict, since `lines` yields styles without end.
    for (label, trajectory), (colour, style) in zip(trajectories.items(), lines(), strict=False):
        in_window = inside(np.asarray(trajectory.times), window)
        centre = named("body", body, trajectory.states.bodies).position[in_window]
        look = {"color": colour, "linestyle": style, "linewidth": 1.3}
        axes.plot(centre[:, right], centre[:, up], label=label, **look)
        axes.plot(centre[:1, right], centre[:1, up], "o", color="black", markersize=5)
    axes.set_aspect("equal")
    return dress(axes, f"{plane[0]}, m", f"{plane[1]}, m")


def over_angle(
    curves: Mapping[str, Curve],
    quantity: str,
    *,
    shaft: str = "crank",
    axes: Axes | None = None,
) -> Axes:
    """Draw curves over the angle of a shaft, such as forces over the angle of a crank.

    **Arguments:**

    - `curves`: angles (N,) in rad and values (N,), by the curve's label; later curves cover earlier
      ones.
    - `quantity`: text of the vertical axis: name and unit of the values.
    - `shaft`: name of the shaft in the text of the horizontal axis.
    - `axes`: axes to draw on, by default new ones.

    **Returns:** the axes, which show angle in degrees, ticks at quarter turns. No legend is drawn;
    `axes.legend()` adds one.

    >>> angle = np.linspace(0.0, 2.0 * np.pi, 73)
    >>> axes = plot.over_angle({"ideal": (angle, 100.0 * np.cos(angle))}, "force / N")
    """
    axes = axes_or_new(axes)
    draw_lines(axes, ((label, np.degrees(x), y) for label, (x, y) in curves.items()), 1.4)
    if curves:
        ends = np.degrees([(np.min(angles), np.max(angles)) for angles, _ in curves.values()])
        axes.set_xlim(ends.min(), ends.max())
    axes.xaxis.set_major_locator(MultipleLocator(90.0))
    return dress(axes, f"{shaft} angle, °", quantity)


def _over_time(
    curves: Mapping[str, Curve],
    component: str,
    quantity: str,
    window: TimeSpan | None,
    axes: Axes | None,
    width: float,
) -> Axes:
    """Draw one component of vectors over time.

    **Arguments:** `curves`: times (N,), s, and vectors (N, 3), by the curve's label;
    `component`: "X", "Y" or "Z"; `quantity`: name and unit of the vectors, such as "position of
    arm's centre, m". The label of the vertical axis begins with the component: "Y-position of arm's
    centre, m"; `window`, `axes`: see `position`; `width`: width of the lines, points.

    **Raises:** `ValueError` for an unknown component, and for a window outside of the times of a
    curve.
    """
    axis = _number(component)
    axes = axes_or_new(axes)
    drawn = []
    for label, (times, vectors) in curves.items():
        mask = limit_to_window(axes, np.asarray(times), window)
        drawn.append((label, np.asarray(times)[mask], vectors[mask, axis]))
    draw_lines(axes, drawn, width)
    legend_above(axes, len(curves))
    return dress(axes, "time, s", f"{component}-{quantity}")


def _number(component: str) -> int:
    names = ("X", "Y", "Z")
    require(component in names, "component", component, f"one of {names}", "name one of them")
    return names.index(component)
