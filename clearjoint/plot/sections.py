"""Draw Poincaré sections of a run or of a lane, and bifurcation diagrams of a sweep."""

from functools import partial

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.ticker import MaxNLocator

from .._fields.checks import require
from .._fields.drawn_text import shown
from .._simulation.results.solution import Crossings
from . import style
from .journal import clearance_circle
from .sweeps import is_successful, mark_failed, only_axis, require_names, require_several_values


def poincare_map(
    x: np.ndarray, y: np.ndarray, labels: tuple[str, str], *, axes: Axes | None = None
) -> Axes:
    """Draw the points of a Poincaré map: n dots for a motion that repeats after n points, and a
    cloud for a chaotic motion. Later points are darker.

    **Arguments:** `x`, `y`: (N,) coordinates of the points in the order of time; `labels`: texts of
    the horizontal and the vertical axis, with units.

    >>> axes = plot.poincare_map(np.zeros(20), np.linspace(0, 1, 20), ("x / mm", "v / (m/s)"))
    """
    return _mapped(x, y, 1 + np.arange(len(x)), labels, axes)


def _mapped(
    x: np.ndarray, y: np.ndarray, numbers: np.ndarray, labels: tuple[str, str], axes: Axes | None
) -> Axes:
    # `numbers`: of the points, from 1 on; not all successive if earlier crossings are omitted.
    axes = style.axes_or_new(axes, (5.4, 4.8))
    shades = LinearSegmentedColormap.from_list(
        "later is darker", [style.LIGHT, style.BLUE, style.DARK]
    )
    look = {"cmap": shades, "s": 14.0, "linewidths": 0.0, "zorder": 3}
    points = axes.scatter(x, y, c=numbers, **look)
    if len(x) > 1:  # the colour of a single point tells nothing
        bar = axes.figure.colorbar(points, ax=axes, label="number of the crossing")
        bar.ax.yaxis.set_major_locator(MaxNLocator(6, integer=True))
    return style.dress(axes, *labels)


def poincare_section(
    crossings: Crossings,
    channels: tuple[str, str] | None = None,
    *,
    after: float | None = None,
    clearance: float | None = None,
    axes: Axes | None = None,
) -> Axes:
    """Draw two quantities at the section crossings of a run: a few dots for a periodic motion, a
    cloud for a chaotic one. Later points are darker.

    **Arguments:**

    - `crossings`: recorded crossings, ``solution.outputs[name]`` of a `Section` of this name.
    - `channels`: names of the two recorded quantities, the section's channels, that are drawn to
      the right and upwards; by default the first two, or the time and the only channel.
    - `after`: time, s; crossings before this time, such as those of the transient, are omitted.
    - `clearance`: radius of a circle to draw, m, for channels that are the `JournalOffset` of a
      joint with this clearance.

    **Returns:** the axes, with equal scales for channels of the same unit and a similar size.

    **Raises:** `ValueError` for channels that the section lacks, a `clearance` with channels that
    are not lengths, and if all crossings are earlier than `after`.

    >>> values, units = {"x": np.array([1e-4, 2e-4, 1e-4]), "y": np.zeros(3)}, {"x": "m", "y": "m"}
    >>> axes = plot.poincare_section(cj.results.Crossings(np.arange(3.0), values, units))
    >>> axes.get_xlabel()
    'x, µm'
    """
    # A single channel is drawn over the time of the crossings.
    recorded = {"time": (crossings.times, "s")} if len(crossings.values) < 2 else {}
    recorded |= {n: (row, crossings.units.get(n, "1")) for n, row in crossings.values.items()}
    chosen = tuple(recorded)[:2] if channels is None else tuple(channels)
    is_valid = len(chosen) == 2 and set(chosen) <= set(recorded)
    expected = f"two of those of the section, {list(recorded)}"
    require(is_valid, "channels", chosen, expected, "record two channels and name them")
    times, units = np.asarray(crossings.times), [recorded[name][1] for name in chosen]
    is_drawn = np.full(len(times), True) if after is None else times >= after
    last = f"at most that of the last crossing, {times.max(initial=0.0):.6g} s"
    require(bool(is_drawn.any()) or after is None, "after", after, last, "give an earlier time")
    is_drawable = clearance is None or set(units) == {"m"}
    require(is_drawable, "clearance", clearance, f"None for channels in {units}", "leave it out")
    rows = [np.asarray(recorded[name][0])[is_drawn] for name in chosen]
    sizes = [np.abs(row[np.isfinite(row)]).max(initial=0.0) for row in rows]
    # Channels of the same unit and a similar size get the same prefix and the same scale, as both
    # components of a vector should; if one is 20 times the other, the points would lie on a line.
    # With a circle the scales must be the same, whatever the sizes.
    largest = max(*sizes, 0.0 if clearance is None else clearance)
    similar = units[0] == units[1] and largest <= 20.0 * min(sizes)
    same_scale = similar or clearance is not None
    columns = []
    for name, unit, row, size in zip(chosen, units, rows, sizes, strict=True):
        factor, text = style.fitting_unit(np.array([largest if same_scale else size]), unit)
        suffix = "" if text == "1" else f", {text}"
        columns.append((row * factor, f"{shown(name.replace('_', ' '))}{suffix}", factor))
    (x, x_label, factor), (y, y_label, _) = columns
    axes = _mapped(x, y, 1 + np.flatnonzero(is_drawn), (x_label, y_label), axes)
    if clearance is not None:
        clearance_circle(axes, clearance, factor=factor)
    if same_scale:
        # The limits are widened for equal scales. With a circle the axes are made smaller instead,
        # so that the circle fills them.
        axes.set_aspect("equal", adjustable="datalim" if clearance is None else "box")
    if after is not None:
        text = f"{is_drawn.sum()} of {len(is_drawn)} crossings, from {after:g} s on"
        axes.set_title(text, fontsize="small", loc="right")
    return axes


def poincare_section_of_lane(
    lane: xr.Dataset,
    section: str,
    channels: tuple[str, str],
    *,
    after: float | None = None,
    clearance: float | None = None,
    axes: Axes | None = None,
) -> Axes:
    """Draw two quantities, the `channels`, at the crossings of the output `section` in one lane of
    a sweep. Further arguments are those of `poincare_section`.

    **Raises:** `ValueError` also for a lane that has not run yet.

    >>> lane = found.sel(stiffness=100.0)
    >>> drawn = plot.poincare_section_of_lane(lane, "turns", ("x", "speed"))
    """
    names = [f"{section}_{channel}" for channel in channels]
    require_names(lane, (*names, f"{section}_count", f"{section}_time"))
    count = lane[f"{section}_count"]
    require(count.ndim == 0, "lane", count.dims, "a single lane", "select one: dataset.isel(...)")
    # The count of a pending lane is negative.
    expected, remedy = "a lane that has run", "continue the sweep first, or select another lane"
    require(int(count) >= 0, "lane", f"{section}_count = {int(count)}", expected, remedy)
    # The arrays of a lane may have space for more crossings than it has.
    recorded = slice(int(count))
    columns = dict(zip(channels, (lane[name] for name in names), strict=True))
    values = {channel: column.values[recorded] for channel, column in columns.items()}
    units = {channel: column.attrs.get("units", "1") for channel, column in columns.items()}
    crossings = Crossings(lane[f"{section}_time"].values[recorded], values, units)
    return poincare_section(crossings, channels, after=after, clearance=clearance, axes=axes)


def bifurcation(
    dataset: xr.Dataset,
    section: str,
    channel: str,
    axis: str | None = None,
    *,
    number: bool = False,
    axes: Axes | None = None,
) -> Axes:
    """Draw a bifurcation diagram of a sweep: a quantity at the section crossings over a parameter,
    `axis`, by default the only one. Each dot is a crossing. Values with periodic motions have few
    different dots, which form curves; those with chaotic motions have a cloud.

    **Arguments:**

    - `section`, `channel`: names of the `Section` and of its recorded quantity to draw. Instead of
      a section, an output that is sampled once a period can be drawn: for its name "a_b", pass "a"
      and "b".
    - `number`: whether colours show the crossings' numbers, from 1 on; useful if the motion decays.

    >>> drawn = plot.bifurcation(found, "turns", "x")
    """
    axis = only_axis(dataset, axis)
    variable = f"{section}_{channel}"
    require_names(dataset, (variable, axis))
    require_several_values(dataset, (axis,))
    axes = style.axes_or_new(axes)
    succeeded = is_successful(dataset)
    # The last dimension is that along the crossings, or the samples, of a lane.
    recorded = dataset[variable].where(succeeded).transpose(*dataset[axis].dims, ...)
    x, y = style.scaled(dataset[axis]), style.scaled(recorded.rename(channel))
    # The parameter and the number of each crossing, in the shape of `y`: (lanes, crossings).
    positions, numbers = np.meshgrid(x.values, 1 + np.arange(y.values.shape[1]), indexing="ij")
    draw = partial(axes.scatter, positions, y.values, s=3, linewidths=0)
    if not number:
        draw(color=style.DARK)
    else:
        # In a motion that decays, the first crossings differ most, so they get most of the colours.
        last = numbers[np.isfinite(y.values)].max(initial=1)
        dots = draw(c=numbers, cmap="turbo_r", norm=LogNorm(1, last))
        bar = axes.figure.colorbar(dots, ax=axes, label="number of the crossing")
        style.tick_logarithm(bar.ax.yaxis, numbers)
    style.scale_axes(axes, x.values, y.values)
    mark_failed(axes, x.values, succeeded.values)
    if not succeeded.all():
        style.legend_above(axes)
    return style.dress(axes, x.label, y.label)
