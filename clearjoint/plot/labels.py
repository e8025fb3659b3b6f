"""Labels, units and scales of axes."""

from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter

from ..fields.checks import require
from ..fields.drawn_text import shown
from .style import TimeSpan, show

PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M"}
PREFIXED = ("m", "s", "N", "J", "W", "Pa", "Hz", "rad", "N s")
"""Units that take a prefix, also as the numerator of a quotient: mm/s."""
LARGEST = {"m": 0, "s": 0, "rad": 0}
"""Highest power of ten of the prefixes of some units: kilometres and kiloseconds are not used."""
LAST_IN_MILLISECONDS = 2.0
"""Times up to this one, s, are shown in ms."""
SMALLEST_IN_KILONEWTONS = 1e4
"""Forces from this one on, N, are shown in kN in figures of single runs."""
LOGARITHMIC = 12.0
"""Ratio of the largest to the smallest value above which an axis is logarithmic."""
GEOMETRIC = 1e-6
"""Largest relative difference of the ratios in a geometric series."""
FEW_TICKS = 5.0
"""Ratio of the largest to the smallest value up to which ticks of a logarithmic axis are equally
spaced."""
MANY_DECADES = 500.0
"""The same ratio, above which ticks are powers of ten."""


class ScaledValues(NamedTuple):
    """Numbers to draw: `values` are the data times `factor`; `label` has name and unit."""

    values: np.ndarray
    label: str
    factor: float


def scaled(data: xr.DataArray, present: str = "") -> ScaledValues:
    """Scale a variable by the SI prefix that brings its largest value between 1 and 1000.

    **Arguments:** `present`: label of axes that already show values of the same unit: its prefix is
    used, and the new label has both names.

    **Raises:** `ValueError` if those axes have another unit.
    """
    values = np.asarray(data.values, dtype=float)
    si = data.attrs.get("units", "1")
    exponent, unit = _prefixed(values, si)
    name = shown(str(data.name).replace("_", " "))
    if present:
        names, exponent, unit = _present_unit(present.replace("\n", " "), si)
        name = names if name in names.split(", ") else f"{names}, {name}"
    factor = 10.0**-exponent
    return ScaledValues(values * factor, name if unit == "1" else f"{name}, {unit}", factor)


def _present_unit(label: str, unit: str) -> tuple[str, int, str]:
    """Names, power of ten of the unit's prefix, and unit of an axis label."""
    text = unit.replace("^2", "²").replace("^3", "³")
    if text == "1":
        return label, 0, text
    names, _, prefixed = label.rpartition(", ")
    exponents = {PREFIXES[exponent] + text: exponent for exponent in PREFIXES}
    expected, remedy = f"of an axis with the unit of {label!r}", "draw it into new axes"
    require(prefixed in exponents, "axes", unit, expected, remedy)
    return names, exponents[prefixed], prefixed


def legend_label(dataset: xr.Dataset, variable: str, axis: str) -> str:
    """Return the legend text of an output of a sweep: its name, and the selected values of other
    axes of the sweep."""
    texts = [shown(variable.replace("_", " "))]
    for name, coordinate in dataset.coords.items():
        if coordinate.ndim == 0 and name != axis:
            value, label, _ = scaled(coordinate)
            has_unit = coordinate.attrs.get("units", "1") != "1"
            title, _, unit = label.rpartition(", ") if has_unit else (label, "", "")
            texts.append(f"{title} {float(value):.4g} {unit}".strip())
    return ", ".join(texts)


def fitting_unit(values: np.ndarray, unit: str) -> tuple[float, str]:
    """Return the factor from an SI unit to one with a suitable prefix, and that unit. Forces are in
    N below 10 kN, else in kN."""
    if unit == "N":
        largest = np.abs(values).max(initial=0.0)
        return (1e-3, "kN") if largest >= SMALLEST_IN_KILONEWTONS else (1.0, "N")
    exponent, text = _prefixed(np.asarray(values, dtype=float), unit)
    return 10.0**-exponent, text


def time_unit(times: np.ndarray, window: TimeSpan | None = None) -> tuple[float, str]:
    """Return the factor from s to the unit of an axis over times, or over a window of them, and
    that unit: ms up to 2 s, else s."""
    last = np.abs(np.asarray(times if window is None else window, dtype=float)).max(initial=0.0)
    return (1e3, "ms") if last < LAST_IN_MILLISECONDS else (1.0, "s")


def time_axis(
    axes: Axes, times: np.ndarray, window: TimeSpan | None
) -> tuple[np.ndarray, np.ndarray, str]:
    """Limit axes over time to a window, if one is given.

    **Returns:** (N,) mask of the times to draw, these times in the unit of the axis, and its label.
    """
    factor, unit = time_unit(times, window)
    scaled_window = None if window is None else (factor * window[0], factor * window[1])
    mask = show(axes, np.asarray(times) * factor, scaled_window)
    return mask, np.asarray(times)[mask] * factor, f"time, {unit}"


def _prefixed(values: np.ndarray, unit: str) -> tuple[int, str]:
    """The power of ten of a suitable prefix, and the unit with that prefix."""
    text = unit.replace("^2", "²").replace("^3", "³")
    first = unit.split("/")[0]
    largest = np.abs(values[np.isfinite(values)]).max(initial=0.0)
    if first not in PREFIXED or largest == 0.0:
        return 0, text
    highest = LARGEST.get(first, max(PREFIXES))
    exponent = int(np.clip(3 * np.floor(np.log10(largest) / 3), min(PREFIXES), highest))
    return exponent, PREFIXES[exponent] + text


def suits_logarithm(values: np.ndarray, swept: bool = False) -> bool:
    """Whether values are positive and spread over more than a decade, or, for a swept parameter,
    are positive and form a geometric series."""
    finite = values[np.isfinite(values)]
    if finite.size == 0 or finite.min() <= 0.0:
        return False
    wide = bool(finite.max() > LOGARITHMIC * finite.min())
    return wide or (swept and _is_geometric(finite))


def _is_geometric(values: np.ndarray) -> bool:
    """Whether positive values have equal ratios and unequal differences."""
    distinct = np.unique(values)
    if len(distinct) < 3:
        return False
    ratios, steps = np.diff(np.log(distinct)), np.diff(distinct)
    equal = np.ptp(ratios) <= GEOMETRIC * ratios.mean()
    return bool(equal and np.ptp(steps) > GEOMETRIC * steps.mean())


def scale_axes(axes: Axes, x: np.ndarray, y: np.ndarray, swept: str = "x") -> None:
    """Choose logarithmic axes with ticks in plain numbers where values suit, and linear ones where
    some value is not positive.

    **Arguments:** `swept`: the axes with swept parameters, "x", "y" or "xy".
    """
    for letter, axis, values in (("x", axes.xaxis, x), ("y", axes.yaxis, y)):
        scale = axes.set_xscale if axis is axes.xaxis else axes.set_yscale
        if suits_logarithm(values, letter in swept):
            scale("log")
            tick_logarithm(axis, values)
        elif bool((values <= 0.0).any()):
            scale("linear")


def tick_logarithm(axis: Axis, values: np.ndarray) -> None:
    """Set ticks of a logarithmic axis at 1, 2 and 5 times powers of ten, in plain numbers: at equal
    distances for a small range, only at powers of ten for many decades."""
    finite = values[np.isfinite(values)]
    if finite.max() < MANY_DECADES * finite.min():
        few = finite.max() <= FEW_TICKS * finite.min()
        equal = MaxNLocator(5, steps=[1, 2, 2.5, 5, 10])
        axis.set_major_locator(equal if few else LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.set_minor_formatter(NullFormatter())
