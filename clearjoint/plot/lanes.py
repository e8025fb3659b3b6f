"""Outputs of a sweep against a swept parameter."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from ..fields.checks import require
from .labels import legend_label, scale_axes, scaled
from .outcomes import ended_well, mark_failed, of_lanes, only_axis
from .style import axes_or_new, dress, next_colour

LONG = 40
"""Characters of a label of which two stand above each other in a legend."""


def against(
    dataset: xr.Dataset,
    variable: str,
    axis: str | None = None,
    *,
    median: int | None = None,
    label: str | None = None,
    colour: str | None = None,
    axes: Axes | None = None,
) -> Axes:
    """One output of a sweep against one swept parameter, a point for each lane.

    Lanes that failed or are pending are crosses of the points' colour at the foot of the axes. Into
    axes that have some already, points come in another colour and in the units of these.

    **Arguments:**

    - `dataset`: of `sweep` or `open_sweep`, with other axes selected away.
    - `variable`: the output's name. `axis`: the parameter's; unless given, the sweep's only one.
    - `median`: if given, a line through the median of so many neighbouring lanes, which tells a
      trend from the scatter of chaotic motion.
    - `label`: what the legend calls the points: unless given, where other axes of the sweep have
      been selected, such as ``dataset.sel(restitution=0.9)``, or that and the output's name.
    - `colour`: of the points; unless given, one that the axes do not have yet.

    **Returns:** the axes, logarithmic where values spread over a decade.

    >>> stiffness = cj.Axis(lambda scene: scene.forces["spring"].stiffness, [50, 100, 200, 400])
    >>> speed = cj.Peak(cj.quantities.Velocity("ball"), "m/s")
    >>> axes = {"stiffness": stiffness}
    >>> found = cj.sweep(scene, state, 0.5, axes, {"speed": speed}, progress=False)
    >>> drawn = plot.against(found, "speed")
    """
    axis = only_axis(dataset, axis)
    axes = axes_or_new(axes)
    colour = next_colour(axes) if colour is None else colour
    label = legend_label(dataset, variable, axis) if label is None else label
    x = scaled(dataset[axis], axes.get_xlabel())
    y = scaled(of_lanes(dataset, variable, (axis,)), axes.get_ylabel())
    axes.plot(
        x.values,
        y.values,
        "o",
        color=colour,
        markersize=4,
        markeredgewidth=0,
        alpha=1.0 if median is None else 0.45,
        label=label,
    )
    if median is not None:
        line = running_median(x.values, y.values, median)
        axes.plot(*line, color=colour, linewidth=2, label=f"median of {median} neighbours")
    scale_axes(axes, x.values, y.values)
    mark_failed(axes, x.values, ended_well(dataset).values, colour)
    labels = axes.get_legend_handles_labels()[1]
    if len(labels) > 1:
        columns = 1 if max(map(len, map(str, labels))) > LONG else 2
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=columns, frameon=False)
    return dress(axes, x.label, y.label)


def running_median(
    places: np.ndarray, values: np.ndarray, width: int
) -> tuple[np.ndarray, np.ndarray]:
    """Median of `width` neighbouring values, against the median of their places.

    NaN is left out, and so are the ends, which have too few neighbours.

    **Raises:** `ValueError` if there are fewer values than `width`.

    >>> values = np.array([1.0, 9.0, 2.0, 3.0, 4.0])
    >>> places, medians = plot.running_median(np.arange(5.0), values, 3)
    >>> medians
    array([2., 3., 3.])
    """
    there = np.isfinite(values)
    count = int(there.sum())
    require(1 <= width <= count, "width", width, f"between 1 and {count} values", "lower it")
    order = np.argsort(places[there], kind="stable")
    rows = (
        np.lib.stride_tricks.sliding_window_view(column[there][order], width)
        for column in (places, values)
    )
    middle, height = (np.median(row, axis=1) for row in rows)
    return middle, height
