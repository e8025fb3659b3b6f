"""Outputs of a sweep over one or two of its parameters."""

from typing import TypedDict

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.patches import Patch

from ..fields.checks import require
from .labels import legend_label, scale_axes, scaled, suits_logarithm, tick_logarithm
from .style import VERMILLION, axes_or_new, dress, inside, next_colour


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


class Fill(TypedDict):
    """Look of an area: colours of its face and hatching, and the pattern of this."""

    facecolor: str
    edgecolor: str
    hatch: str


MISSING = Fill(facecolor="0.85", edgecolor="0.55", hatch="////")


def parameter_map(
    dataset: xr.Dataset, variable: str, x: str, y: str, *, axes: Axes | None = None
) -> Axes:
    """One output of a sweep over two parameters, in colours that a bar explains.

    Lanes that failed or are pending are grey and hatched.

    **Arguments:** `dataset`: of `sweep` or `open_sweep`, with further axes selected away;
    `variable`: the output's name; `x`, `y`: the parameters', to the right and upwards.

    **Returns:** the axes, and colours, logarithmic where values spread over a decade.

    >>> stiffness = cj.Axis(lambda scene: scene.forces["spring"].stiffness, [50, 100, 200, 400])
    >>> speed = cj.Peak(cj.quantities.Velocity("ball"), "m/s")
    >>> mass = cj.Axis(lambda scene: scene.bodies["ball"].mass, [0.5, 1.0])
    >>> axes = {"stiffness": stiffness, "mass": mass}
    >>> found = cj.sweep(scene, state, 0.5, axes, {"speed": speed}, progress=False)
    >>> drawn = plot.parameter_map(found, "speed", "stiffness", "mass")
    """
    axes = axes_or_new(axes)
    right, up = scaled(dataset[x]), scaled(dataset[y])
    values, label, _ = scaled(of_lanes(dataset, variable, (y, x)))
    norm = LogNorm() if suits_logarithm(values) else Normalize()
    mesh = axes.pcolormesh(right.values, up.values, values, norm=norm, shading="nearest")
    scale_axes(axes, right.values, up.values, swept="xy")
    bar = axes.figure.colorbar(mesh, ax=axes, label=label)
    if suits_logarithm(values):
        tick_logarithm(bar.ax.yaxis, values)
    axes.patch.set(**MISSING)
    missing = int((values != values).sum())
    if missing:
        patch = Patch(**MISSING, label=f"failed or pending: {missing}")
        axes.legend(handles=[patch], loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
    dress(axes, right.label, up.label)
    axes.grid(False)
    return axes


Bounds = tuple[float, float]
"""Smallest and largest value of a parameter to take, in the unit of the data set."""


def convergence(
    dataset: xr.Dataset,
    variable: str,
    axis: str | None = None,
    *,
    within: Bounds | None = None,
    label: str | None = None,
    colour: str | None = None,
    axes: Axes | None = None,
) -> Axes:
    """A deviation against a parameter that tends to zero, and the rate at which it follows.

    **Arguments:**

    - `dataset`, `variable`, `axis`: as in `against`; failed lanes are crosses likewise.
    - `within`: values of the parameter between which the rate is fitted and its line drawn; all
      unless given.
    - `label`: of these points in the legend, in front of the rate.
    - `colour`: of the points; unless given, one that the axes do not have yet.
    - `axes`: pass those of another call to compare.

    **Returns:** the axes, logarithmic both ways.

    >>> stiffness = cj.Axis(lambda scene: scene.forces["spring"].stiffness, [50, 100, 200, 400])
    >>> speed = cj.Peak(cj.quantities.Velocity("ball"), "m/s")
    >>> axes = {"stiffness": stiffness}
    >>> found = cj.sweep(scene, state, 0.5, axes, {"speed": speed}, progress=False)
    >>> drawn = plot.convergence(found, "speed")
    """
    axis = only_axis(dataset, axis)
    axes = axes_or_new(axes)
    colour = next_colour(axes) if colour is None else colour
    x = scaled(dataset[axis], axes.get_xlabel())
    y = scaled(of_lanes(dataset, variable, (axis,)), axes.get_ylabel())
    used = inside(dataset[axis].values, within)
    rate, factor = _power_law(x.values[used], y.values[used])
    text = f"rate {round(rate, 2) + 0.0:.2f}"
    text = text if label is None else f"{label}: {text}"
    axes.plot(x.values, y.values, "o", color=colour, markersize=5, markeredgewidth=0)
    ends = np.array([x.values[used].min(), x.values[used].max()])
    axes.plot(ends, factor * ends**rate, color=colour, linewidth=1.5, label=text)
    axes.set(xscale="log", yscale="log")
    mark_failed(axes, x.values, ended_well(dataset).values, colour)
    axes.legend(frameon=False)
    return dress(axes, x.label, y.label)


def power_law_exponent(
    dataset: xr.Dataset, variable: str, axis: str | None = None, *, within: Bounds | None = None
) -> float:
    """The exponent p of the power law C a^p in a parameter a, by least squares of logarithms.

    The arguments are those of `convergence`.

    **Raises:** `ValueError` for fewer than two positive values.

    >>> stiffness = cj.Axis(lambda scene: scene.forces["spring"].stiffness, [50, 100, 200, 400])
    >>> speed = cj.Peak(cj.quantities.Velocity("ball"), "m/s")
    >>> axes = {"stiffness": stiffness}
    >>> found = cj.sweep(scene, state, 0.5, axes, {"speed": speed}, progress=False)
    >>> print(f"{plot.power_law_exponent(found, 'speed'):.3f}")  # 0.1 m times sqrt(k/m)
    0.500
    """
    axis = only_axis(dataset, axis)
    used = inside(dataset[axis].values, within)
    values = of_lanes(dataset, variable, (axis,)).values
    return _power_law(dataset[axis].values[used], values[used])[0]


def _power_law(places: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Exponent and factor of the power law through positive values."""
    there = (places > 0.0) & (values > 0.0)
    require(there.sum() >= 2, "within", values, "where two values are positive", "widen it")
    exponent, logarithm = np.polyfit(np.log(places[there]), np.log(values[there]), 1)
    return float(exponent), float(np.exp(logarithm))
