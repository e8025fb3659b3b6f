"""Labels, units and scales of the axes, from what a sweep's data set says of its numbers."""

from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter

from ..fields.checks import require
from ..fields.drawn_text import shown
from .style import TimeSpan

PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M"}
PREFIXED = ("m", "s", "N", "J", "W", "Pa", "Hz", "rad", "N s")
"""Units that take a prefix, also in front of a quotient: mm/s."""
LARGEST = {"m": 0, "s": 0, "rad": 0}
"""Of these, units that take no prefix above such a power of ten: kilometres help nobody."""
LAST_IN_MILLISECONDS = 2.0
"""Times before this one, s, are shown in ms."""
SMALLEST_IN_KILONEWTONS = 1e4
"""Forces from this one on, N, are shown in kN by pictures of single runs."""
LOGARITHMIC = 12.0
"""Largest over smallest value from which on an axis is logarithmic."""
GEOMETRIC = 1e-6
"""Largest relative difference of the ratios of neighbouring values in a geometric series."""
FEW_TICKS = 5.0
"""Largest over smallest value up to which ticks of a logarithmic axis are at equal distances."""
MANY_DECADES = 500.0
"""Likewise, from which on ticks are powers of ten."""


class ScaledValues(NamedTuple):
    """Numbers to draw: `values` are those of the data set times `factor`; `label` has the unit."""

    values: np.ndarray
    label: str
    factor: float


def scaled(data: xr.DataArray, present: str = "") -> ScaledValues:
    """A variable's values with the SI prefix that brings the largest between 1 and 1000.

    **Arguments:** `present`: label of an axis on which other values of the same unit are drawn
    already: its prefix is used, and the new label has both names.

    **Raises:** `ValueError` if that axis is in another unit.
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
    """From an axis' label: its names, the power of ten of its unit's prefix, and the unit."""
    text = unit.replace("^2", "²").replace("^3", "³")
    if text == "1":
        return label, 0, text
    names, _, there = label.rpartition(", ")
    exponents = {PREFIXES[exponent] + text: exponent for exponent in PREFIXES}
    expected, remedy = f"of an axis whose unit is that of {label!r}", "draw it into axes of its own"
    require(there in exponents, "axes", unit, expected, remedy)
    return names, exponents[there], there


def legend_label(dataset: xr.Dataset, variable: str, axis: str) -> str:
    """Label of an output of a sweep in a legend: its name, and the values at which other axes of
    the sweep have been selected."""
    places = [c for name, c in dataset.coords.items() if c.ndim == 0 and name != axis]
    texts = [_at(place) for place in places]
    return ", ".join([shown(variable.replace("_", " ")), *texts])


def _at(place: xr.DataArray) -> str:
    """A coordinate's name, value and unit."""
    label, value = scaled(place).label, float(scaled(place).values)
    has_unit = place.attrs.get("units", "1") != "1"
    name, _, unit = label.rpartition(", ") if has_unit else (label, "", "")
    return f"{name} {value:.4g} {unit}".strip()


def fitting_unit(values: np.ndarray, unit: str) -> tuple[float, str]:
    """The factor from an SI unit to one whose prefix suits the values, and that unit: forces are in
    N below 10 kN, else in kN."""
    if unit == "N":
        largest = np.abs(values).max(initial=0.0)
        return (1e-3, "kN") if largest >= SMALLEST_IN_KILONEWTONS else (1.0, "N")
    exponent, text = _prefixed(np.asarray(values, dtype=float), unit)
    return 10.0**-exponent, text


def time_unit(times: np.ndarray, window: TimeSpan | None = None) -> tuple[float, str]:
    """The factor from s to the unit that suits an axis over times, or over a window of them, and
    that unit: ms for what is over in two seconds."""
    shown = times if window is None else window
    last = np.abs(np.asarray(shown, dtype=float)).max(initial=0.0)
    return (1e3, "ms") if last < LAST_IN_MILLISECONDS else (1.0, "s")


def _prefixed(values: np.ndarray, unit: str) -> tuple[int, str]:
    """The power of ten of the prefix that suits values in a unit, and the unit with the prefix."""
    text = unit.replace("^2", "²").replace("^3", "³")
    first = unit.split("/")[0]
    largest = np.abs(values[np.isfinite(values)]).max(initial=0.0)
    if first not in PREFIXED or largest == 0.0:
        return 0, text
    highest = LARGEST.get(first, max(PREFIXES))
    exponent = int(np.clip(3 * np.floor(np.log10(largest) / 3), min(PREFIXES), highest))
    return exponent, PREFIXES[exponent] + text


def suits_logarithm(values: np.ndarray, swept: bool = False) -> bool:
    """Whether values are positive and spread over more than a decade; or, of a swept parameter,
    positive and a geometric series."""
    finite = values[np.isfinite(values)]
    if finite.size == 0 or finite.min() <= 0.0:
        return False
    wide = bool(finite.max() > LOGARITHMIC * finite.min())
    return wide or (swept and _is_geometric(finite))


def _is_geometric(values: np.ndarray) -> bool:
    """Whether positive values are spaced by one ratio, and not by one difference."""
    places = np.unique(values)
    if len(places) < 3:
        return False
    ratios, steps = np.diff(np.log(places)), np.diff(places)
    equal = np.ptp(ratios) <= GEOMETRIC * ratios.mean()
    return bool(equal and np.ptp(steps) > GEOMETRIC * steps.mean())


def scale_axes(axes: Axes, x: np.ndarray, y: np.ndarray, swept: str = "x") -> None:
    """Make each axis logarithmic if that suits its values, with ticks in plain numbers, or linear
    if some of them are not positive.

    **Arguments:** `swept`: the axes of swept parameters, "x", "y" or "xy".
    """
    for letter, axis, values in (("x", axes.xaxis, x), ("y", axes.yaxis, y)):
        scale = axes.set_xscale if axis is axes.xaxis else axes.set_yscale
        if suits_logarithm(values, letter in swept):
            scale("log")
            tick_logarithm(axis, values)
        elif bool((values <= 0.0).any()):
            scale("linear")


def tick_logarithm(axis: Axis, values: np.ndarray) -> None:
    """Ticks at 1, 2, 5 times powers of ten in plain numbers, unless there are too many decades; at
    equal distances where that would be too few."""
    finite = values[np.isfinite(values)]
    if finite.max() < MANY_DECADES * finite.min():
        few = finite.max() <= FEW_TICKS * finite.min()
        equal = MaxNLocator(5, steps=[1, 2, 2.5, 5, 10])
        axis.set_major_locator(equal if few else LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.set_minor_formatter(NullFormatter())
