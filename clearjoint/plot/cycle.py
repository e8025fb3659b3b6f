"""Machines that turn: curves over the angle of a shaft, and Poincaré maps."""

from collections.abc import Mapping

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.ticker import MultipleLocator

from ..fields.checks import require
from ..simulation.sections import Crossings, Section
from .labels import ScaledValues, scaled
from .outcomes import require_names
from .style import axes_or_new, dress, lines

Curve = tuple[np.ndarray, np.ndarray]


def over_angle(
    curves: Mapping[str, Curve],
    quantity: str,
    *,
    shaft: str = "crank",
    axes: Axes | None = None,
) -> Axes:
    """Curves over the angle of a shaft.

    **Arguments:**

    - `curves`: angles (N,) in rad and values (N,), by label; later ones lie over earlier ones.
    - `quantity`: what the values are, with their unit. `shaft`: what turns.

    **Returns:** the axes; angle in degrees, ticks at quarter turns.

    >>> angle = np.linspace(0.0, 2.0 * np.pi, 73)
    >>> axes = plot.over_angle({"ideal": (angle, 100.0 * np.cos(angle))}, "force / N")
    """
    axes = axes_or_new(axes)
    for (label, (angles, values)), (colour, style) in zip(curves.items(), lines(), strict=False):
        degrees = np.degrees(angles)
        axes.plot(degrees, values, color=colour, linestyle=style, linewidth=1.4, label=label)
        axes.set_xlim(degrees[0], degrees[-1])
    axes.xaxis.set_major_locator(MultipleLocator(90.0))
    return dress(axes, f"{shaft} angle, °", quantity)


def poincare_map(
    x: np.ndarray, y: np.ndarray, labels: tuple[str, str], *, axes: Axes | None = None
) -> Axes:
    """Points where a motion stands once a period: one dot if it is periodic, a cloud if chaotic.

    **Arguments:** `x`, `y`: (N,) coordinates of the points, in order; `labels`: theirs, with units.

    **Returns:** the axes; later points are darker.

    >>> axes = plot.poincare_map(np.zeros(20), np.linspace(0, 1, 20), ("x / mm", "v / (m/s)"))
    """
    axes = axes_or_new(axes, (4.8, 4.8))
    shade = np.linspace(1.0, 0.35, len(x))[::-1]
    axes.scatter(x, y, c=shade, cmap="Blues", vmin=0.0, vmax=1.0, s=14.0, linewidths=0.0, zorder=3)
    return dress(axes, *labels)


def poincare_section(
    crossings: Crossings,
    section: Section,
    channels: tuple[str, str] | None = None,
    *,
    axes: Axes | None = None,
) -> Axes:
    """Where a run crossed a Poincaré section: a few dots if it is periodic, a cloud if chaotic.

    **Arguments:**

    - `crossings`: `solution.sections[name]`. `section`: the `Section` that was asked for.
    - `channels`: names of those to the right and upwards; the section's first two unless given.

    **Returns:** the axes, in units that suit; later points are darker.

    **Raises:** `ValueError` for channels that the section has not.

    >>> x, y = (cj.quantities.JournalOffset("shoulder", component) for component in "xy")
    >>> section = cj.Section(y, {"x": (x, "m"), "y": (y, "m")}, count=3)
    >>> values = {"x": np.array([1e-4, 2e-4, 1e-4]), "y": np.zeros(3)}
    >>> axes = plot.poincare_section(cj.Crossings(np.arange(3.0), values), section)
    >>> axes.get_xlabel()
    'x, µm'
    """
    known = list(section.channels)
    chosen = tuple(known[:2]) if channels is None else tuple(channels)
    fine = len(chosen) == 2 and set(chosen) <= set(known)
    remedy = "record two channels, and name them"
    require(fine, "channels", chosen, f"two of those of the section, {known}", remedy)
    points = [_scaled(crossings.values[name], name, section.channels[name][1]) for name in chosen]
    return _points(points, axes)


def poincare_section_of_lane(
    lane: xr.Dataset, section: str, channels: tuple[str, str], *, axes: Axes | None = None
) -> Axes:
    """Where one lane of a sweep crossed a Poincaré section.

    **Arguments:** `lane`: one lane of `sweep` or `open_sweep`: ``dataset.isel(clearance=3)``;
    `section`: name of the `Section`; `channels`: names of those to the right and upwards.

    **Returns:** as of `plot.poincare_section`.

    **Raises:** `ValueError` for names that the sweep has not.

    >>> spring = cj.SpringDamper("ground", "ball", (0, 0, 0), (0, 0, 0), stiffness=100.0)
    >>> scene = cj.Scene({"ball": cj.Body(1.0, (1e-3, 1e-3, 1e-3))}, forces={"spring": spring})
    >>> state = cj.State({"ball": cj.body_state((0.1, 0, 0))})  # 0.1 cos(10 t)
    >>> stiffness = cj.Axis(lambda scene: scene.forces["spring"].stiffness, [50, 100, 200, 400])
    >>> x, speed = cj.quantities.Position("ball", "x"), cj.quantities.Velocity("ball", "x")
    >>> still = cj.Section(speed, {"x": (x, "m"), "speed": (speed, "m/s")}, count=3)
    >>> save, outputs = cj.Saving(sections={"still": still}), {"speed": cj.Peak(speed, "m/s")}
    >>> axes = {"stiffness": stiffness}
    >>> found = cj.sweep(scene, state, 2.0, axes, outputs, save=save, progress=False)
    >>> lane = found.sel(stiffness=100.0)
    >>> drawn = plot.poincare_section_of_lane(lane, "still", ("x", "speed"))
    """
    names = [f"{section}_{channel}" for channel in channels]
    require_names(lane, (*names, f"{section}_count"))
    count = lane[f"{section}_count"]
    require(count.ndim == 0, "lane", count.dims, "a single lane", "select one: dataset.isel(...)")
    there = slice(int(count))
    units = [lane[name].attrs.get("units", "1") for name in names]
    points = [
        _scaled(lane[name].values[there], channel, unit)
        for name, channel, unit in zip(names, channels, units, strict=True)
    ]
    return _points(points, axes)


def _scaled(values: np.ndarray, name: str, unit: str) -> ScaledValues:
    return scaled(xr.DataArray(np.asarray(values), name=name, attrs={"units": unit}))


def _points(points: list[ScaledValues], axes: Axes | None) -> Axes:
    x, y = points
    return poincare_map(x.values, y.values, (x.label, y.label), axes=axes)
