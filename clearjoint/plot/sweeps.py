"""Draw outputs of a sweep over one or two of its parameters."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.patches import Patch

from .._fields.checks import errors_about, require
from . import style


def is_successful(dataset: xr.Dataset) -> xr.DataArray:
    """Return whether each lane ran to its end: false if it failed or has not run yet."""
    # The meanings of the numbers are attributes by the CF conventions of netCDF files.
    attributes = dataset["result"].attrs
    codes = dict(zip(attributes["flag_meanings"].split(), attributes["flag_values"], strict=True))
    return dataset["result"] == codes["successful"]


def of_lanes(dataset: xr.Dataset, variable: str, along: tuple[str, ...]) -> xr.DataArray:
    """Return the output `variable` as an array whose dimensions are the sweep's axes `along`, NaN
    where a lane failed or has not run yet; refuse an output that has other dimensions."""
    require_names(dataset, (variable, *along))
    require_several_values(dataset, along)
    # Axes that vary together share the dimension "lane".
    dims = tuple(dataset[axis].dims[0] for axis in along)
    actual, expected = dataset[variable].dims, f"a number for each value of {along}"
    is_valid = sorted(map(str, actual)) == sorted(map(str, dims))
    remedy = "select along the other dimensions first: dataset.sel(...)"
    require(is_valid, "variable", f"{variable} along {actual}", expected, remedy)
    return dataset[variable].where(is_successful(dataset)).transpose(*dims)


def only_axis(dataset: xr.Dataset, axis: str | None) -> str:
    """Return `axis` or, if it is None, the name of the sweep's only axis. Raise a `ValueError` for
    an unknown `axis` and, if it is None, for a sweep with several axes or a zipped sweep."""
    if axis is not None:
        require_names(dataset, (axis,))
        return axis
    dims, swept = dataset["result"].dims, tuple(map(str, dataset["result"].coords))
    # The dimension "lane" of a zipped sweep has no coordinate of that name.
    is_only = len(dims) == 1 and dims[0] in dataset.coords
    require(is_only, "axis", axis, f"one of {swept}", "name it")
    return str(dims[0])


def mark_failed(
    axes: Axes, positions: np.ndarray, successful: np.ndarray, colour: str = style.VERMILLION
) -> None:
    """Draw crosses at the lower edge, at the horizontal `positions` (L,) of the lanes that are not
    `successful` (L,): those that failed or have not run yet."""
    missing = positions[~successful]
    if missing.size:
        axes.plot(
            missing,
            np.full(missing.shape, 0.02),  # a fraction of the height of the axes
            "x",
            color=colour,
            transform=axes.get_xaxis_transform(),
            clip_on=False,
            label=f"failed or pending: {missing.size}",
        )


def require_names(dataset: xr.Dataset, names: tuple[str, ...]) -> None:
    """Raise a `ValueError` if a data set lacks a variable or coordinate of one of these names."""
    unknown = [name for name in names if name not in dataset.variables]
    expected = f"names out of {sorted(map(str, dataset.variables))}"
    require(not unknown, "dataset", unknown, expected, "pass names of this sweep")


def require_several_values(dataset: xr.Dataset, along: tuple[str, ...]) -> None:
    """Raise a `ValueError` if `dataset` has only one selected value of an axis in `along`."""
    single = [axis for axis in along if not dataset[axis].dims]
    expected = "a swept parameter with more than one value left"
    require(not single, "axis", single, expected, "draw the output before that value is selected")


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
    """Draw an output of a sweep, such as a peak force, over the swept parameter `axis`, by default
    the only one, as a point for each lane.

    **Arguments:**

    - `median`: number of neighbouring lanes over which a running median is drawn as a line, which
      shows the trend in the scatter of chaotic motion. No line by default.
    - `label`: text of the legend; by default the name of the output and the selected values.
    - `colour`: colour of the points; by default one that the axes do not have yet.
    - `axes`: such as those of an earlier call, to whose units values are converted.

    >>> drawn = plot.against(found, "speed")
    """
    axis = only_axis(dataset, axis)
    axes = style.axes_or_new(axes)
    colour = style.next_colour(axes) if colour is None else colour
    label = style.legend_label(dataset, variable, axis) if label is None else label
    # Axes of an earlier call already have labels, with the units to which values are converted.
    x = style.scaled(dataset[axis], axes.xaxis)
    y = style.scaled(of_lanes(dataset, variable, (axis,)), axes.yaxis)
    axes.plot(
        x.values,
        y.values,
        "o",
        color=colour,
        markersize=4,
        markeredgewidth=0,
        alpha=1.0 if median is None else 0.45,  # the line of medians is seen over faint points
        label=label,
    )
    if median is not None:
        with errors_about("median"):
            line = running_median(x.values, y.values, median)
        axes.plot(*line, color=colour, linewidth=2, label=f"median of {median} neighbours")
    style.scale_axes(axes, x.values, y.values)
    mark_failed(axes, x.values, is_successful(dataset).values, colour)
    labels = axes.get_legend_handles_labels()[1]
    if len(labels) > 1:  # points of a single kind need no legend
        # Two labels of more than 40 characters are too wide for the figure side by side.
        style.legend_above(axes, 1 if max(map(len, map(str, labels))) > 40 else 2)
    return style.dress(axes, x.label, y.label)


def running_median(
    positions: np.ndarray, values: np.ndarray, width: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return running medians of values over positions, (n - width + 1,) each: each group of `width`
    successive points gives the median of its positions and of its values.

    **Arguments:** `positions`, `values`: (N,); the n points whose value is finite are used.

    >>> values = np.array([1.0, 9.0, 2.0, 3.0, 4.0])
    >>> positions, medians = plot.running_median(np.arange(5.0), values, 3)
    >>> medians
    array([2., 3., 3.])
    """
    positions, values = np.asarray(positions), np.asarray(values)
    expected, remedy = f"of the shape {positions.shape} of the positions", "pass a value for each"
    require(values.shape == positions.shape, "values", values.shape, expected, remedy)
    finite = np.isfinite(values)
    count = int(finite.sum())
    require(1 <= width <= count, "width", width, f"between 1 and {count} values", "lower it")
    order = np.argsort(positions[finite], kind="stable")
    # The view has the shape (n - width + 1, width): a row for each group.
    x, y = (
        np.median(np.lib.stride_tricks.sliding_window_view(column[finite][order], width), axis=1)
        for column in (positions, values)
    )
    return x, y


MISSING = {"facecolor": "0.85", "edgecolor": "0.55", "hatch": "////"}
"""Style of the cells of a map whose lane failed, has not run yet, or has NaN as its output."""


def parameter_map(
    dataset: xr.Dataset, variable: str, x: str, y: str, *, axes: Axes | None = None
) -> Axes:
    """Draw an output of a sweep over two swept parameters, as colours with a colour bar. Lanes that
    failed, have not run yet or whose output is NaN are grey and hatched.

    **Arguments:** `x`, `y`: names of the parameters that are drawn to the right and upwards.

    >>> masses = cj.Axis(lambda scene: scene.bodies["ball"].mass, [0.5, 1.0])
    >>> both = {"stiffness": values, "mass": masses}
    >>> found = cj.sweep(scene, state, 0.5, both, outputs, progress=False)
    >>> drawn = plot.parameter_map(found, "speed", "stiffness", "mass")
    """
    # Cells end midway between neighbours, so that these must be in order.
    lanes = of_lanes(dataset, variable, (y, x)).sortby([y, x])
    values, label, _ = style.scaled(lanes)
    axes = style.axes_or_new(axes)
    x_data, y_data = style.scaled(lanes[x]), style.scaled(lanes[y])
    norm = LogNorm() if style.suits_logarithm(values) else Normalize()
    style.scale_axes(axes, x_data.values, y_data.values, swept="xy")
    edges = _edges(x_data.values, axes.get_xscale()), _edges(y_data.values, axes.get_yscale())
    mesh = axes.pcolormesh(*edges, values, norm=norm)
    bar = axes.figure.colorbar(mesh, ax=axes, label=label)
    if style.suits_logarithm(values):
        style.tick_logarithm(bar.ax.yaxis, values)
    # Cells without a number are transparent: the background is seen there.
    axes.patch.set(**MISSING)
    missing = int((~np.isfinite(values)).sum())
    if missing:
        patch = Patch(label=f"failed or pending: {missing}")
        patch.set(**MISSING)
        style.legend_above(axes, handles=[patch])
    style.dress(axes, x_data.label, y_data.label)
    axes.grid(False)  # the grid of `dress` would be seen through the cells without a number
    return axes


def _edges(values: np.ndarray, scale: str) -> np.ndarray:
    """Return the edges, (n + 1,), of cells around ascending values (n,), midway between neighbours
    on an axis with a "linear" or "log" scale."""
    places = np.log(values) if scale == "log" else values
    # A single value has no neighbours: any width makes its cell visible.
    halves = 0.5 * np.diff(places) if len(places) > 1 else 0.5 * np.abs(places) + (places == 0.0)
    inner = 0.5 * (places[1:] + places[:-1])
    edges = np.concatenate([places[:1] - halves[:1], inner, places[-1:] + halves[-1:]])
    return np.exp(edges) if scale == "log" else edges


def convergence(
    dataset: xr.Dataset,
    variable: str,
    axis: str | None = None,
    *,
    within: tuple[float, float] | None = None,
    label: str | None = None,
    colour: str | None = None,
    axes: Axes | None = None,
) -> Axes:
    """Draw an output, such as an error, over a parameter a that tends to zero, on logarithmic axes,
    and the power law C a^p that fits the logarithms of the positive outputs best, by least squares.
    The legend gives the rate p.

    **Arguments:** `within`: smallest and largest parameter of the lanes that are fitted, in the
    unit of the data set; by default all lanes are fitted. `label`: text of the legend before the
    rate. `colour`: of the points and the line. `axes`: such as those of an earlier call.

    **Raises:** `ValueError` for fewer than two lanes to fit with positive parameter and output.

    >>> drawn = plot.convergence(found, "speed")
    """
    axis = only_axis(dataset, axis)
    axes = style.axes_or_new(axes)
    colour = style.next_colour(axes) if colour is None else colour
    x = style.scaled(dataset[axis], axes.xaxis)
    y = style.scaled(of_lanes(dataset, variable, (axis,)), axes.yaxis)
    used = style.inside(dataset[axis].values, within, "within", "swept values", "widen it")
    rate, factor, fitted = _power_law(x.values[used], y.values[used])
    # Adding zero makes the "-0.00" of a small negative rate "0.00".
    text = f"rate {round(rate, 2) + 0.0:.2f}"
    text = text if label is None else f"{label}: {text}"
    axes.plot(x.values, y.values, "o", color=colour, markersize=5, markeredgewidth=0)
    ends = np.array([fitted.min(), fitted.max()])
    axes.plot(ends, factor * ends**rate, color=colour, linewidth=1.5, label=text)
    axes.set(xscale="log", yscale="log")
    mark_failed(axes, x.values, is_successful(dataset).values, colour)
    axes.legend(frameon=False)
    return style.dress(axes, x.label, y.label)


def power_law_exponent(
    dataset: xr.Dataset,
    variable: str,
    axis: str | None = None,
    *,
    within: tuple[float, float] | None = None,
) -> float:
    """Return the exponent p of the power law that `convergence` draws, for the same arguments.

    >>> print(f"{plot.power_law_exponent(found, 'speed'):.3f}")  # 0.1 m times sqrt(k/m)
    0.500
    """
    axis = only_axis(dataset, axis)
    used = style.inside(dataset[axis].values, within, "within", "swept values", "widen it")
    values = of_lanes(dataset, variable, (axis,)).values
    return _power_law(dataset[axis].values[used], values[used])[0]


def _power_law(x: np.ndarray, y: np.ndarray) -> tuple[float, float, np.ndarray]:
    # The exponent p and the factor C of y = C x^p, and those x at which x and y are positive.
    positive = (x > 0.0) & (y > 0.0)
    require(positive.sum() >= 2, "within", y, "with at least two positive values", "widen it")
    exponent, logarithm = np.polyfit(np.log(x[positive]), np.log(y[positive]), 1)
    return float(exponent), float(np.exp(logarithm)), x[positive]
