"""Phase portraits: a quantity and its rate."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from ..model.scene import Scene
from ..quantities.base import Quantity
from ..simulation.results.solution import Solution, Trajectory
from .along import rate_series, series
from .labels import scaled
from .style import BLUE, DARK, TimeSpan, axes_or_new, dress, inside


def phase_portrait(
    scene: Scene,
    solution: Solution,
    quantity: Quantity,
    *,
    unit: str | None = None,
    trajectory: Trajectory | None = None,
    window: TimeSpan | None = None,
    axes: Axes | None = None,
) -> Axes:
    """The rate of a quantity over the quantity: a closed curve if the motion is periodic.

    **Arguments:**

    - `scene`, `solution`, `unit`, `trajectory`: as of `plot.series`.
    - `quantity`: one that positions decide, such as an angle, a position or a penetration; its
      rate comes from the equations of motion.
    - `window`: instants between which to draw, s; all there are unless given.

    **Returns:** the axes. A dot marks the beginning, a square the end. Angles that turn go on
    beyond a turn.

    >>> save = cj.Saving(np.linspace(0, 0.5, 101))
    >>> solution = cj.simulate(scene, state, 0.5, save=save, progress=False)
    >>> axes = plot.phase_portrait(scene, solution, cj.quantities.Position("ball", "x"))
    """
    place = series(scene, solution, quantity, unit=unit, trajectory=trajectory)
    rate = rate_series(scene, solution, quantity, unit=unit, trajectory=trajectory)
    period = getattr(quantity, "period", None)
    if period is not None:
        place = place.copy(data=np.unwrap(place.values, period=period))
    return _draw(place, rate, window, axes_or_new(axes, (5.6, 4.4)))


def _draw(place: xr.DataArray, rate: xr.DataArray, window: TimeSpan | None, axes: Axes) -> Axes:
    during = inside(place["time"].values, window)
    x, y = scaled(place[during]), scaled(rate[during])
    axes.plot(x.values, y.values, color=BLUE, linewidth=0.9)
    for row, marker, label in ((0, "o", "begins"), (-1, "s", "ends")):
        if len(x.values):
            look = {"color": DARK, "markersize": 5, "linestyle": "", "zorder": 3}
            axes.plot(x.values[[row]], y.values[[row]], marker, label=label, **look)
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
    return dress(axes, x.label, y.label)
