"""Outputs of a sweep against a swept parameter."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from ..fields import require
from .labels import scale_axes, shown
from .outcomes import ended_well, mark_failed, of_lanes, only_axis
from .style import BLUE, DARK, axes_or_new, dress


def against(
    dataset: xr.Dataset,
    variable: str,
    axis: str | None = None,
    *,
    median: int | None = None,
    axes: Axes | None = None,
) -> Axes:
    """One output of a sweep against one swept parameter, a point for each lane.

    Lanes that failed or are pending are crosses at the foot of the axes.

    **Arguments:**

    - `dataset`: of `sweep` or `open_sweep`, with other axes selected away.
    - `variable`: the output's name. `axis`: the parameter's; unless given, the sweep's only one.
    - `median`: if given, a line through the median of so many neighbouring lanes, which tells a
      trend from the scatter of chaotic motion.

    **Returns:** the axes, logarithmic where values spread over a decade.
    """
    axis = only_axis(dataset, axis)
    axes = axes_or_new(axes)
    x, y = shown(dataset[axis]), shown(of_lanes(dataset, variable, (axis,)))
    axes.plot(
        x.values,
        y.values,
        "o",
        color=BLUE,
        markersize=4,
        markeredgewidth=0,
        alpha=1.0 if median is None else 0.45,
    )
    if median is not None:
        line = running_median(x.values, y.values, median)
        axes.plot(*line, color=DARK, linewidth=2, label=f"median of {median} neighbours")
    scale_axes(axes, x.values, y.values)
    mark_failed(axes, x.values, ended_well(dataset).values)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
    return dress(axes, x.label, y.label)


def running_median(
    places: np.ndarray, values: np.ndarray, width: int
) -> tuple[np.ndarray, np.ndarray]:
    """Median of `width` neighbouring values, against the median of their places.

    NaN is left out, and so are the ends, which have too few neighbours.

    **Raises:** `ValueError` if there are fewer values than `width`.
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
