"""How fast a deviation tends to zero with a parameter."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from ..fields.checks import require
from .labels import scaled
from .outcomes import ended_well, mark_failed, of_lanes, only_axis
from .style import axes_or_new, dress, inside, next_colour

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
