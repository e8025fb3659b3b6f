"""Poincaré sections of a sweep: bifurcation diagrams."""

from functools import partial

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm

from .labels import scale_axes, scaled, tick_logarithm
from .outcomes import ended_well, mark_failed, only_axis, require_names
from .style import DARK, axes_or_new, dress


def bifurcation(
    dataset: xr.Dataset,
    section: str,
    channel: str,
    axis: str | None = None,
    *,
    number: bool = False,
    axes: Axes | None = None,
) -> Axes:
    """What a section records against a swept parameter, a dot for each crossing.

    A periodic motion shows as a few curves, a chaotic one as a cloud. Lanes that failed or are
    pending are left out, and are crosses at the foot of the axes.

    **Arguments:**

    - `dataset`: of `sweep` or `open_sweep`, with other axes selected away.
    - `section`, `channel`: names of the `Section` and of what it records.
    - `axis`: the parameter's name; unless given, the sweep's only one.
    - `number`: whether colours tell which crossing it is, for motions that do not repeat.

    **Returns:** the axes, logarithmic where values spread over a decade.

    >>> stiffness = cj.Axis(lambda scene: scene.forces["spring"].stiffness, [50, 100, 200, 400])
    >>> speed = cj.Peak(cj.quantities.Velocity("ball"), "m/s")
    >>> position = cj.quantities.Position("ball", "x")
    >>> still = cj.Section(cj.quantities.Velocity("ball", "x"), {"x": (position, "m")}, count=3)
    >>> save, axes = cj.Saving(sections={"still": still}), {"stiffness": stiffness}
    >>> found = cj.sweep(scene, state, 2.0, axes, {"speed": speed}, save=save, progress=False)
    >>> drawn = plot.bifurcation(found, "still", "x")
    """
    axis = only_axis(dataset, axis)
    variable = f"{section}_{channel}"
    require_names(dataset, (variable, axis))
    axes = axes_or_new(axes)
    well = ended_well(dataset)
    crossings = f"{section}_number"
    recorded = dataset[variable].where(well).transpose(*dataset[axis].dims, crossings)
    x, y = scaled(dataset[axis]), scaled(recorded.rename(channel))
    places, numbers = np.meshgrid(x.values, 1 + np.arange(y.values.shape[1]), indexing="ij")
    draw = partial(axes.scatter, places, y.values, s=3, linewidths=0)
    if not number:
        draw(color=DARK)
    else:
        dots = draw(c=numbers, cmap="turbo_r", norm=LogNorm())
        bar = axes.figure.colorbar(dots, ax=axes, label="number of the crossing")
        tick_logarithm(bar.ax.yaxis, numbers)
    scale_axes(axes, x.values, y.values)
    mark_failed(axes, x.values, well.values)
    if not well.all():
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
    return dress(axes, x.label, y.label)
