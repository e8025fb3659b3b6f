"""Draw motions of bodies, and curves over the angle of a shaft, for several runs in one figure."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MultipleLocator

from .._fields.checks import require
from .._fields.drawn_text import shown
from .._simulation.results.observe import Observation
from .._simulation.results.solution import Trajectory
from . import style
from .observed import named

Curve = tuple[np.ndarray, np.ndarray]
"""Angles in rad or times in s, (N,), and the values at these, (N,) or (N, 3)."""


def position(
    trajectories: Mapping[str, Trajectory],
    body: str,
    component: str = "Y",
    *,
    window: style.TimeSpan | None = None,
    axes: Axes | None = None,
) -> Axes:
    """Draw one global coordinate of a body's centre of mass over time, a curve for each run.

    **Arguments:** `trajectories`: of each run, such as `solution.saved`, by the curve's label;
    later curves cover earlier ones. `component`: "X", "Y" or "Z" of the global frame.

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
    window: style.TimeSpan | None = None,
    axes: Axes | None = None,
) -> Axes:
    """Draw one global component, "X", "Y" or "Z", of the acceleration of a body's centre of mass
    over time, a curve for each run.

    **Arguments:** `observations`: of each run by the curve's label, at every step to miss no peak.

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
    window: style.TimeSpan | None = None,
    axes: Axes | None = None,
) -> Axes:
    """Draw the paths of a body's centre of mass in the `trajectories` of runs, given by the curve's
    label, on a plane of the global frame. A dot marks the start; ``axes.legend()`` adds a legend.

    **Arguments:** `plane`: the two coordinates, "X", "Y" or "Z", drawn to the right and upwards.

    >>> axes = plot.path({"with clearance": solution.saved}, "arm 3", ("Y", "Z"))
    """
    axes = style.axes_or_new(axes, (5.0, 5.0))
    right, up = map(_number, plane)
    for label, trajectory in trajectories.items():
        in_window = style.inside(np.asarray(trajectory.times), window)
        centre = named("body", body, trajectory.states.bodies).position[in_window]
        style.draw_lines(axes, [(label, centre[:, right], centre[:, up])], 1.3)
        axes.plot(centre[:1, right], centre[:1, up], "o", color="black", markersize=5)  # the start
    axes.set_aspect("equal")
    return style.dress(axes, f"{plane[0]}, m", f"{plane[1]}, m")


def over_angle(
    curves: Mapping[str, Curve], quantity: str, *, shaft: str = "crank", axes: Axes | None = None
) -> Axes:
    """Draw curves over the angle of a shaft, in degrees, such as forces over the angle of a crank.
    ``axes.legend()`` adds a legend.

    **Arguments:** `curves`: angles (N,) in rad and values (N,), by the curve's label; later curves
    cover earlier ones. `quantity`: text of the vertical axis, name and unit of the values; `shaft`:
    name of the shaft in the text of the horizontal axis.

    >>> angle = np.linspace(0.0, 2.0 * np.pi, 73)
    >>> axes = plot.over_angle({"ideal": (angle, 100.0 * np.cos(angle))}, "force / N")
    """
    axes = style.axes_or_new(axes)
    style.draw_lines(axes, ((label, np.degrees(x), y) for label, (x, y) in curves.items()), 1.4)
    if curves:  # the axis has no margins: it ends with the smallest and the largest angle
        ends = np.degrees([(np.min(angles), np.max(angles)) for angles, _ in curves.values()])
        axes.set_xlim(ends.min(), ends.max())
    axes.xaxis.set_major_locator(MultipleLocator(90.0))
    return style.dress(axes, f"{shaft} angle, °", quantity)


def _over_time(
    curves: Mapping[str, Curve],
    component: str,
    quantity: str,
    window: style.TimeSpan | None,
    axes: Axes | None,
    width: float,
) -> Axes:
    axis = _number(component)
    axes = style.axes_or_new(axes)
    drawn = []
    for label, (times, vectors) in curves.items():
        mask = style.limit_to_window(axes, np.asarray(times), window)
        drawn.append((label, np.asarray(times)[mask], vectors[mask, axis]))
    style.draw_lines(axes, drawn, width)
    style.legend_above(axes, len(curves))
    return style.dress(axes, "time, s", f"{component}-{quantity}")


def _number(component: str) -> int:
    names = ("X", "Y", "Z")
    require(component in names, "component", component, f"one of {names}", "name one of them")
    return names.index(component)
