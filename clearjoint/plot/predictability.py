"""How differences grow along a run, and where that ends a fit."""

import numpy as np
from matplotlib.axes import Axes

from ..fields.drawn_text import shown
from ..information.error_growth import DISTURBANCE
from ..information.horizon import FitHorizon
from .style import DARK, GREY, axes_or_new, dress, lines


def growth(horizon: FitHorizon, *, axes: Axes | None = None) -> Axes:
    """Displacements of the bodies per unit of each parameter's coordinate, and per m/s of initial
    velocity, over time; with the times beyond which a fit by a single run fails.

    **Arguments:** `fit_horizon`: from `clearjoint.fit_horizon`.

    **Returns:** the axes; time in ms, displacements in m, logarithmic.

    >>> probe = cj.Sensor(x, times, noise=1e-4)
    >>> limits = cj.fit_horizon(
    ...     scene,
    ...     state,
    ...     {"stiffness": stiffness},
    ...     {"probe": probe},
    ...     uncertainty={"stiffness": np.log(1.5)},
    ... )
    >>> axes = plot.growth(limits)
    """
    axes = axes_or_new(axes)
    times = horizon.times * 1e3
    labels = [*map(shown, horizon.information.labels), f"{DISTURBANCE}, m/s"]
    for k, (label, (colour, style)) in enumerate(zip(labels, lines(), strict=False)):
        size = np.where(horizon.growth[:, k] > 0.0, horizon.growth[:, k], np.nan)
        axes.plot(times, size, color=colour, linestyle=style, linewidth=1.5, label=label)
    _mark_limits(horizon, axes)
    axes.set_yscale("log")
    axes.legend(frameon=False, title="displacement per unit of", loc="lower right")
    return dress(axes, "time, ms", "displacement, m")


def integration_error(horizon: FitHorizon, *, axes: Axes | None = None) -> Axes:
    """Error of the integration over the noise, and relative error of the derivatives, over time.

    **Arguments:** `fit_horizon`: from `clearjoint.fit_horizon`.

    **Returns:** the axes; time in ms, errors logarithmic.

    >>> probe = cj.Sensor(x, times, noise=1e-4)
    >>> limits = cj.fit_horizon(
    ...     scene,
    ...     state,
    ...     {"stiffness": stiffness},
    ...     {"probe": probe},
    ...     uncertainty={"stiffness": np.log(1.5)},
    ... )
    >>> axes = plot.integration_error(limits)
    """
    axes = axes_or_new(axes)
    curves = {
        "error of the run over the noise": horizon.error,
        "relative error of derivatives": horizon.derivative_error,
    }
    for (label, error), (colour, style) in zip(curves.items(), lines(), strict=False):
        there = np.where(error > 0.0, error, np.nan)
        axes.plot(horizon.times * 1e3, there, color=colour, linestyle=style, label=label)
    _mark_limits(horizon, axes)
    axes.set_yscale("log")
    axes.legend(frameon=False, loc="lower right")
    return dress(axes, "time, ms", "error")


def _mark_limits(horizon: FitHorizon, axes: Axes) -> None:
    limits = {
        "guesses go astray": (horizon.convergence, DARK),
        "integration fails": (horizon.numerical, GREY),
    }
    for label, (time, colour) in limits.items():
        if np.isfinite(time):
            axes.axvline(1e3 * time, color=colour, linewidth=1.0, linestyle="--")
            axes.annotate(
                label,
                (1e3 * time, 0.98),
                xycoords=("data", "axes fraction"),
                xytext=(-3, 0),
                textcoords="offset points",
                rotation=90,
                ha="right",
                va="top",
                color=colour,
                bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0},
            )
