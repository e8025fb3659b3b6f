"""Labels, units and scales of the axes, from what a sweep's data set says of its numbers."""

from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M"}
PREFIXED = ("m", "s", "N", "J", "W", "Pa")
"""Units that take a prefix, also in front of a quotient: mm/s."""
NEVER_LARGER = ("m", "s")
"""Of these, units that take no prefix above one: kilometres and kiloseconds help nobody."""
LOGARITHMIC = 12.0
"""Largest over smallest value from which on an axis is logarithmic."""
MANY_DECADES = 500.0
"""Likewise, from which on ticks are powers of ten."""


class Shown(NamedTuple):
    """Numbers to draw: `values` are those of the data set times `factor`; `label` has the unit."""

    values: np.ndarray
    label: str
    factor: float


def shown(data: xr.DataArray) -> Shown:
    """A variable's values with the SI prefix that brings the largest between 1 and 1000."""
    values = np.asarray(data.values, dtype=float)
    exponent, unit = _shown_unit(values, data.attrs.get("units", "1"))
    name = str(data.name).replace("_", " ")
    factor = 10.0**-exponent
    return Shown(values * factor, name if unit == "1" else f"{name}, {unit}", factor)


def _shown_unit(values: np.ndarray, unit: str) -> tuple[int, str]:
    """The power of ten that the prefix stands for, and the unit with the prefix."""
    text = unit.replace("^2", "²").replace("^3", "³")
    first = unit.split("/")[0]
    largest = np.abs(values[np.isfinite(values)]).max(initial=0.0)
    if first not in PREFIXED or largest == 0.0:
        return 0, text
    highest = 0 if first in NEVER_LARGER else max(PREFIXES)
    exponent = int(np.clip(3 * np.floor(np.log10(largest) / 3), min(PREFIXES), highest))
    return exponent, PREFIXES[exponent] + text


def suits_logarithm(values: np.ndarray) -> bool:
    """Whether values are positive and spread over more than a decade."""
    finite = values[np.isfinite(values)]
    return finite.size > 0 and finite.min() > 0.0 and finite.max() > LOGARITHMIC * finite.min()


def scale_axes(axes: Axes, x: np.ndarray, y: np.ndarray) -> None:
    """Make each axis logarithmic if that suits its values, with ticks that a reader can read."""
    for axis, values in ((axes.xaxis, x), (axes.yaxis, y)):
        if suits_logarithm(values):
            scale = axes.set_xscale if axis is axes.xaxis else axes.set_yscale
            scale("log")
            tick_logarithm(axis, values)


def tick_logarithm(axis: Axis, values: np.ndarray) -> None:
    """Ticks at 1, 2, 5 times powers of ten in plain numbers, unless there are too many decades."""
    finite = values[np.isfinite(values)]
    if finite.max() < MANY_DECADES * finite.min():
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.set_minor_formatter(NullFormatter())
