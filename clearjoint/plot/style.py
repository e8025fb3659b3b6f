"""Look of all figures: colours, line styles, labels, units with SI prefixes, and scales."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import cycle
from textwrap import fill
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backend_bases import RendererBase
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter
from matplotlib.transforms import Bbox

from .._fields.checks import as_shown, require, require_type
from .._fields.drawn_text import broken, shown
from .._fields.types import ArrayLike

BLUE, VERMILLION, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
SKY, ORANGE = "#56B4E9", "#E69F00"
DARK, LIGHT, GREY = "#16324F", "#BBDDF2", "#8C8C8C"
Dashes = str | tuple[int, tuple[int, ...]]
"""A line style of matplotlib: its symbol, or an offset and the lengths of dashes and gaps."""
LINES: tuple[tuple[str, Dashes], ...] = (
    (BLUE, "-"),
    (VERMILLION, "--"),
    (GREEN, "-."),
    (PURPLE, ":"),
    (SKY, (0, (8, 2))),
    (ORANGE, (0, (6, 1, 1, 1, 1, 1))),
)
"""Colours (of M. Okabe and K. Ito, which colour-blind people can distinguish) and line styles."""
TimeSpan = tuple[float, float]
"""Start and end of the drawn time, s."""


def lines() -> Iterator[tuple[str, Dashes]]:
    """Return an iterator without end over colours and line styles for successive curves."""
    return cycle(LINES)


def next_colour(axes: Axes) -> str:
    """Return the first colour of `LINES` that no line on the axes has, or else the rarest one."""
    drawn = [to_hex(line.get_color()).upper() for line in axes.get_lines()]
    return min((colour for colour, _ in LINES), key=drawn.count)


def axes_or_new(axes: Axes | None, size: tuple[float, float] = (6.4, 4.0)) -> Axes:
    """Return `axes`, or if it is None those of a new figure of width and height `size`, inches."""
    return plt.subplots(figsize=size, layout="constrained")[1] if axes is None else axes


def panels(
    count: int, size: tuple[float, float], ratios: Sequence[float] = (1.0,), *, sharex: bool = False
) -> tuple[Figure, np.ndarray]:
    """Return a new figure and the axes of `count` panels, side by side in pairs. A panel of width
    and height `size`, inches, has axes one above the other, with heights in the `ratios`; the array
    of axes is (len(ratios), count). `sharex`: whether all axes have the same horizontal limits."""
    columns, axes_in_panel = min(2, count), len(ratios)
    rows = -(-count // columns)  # rounded up: the last row may have a single panel
    figure, grid = plt.subplots(
        axes_in_panel * rows,
        columns,
        figsize=(size[0] * columns, size[1] * rows),
        height_ratios=[*ratios] * rows,
        sharex=sharex,
        squeeze=False,
        layout="constrained",
    )
    # From (axes_in_panel * rows, columns), as in the figure, to a column of axes for each panel.
    grid_of_panels = grid.reshape(rows, axes_in_panel, columns)
    axes = grid_of_panels.swapaxes(0, 1).reshape(axes_in_panel, -1)
    for empty in axes[:, count:].flat:
        empty.set_visible(False)
    return figure, axes[:, :count]


def polar_or_new(axes: Axes | None) -> PolarAxes:
    """Return polar axes, by default new ones, with grid lines at every 45°; refuse other axes."""
    if axes is None:
        axes = plt.figure(figsize=(4.8, 5.0), layout="constrained").add_subplot(projection="polar")
    remedy = 'make them by subplots(subplot_kw={"projection": "polar"})'
    require_type("axes", axes, PolarAxes, "polar axes", remedy)
    assert isinstance(axes, PolarAxes)
    axes.grid(True, color="0.85", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.set_xticks(np.arange(0.0, 2.0 * np.pi, 0.25 * np.pi))
    return axes


def dress(axes: Axes, x: str, y: str) -> Axes:
    """Give axes labels, broken into lines if they are long, and the common look of figures."""
    axes.set_xlabel(broken(x))
    axes.set_ylabel(broken(y))
    axes.grid(True, color="0.9", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    return axes


def draw_lines(
    axes: Axes, curves: Iterable[tuple[str, ArrayLike, ArrayLike]], linewidth: float = 1.5
) -> None:
    """Draw curves, each with label, x (N,) and y (N,), that differ by colour and line style, also
    from lines already on the axes."""
    for label, x, y in curves:
        colour = next_colour(axes)
        style = dict(LINES)[colour]
        axes.plot(x, y, color=colour, linestyle=style, linewidth=linewidth, label=label)


def legend_above(
    axes: Axes,
    columns: int = 1,
    *,
    handles: Sequence[Artist] | None = None,
    handlelength: float | None = None,
    height: float = 1.0,
) -> None:
    """Add a legend in `columns` columns without a frame above the axes, for the `handles`, by
    default all labelled curves. `height`: of the legend's lower edge, in heights of the axes."""
    if not any(child.get_label() == ROOM for child in axes.child_axes):
        # Matplotlib places titles above child axes, but not above legends. An empty child as large
        # as the legend keeps the title from covering the legend.
        room = axes.inset_axes((0.0, 1.0, 1.0, 0.0), label=ROOM)
        room.set_axis_off()
        room.set_in_layout(False)
        room.set_navigate(False)
        room.set_axes_locator(lambda *arguments: _legend_box(axes, *arguments))
    axes.legend(
        handles=handles,
        loc="lower center",
        bbox_to_anchor=(0.5, height),
        ncols=columns,
        frameon=False,
        handlelength=handlelength,
    )


ROOM = "room of the legend"
"""Label of the empty axes that `legend_above` adds."""


def _legend_box(axes: Axes, _room: Axes, renderer: RendererBase | None) -> Bbox:
    # The box of the legend or, without one, the upper edge of the axes, in fractions of the figure.
    legend = axes.get_legend()
    box = Bbox([[axes.bbox.x0, axes.bbox.y1], [axes.bbox.x1, axes.bbox.y1]])
    if legend is not None and legend.get_visible():
        box = legend.get_window_extent(renderer)
    return box.transformed(axes.figure.transSubfigure.inverted())


def fit_labels(figure: Figure) -> None:
    """Break labels that are longer than their axes into lines."""
    figure.draw_without_rendering()
    for axes in figure.findobj(Axes):
        for label, vertical in ((axes.xaxis.label, False), (axes.yaxis.label, True)):
            if not (text := label.get_text()):
                continue
            box, space = label.get_window_extent(), axes.get_window_extent()
            # The length of the axis over that of the label.
            share = space.height / box.height if vertical else space.width / box.width
            if share < 0.9:  # a label may be a little longer than its axis
                fitting = int(share * max(map(len, text.split("\n"))))
                letters = max(fitting, 8)  # no column of single words beside short axes
                label.set_text(fill(text.replace("\n", " "), letters, break_long_words=False))


def limit_to_window(
    axes: Axes, times: np.ndarray, window: TimeSpan | None, factor: float = 1.0
) -> np.ndarray:
    """Limit an axis that shows times in s multiplied by `factor` to a window, s, if one is given.
    Return the mask (N,) of the `times` to draw: those in the window and the nearest one on either
    side, so that curves reach its edges."""
    if window is None:
        return np.full(np.shape(times), True)
    overlaps = max(window[0], times[0]) <= min(window[1], times[-1])
    expected = f"an interval within {as_shown(times[0])} to {as_shown(times[-1])} s"
    require(overlaps, "window", window, expected, "give the start and end of the drawn time")
    axes.set_xlim(factor * window[0], factor * window[1])
    # The last time up to the window's start, and the first one from its end on.
    before = np.searchsorted(times, window[0], "right") - 1
    after = np.searchsorted(times, window[1])
    index = np.arange(len(times))
    return (index >= before) & (index <= after)


def inside(
    values: np.ndarray,
    window: tuple[float, float] | None,
    argument: str = "window",
    contents: str = "observed times",
    remedy: str = "widen it, or observe at more instants",
) -> np.ndarray:
    """Return a mask (N,) of the `values` in `window`, all of them if it is ``None``. Raise a
    `ValueError` if no value is in it; the last three arguments are for the text of this error."""
    first, last = (-np.inf, np.inf) if window is None else window
    mask = (values >= first) & (values <= last)
    require(window is None or mask.any(), argument, window, f"an interval with {contents}", remedy)
    return mask


PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M"}
"""SI prefixes by their power of ten."""
PREFIXED = ("m", "s", "N", "J", "W", "Pa", "Hz", "rad", "N s")
"""Units that take a prefix, also as numerators: mm/s."""
GEOMETRIC = 1e-6
"""Numbers count as equal if they differ by at most this fraction of their mean."""


UNIT = "_unit_without_prefix"
"""Attribute by which `scaled` knows the unit of the data that it drew on an axis."""


class ScaledValues(NamedTuple):
    """Values in a unit with a prefix, the text of their axis, such as "force, kN", and the factor
    from the SI unit."""

    values: np.ndarray
    label: str
    factor: float


def scaled(data: xr.DataArray, axis: Axis | None = None) -> ScaledValues:
    """Return data with the prefix that brings the largest magnitude between 1 and 1000. If the
    `axis` to draw on has a label already, such as "force, kN", take its unit instead, and add the
    name of the data to the label. Store the unit without prefix in the `axis`."""
    values = np.asarray(data.values, dtype=float)
    exponent, unit = _prefixed(values, data.attrs.get("units", "1"))
    base = unit.removeprefix(PREFIXES[exponent])
    name = shown(str(data.name).replace("_", " "))
    present = "" if axis is None else axis.get_label_text()
    if present:  # both data have one axis, and thus one prefix
        names = present.replace("\n", " ")
        # Unit without prefix of the data drawn before. If another function has labelled the axis,
        # it is ``None``, and only the label tells the unit.
        base_before = getattr(axis, UNIT, None)
        remedy = "draw it into new axes"
        if unit != "1":  # only labels of data with a unit end with one
            exponents = {prefix + base: power for power, prefix in PREFIXES.items()}
            names, _, unit = names.rpartition(", ")
            fits = unit in exponents and base_before in (base, None)
            require(fits, "axes", base, f"of an axis with the unit of {present!r}", remedy)
            exponent = exponents[unit]
        else:
            # Data without unit don't fit an axis whose label ends with a unit, such as "mm/s".
            last = names.rpartition(", ")[2].split("/")[0]
            has_unit = last in {
                prefix + plain for prefix in PREFIXES.values() for plain in PREFIXED
            }
            fits = base_before == "1" or (base_before is None and not has_unit)
            require(fits, "axes", present, "axes of data in 1", remedy)
        # The label lists the names of all data on the axis, each once.
        name = names if name in names.split(", ") else f"{names}, {name}"
    if axis is not None:
        setattr(axis, UNIT, base)
    factor = 10.0**-exponent
    return ScaledValues(values * factor, name if unit == "1" else f"{name}, {unit}", factor)


def legend_label(dataset: xr.Dataset, variable: str, axis: str) -> str:
    """Return the legend's text for an output of a sweep, such as "peak force, clearance 0.2 mm":
    its name, and the values selected on all axes but `axis`, which is drawn."""
    texts = [shown(variable.replace("_", " "))]
    for name, coordinate in dataset.coords.items():
        if coordinate.ndim > 0 or name == axis:  # no single value is selected
            continue
        if coordinate.dtype.kind not in "biuf":  # a text, such as the name of a body
            texts.append(shown(f"{str(name).replace('_', ' ')} {coordinate.values}"))
        else:
            value, label, _ = scaled(coordinate)
            has_unit = coordinate.attrs.get("units", "1") != "1"
            title, _, unit = label.rpartition(", ") if has_unit else (label, "", "")
            texts.append(f"{title} {float(value):.4g} {unit}".strip())
    return ", ".join(texts)


def fitting_unit(values: np.ndarray, unit: str) -> tuple[float, str]:
    """Return the factor from `unit`, an SI unit, to the unit in which to draw `values`, and the
    text of this unit. Its prefix brings the largest magnitude between 1 and 1000. But metres,
    seconds and radians get neither k nor M, and units that are not in `PREFIXED` get no prefix.
    Forces are in N if all are below 10 kN, else in kN."""
    if unit == "N":
        return (1e-3, "kN") if np.nanmax(np.abs(values), initial=0.0) >= 1e4 else (1.0, "N")
    exponent, text = _prefixed(np.asarray(values, dtype=float), unit)
    return 10.0**-exponent, text


def time_unit(times: np.ndarray, window: TimeSpan | None = None) -> tuple[float, str]:
    """Return the factor from s to the unit of a time axis, and its text: ms if the window or,
    without one, all times are within 2 s of zero, else s."""
    last = np.abs(np.asarray(times if window is None else window, dtype=float)).max(initial=0.0)
    return (1e3, "ms") if last < 2.0 else (1.0, "s")


def time_axis(
    axes: Axes, times: np.ndarray, window: TimeSpan | None
) -> tuple[np.ndarray, np.ndarray, str]:
    """Limit a time axis to a window, s, if one is given. Return the mask (N,) of the `times` to
    draw, these times in ms or s, and the axis label."""
    factor, unit = time_unit(times, window)
    times = np.asarray(times)
    mask = limit_to_window(axes, times, window, factor)
    return mask, factor * times[mask], f"time, {unit}"


def _prefixed(values: np.ndarray, unit: str) -> tuple[int, str]:
    """Return the power of ten of the prefix that suits `values`, or 0, and the unit with it."""
    text = unit.replace("^2", "²").replace("^3", "³")
    first = unit.split("/")[0]  # a prefix scales the numerator: mm/s for m/s
    largest = np.abs(values[np.isfinite(values)]).max(initial=0.0)
    if first not in PREFIXED or largest == 0.0:
        return 0, text
    highest = 0 if first in ("m", "s", "rad") else max(PREFIXES)  # no kilometres or kiloseconds
    exponent = int(np.clip(3 * np.floor(np.log10(largest) / 3), min(PREFIXES), highest))
    return exponent, PREFIXES[exponent] + text


def suits_logarithm(values: np.ndarray, swept: bool = False) -> bool:
    """Return whether an axis for `values` should be logarithmic: if all are positive and the
    largest exceeds 12 times the smallest; with `swept`, also for three or more values that form a
    geometric series, as those of a swept parameter often do."""
    finite = values[np.isfinite(values)]
    if finite.size == 0 or finite.min() <= 0.0:
        return False
    if finite.max() > 12.0 * finite.min():  # a little more than a decade
        return True
    distinct = np.unique(finite)
    if not swept or len(distinct) < 3:
        return False
    # A geometric series has equal ratios and unequal differences.
    ratios, steps = np.diff(np.log(distinct)), np.diff(distinct)
    equal = np.ptp(ratios) <= GEOMETRIC * ratios.mean()
    return bool(equal and np.ptp(steps) > GEOMETRIC * steps.mean())


def scale_axes(axes: Axes, x: np.ndarray, y: np.ndarray, swept: str = "x") -> None:
    """Make each of the two axes logarithmic if that suits its values, `x` or `y`, and linear if one
    of these values is not positive; else the axis keeps its scale. `swept`: "x" or "xy", the axes
    of swept parameters, for which `suits_logarithm` also accepts geometric series."""
    for letter, axis, values in (("x", axes.xaxis, x), ("y", axes.yaxis, y)):
        if suits_logarithm(values, letter in swept):
            axes.set(**{f"{letter}scale": "log"})
            tick_logarithm(axis, values)
        elif bool((values <= 0.0).any()):
            axes.set(**{f"{letter}scale": "linear"})


def tick_logarithm(axis: Axis, values: np.ndarray) -> None:
    """Set ticks of a logarithmic axis by the ratio of the largest to the smallest of its positive
    `values`: equal differences up to 5; 1, 2, 5 times powers of 10 below 500; else matplotlib's."""
    finite = values[np.isfinite(values)]
    if finite.max() < 500.0 * finite.min():
        few = finite.max() <= 5.0 * finite.min()
        equal = MaxNLocator(5, steps=[1, 2, 2.5, 5, 10])
        axis.set_major_locator(equal if few else LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.set_minor_formatter(NullFormatter())
