"""Orbits of the journal in its bearing, from what a sweep saved of a lane."""

import xarray as xr
from matplotlib.axes import Axes

from ..fields.drawn_text import shown
from .journal import clearance_circle, length_unit
from .outcomes import require_names
from .style import BLUE, TimeSpan, axes_or_new, dress, inside


def orbit(
    lane: xr.Dataset,
    saved: str,
    clearance: float,
    *,
    channels: tuple[str, str] = ("x", "y"),
    window: TimeSpan | None = None,
    axes: Axes | None = None,
) -> Axes:
    """Path of the journal's centre, or of a base, across its bearing, in the clearance circle.

    **Arguments:**

    - `lane`: one lane of `sweep` or `open_sweep`: ``dataset.isel(clearance=3)``.
    - `saved`: name of the `Saved` whose `channels` are the offsets to the right and upwards, in m,
      such as those of `quantities.JournalOffset`.
    - `clearance`: radial, m.
    - `window`: instants between which to draw, s; all that was saved unless given.

    **Returns:** the axes, of equal scale, in mm, or in µm below 0.2 mm of clearance. A dot marks
    the beginning.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> x, y = [cj.quantities.JournalOffset("shoulder", axis) for axis in ("x", "y")]
    >>> channels = {"x": (x, "m"), "y": (y, "m")}
    >>> saved = cj.Saved(np.linspace(0.0, 0.02, 201), channels)
    >>> clearance = cj.Axis(lambda scene: scene.joints["shoulder"].clearance, [0.5e-3])
    >>> axes = {"clearance": clearance}
    >>> found = cj.sweep(scene, state, 0.02, axes, {"path": saved}, progress=False)
    >>> drawn = plot.orbit(found.isel(clearance=0), "path", 0.5e-3)
    """
    names = [f"{saved}_{channel}" for channel in channels]
    require_names(lane, (*names, f"{saved}_time"))
    axes = axes_or_new(axes, (4.8, 5.0))
    during = inside(lane[f"{saved}_time"].values, window)
    factor, unit = length_unit(clearance)
    right, up = (lane[name].values[during] * factor for name in names)
    axes.plot(right, up, color=BLUE, linewidth=0.8)
    axes.plot(right[:1], up[:1], "o", color="black", markersize=4)
    clearance_circle(axes, clearance, factor=factor)
    return dress(axes, *(f"{shown(channel)}, {unit}" for channel in channels))
