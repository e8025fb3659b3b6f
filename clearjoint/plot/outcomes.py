"""Lanes of a sweep that ran to their end, which are drawn, and marks for the others."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from ..fields.checks import require
from .style import VERMILLION


def ended_well(dataset: xr.Dataset) -> xr.DataArray:
    """Which lanes ran to their end, by their result codes."""
    attributes = dataset["result"].attrs
    codes = dict(zip(attributes["flag_meanings"].split(), attributes["flag_values"], strict=True))
    return dataset["result"] == codes["successful"]


def of_lanes(dataset: xr.Dataset, variable: str, along: tuple[str, ...]) -> xr.DataArray:
    """One number for each lane along the given axes; NaN where a lane did not run to its end.

    **Raises:** `ValueError` if the sweep has no such variable or axis, or the variable has other
    dimensions than these axes.
    """
    require_names(dataset, (variable, *along))
    dims = tuple(dataset[axis].dims[0] for axis in along)
    require(
        sorted(map(str, dataset[variable].dims)) == sorted(map(str, dims)),
        "variable",
        f"{variable} along {dataset[variable].dims}",
        f"a number for each value of {along}",
        "select along the other dimensions first: dataset.sel(...)",
    )
    return dataset[variable].where(ended_well(dataset)).transpose(*dims)


def only_axis(dataset: xr.Dataset, axis: str | None) -> str:
    """The name of the axis to draw against; the sweep's only one unless given."""
    if axis is not None:
        return axis
    dims = dataset["result"].dims
    require(
        len(dims) == 1 and dims[0] in dataset.coords,
        "axis",
        axis,
        f"one of {tuple(map(str, dataset['result'].coords))}",
        "name it",
    )
    return str(dims[0])


def mark_failed(axes: Axes, places: np.ndarray, well: np.ndarray, colour: str = VERMILLION) -> None:
    """Crosses at the foot of the axes where lanes did not run to their end."""
    missing = places[~well]
    if missing.size:
        axes.plot(
            missing,
            np.full(missing.shape, 0.02),
            "x",
            color=colour,
            transform=axes.get_xaxis_transform(),
            clip_on=False,
            label=f"failed or pending: {missing.size}",
        )


def require_names(dataset: xr.Dataset, names: tuple[str, ...]) -> None:
    """Check that a data set has variables of these names."""
    unknown = [name for name in names if name not in dataset.variables]
    require(
        not unknown,
        "dataset",
        unknown,
        f"names out of {sorted(map(str, dataset.variables))}",
        "pass names of this sweep",
    )
