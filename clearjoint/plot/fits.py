"""Draw fits to measurements, accuracy of estimates, and the length of record a run can fit."""

from collections.abc import Iterable, Mapping
from typing import Protocol

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from .._fields.checks import require
from .._fields.drawn_text import shown
from .._identification.fit import Fit
from .._information.analysis import Identifiability
from .._information.error_growth import DISTURBANCE
from .._information.horizon import FitHorizon
from . import style


def fitted(fit: Fit, series: list[str] | None = None) -> np.ndarray:
    """Draw each measured series over time with the fitted prediction, and below it the residuals:
    prediction less measurement, divided by the noise. The grey band, from -2 to 2, should contain
    95 % of the residuals. `series`: names of the measured series to draw, by default all.

    **Returns:** array (2, number of series) of the axes in a new figure, with measurement and
    prediction in the first row, and residuals in the second.

    >>> axes = plot.fitted(fit)
    """
    measured = list(fit.measurements.series)
    names = measured if series is None else list(series)
    is_valid = bool(names) and set(names) <= set(measured)
    require(is_valid, "series", names, "names of series", f"choose from {', '.join(measured)}")
    # Each panel is 4.4 by 3.8 inches, with upper axes twice as high as those of the residuals.
    figure, axes = style.panels(len(names), (4.4, 3.8), (2.0, 1.0), sharex=True)
    # All axes share the times, and thus need one unit for series of different lengths.
    samples = np.concatenate([fit.measurements.series[name].times for name in names])
    times = style.scaled(xr.DataArray(samples, name="time", attrs={"units": "s"}))
    for name, (above, below) in zip(names, axes.T, strict=True):
        _draw(fit, name, times, above, below)
    # One legend for the figure, since all upper axes have the same two entries.
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2, frameon=False)
    return axes


def _draw(fit: Fit, name: str, times: style.ScaledValues, above: Axes, below: Axes) -> None:
    series = fit.measurements.series[name]
    scaled_times = series.times * times.factor
    data = style.scaled(xr.DataArray(series.values, name=name, attrs={"units": series.unit}))
    above.plot(scaled_times, data.values, ".", color=style.GREY, markersize=3, label="measured")
    fit_line = fit.predictions[name] * data.factor
    above.plot(scaled_times, fit_line, color=style.VERMILLION, linewidth=1.2, label="fitted")
    above.ticklabel_format(useOffset=False)
    style.dress(above, "", data.label)
    below.plot(scaled_times, fit.residuals[name], ".", color=style.BLUE, markersize=3)
    below.axhspan(-2.0, 2.0, color="0.92", linewidth=0, zorder=0)
    below.axhline(0.0, color=style.DARK, linewidth=0.8)
    below.tick_params(labelbottom=True)  # shared axes have numbers in the lowest row only
    style.dress(below, times.label, "residual / noise")


def correlations(fit: Fit, axes: Axes | None = None) -> Axes:
    """Draw the correlation coefficients of the errors of estimated parameters as a matrix of
    coloured numbers. If one is near -1 or 1, the measurements determine a combination of the two
    parameters well, but neither of them alone.

    >>> axes = plot.correlations(fit)
    """
    numbers, names = fit.correlation, [shown(name) for name in fit.parameters]
    # Inches: about one for each row and column, and space for the longest name, which is inclined
    # below the matrix.
    label_width = 0.08 * max(map(len, names), default=0)
    width, height = 1.0 + 1.0 * len(names) + label_width, 0.9 + 0.9 * len(names) + 0.5 * label_width
    axes = style.axes_or_new(axes, (width, height))
    image = axes.imshow(numbers, cmap="RdBu_r", vmin=-1.0, vmax=1.0)
    for (row, column), number in np.ndenumerate(numbers):
        # Large coefficients have dark colours, on which black is hard to read.
        colour = "white" if abs(number) > 0.6 else "black"
        axes.text(column, row, f"{number:.2f}", ha="center", va="center", color=colour)
    axes.set_xticks(range(len(names)), names, rotation=30, ha="right")
    axes.set_yticks(range(len(names)), names)
    axes.figure.colorbar(image, ax=axes, label="correlation of the estimates")
    return axes


def record_length(report: Identifiability, *, axes: Axes | None = None) -> Axes:
    """Draw how accurately parameters can be estimated from measurements of increasing length.

    Each parameter has a line: the lower bound of the standard deviation of its estimate, if all
    parameters are estimated together. The deviation is measured on the parameter's scale: for the
    scale `Log` it is the relative error, for `Linear` the error in multiples of the scale's `unit`.
    The line begins with the shortest record that determines the parameter; it is thin and faint
    above the dotted line at `report.limits`, where an estimate carries no information.

    **Arguments:** `report`: from `cj.identifiability`; pass `report.of("probe")` to draw the
    accuracy by the sensor "probe" alone.

    **Returns:** the axes, which show the time of the record's last sample in ms (the record's
    length only if the run starts at time 0).

    >>> report = cj.identifiability(scene, state, unknown, probe)
    >>> axes = plot.record_length(report)
    """
    axes = style.axes_or_new(axes)
    times, deviations = report.times * 1e3, report.over_time()  # ms
    for k, (name, (colour, dashes)) in enumerate(zip(report.names, style.lines(), strict=False)):
        # Infinite deviations, of parameters that short records don't determine, are gaps.
        finite = np.where(np.isfinite(deviations[:, k]), deviations[:, k], np.nan)
        identifiable = np.where(finite <= report.limits[k], finite, np.nan)
        axes.plot(times, finite, color=colour, linewidth=0.8, alpha=0.4)
        label = shown(report.scales[k].label(name))
        axes.plot(times, identifiable, color=colour, linestyle=dashes, linewidth=2, label=label)
    # Parameters may have equal limits. All limits share one entry of the legend.
    for k, limit in enumerate(np.unique(report.limits)):
        label = "not identifiable above" if k == 0 else None
        axes.axhline(limit, color=style.GREY, linewidth=0.8, linestyle=":", label=label)
    axes.set_yscale("log")
    axes.legend(frameon=False)
    return style.dress(axes, "end of the record, ms", "standard deviation")


def growth(horizon: FitHorizon, *, axes: Axes | None = None) -> Axes:
    """Draw how far small changes of parameters and of the initial velocity displace the bodies.

    Each parameter has a line over time: the root mean square displacement, m, of points of the
    bodies per unit of the parameter on its scale (for the scale `Log`, per relative change).
    Another is the displacement per m/s of initial velocity. Vertical lines mark the times beyond
    which a fit by one run may not converge from a wrong guess, or integration errors are too large.

    >>> axes = plot.growth(limits)
    """
    labels = [*map(shown, horizon.information.labels), f"{DISTURBANCE}, m/s"]
    curves = zip(labels, horizon.growth.T, strict=True)
    return _over_time(horizon, curves, "displacement, m", "displacement per unit of", axes)


def integration_error(horizon: FitHorizon, *, axes: Axes | None = None) -> Axes:
    """Draw upper bounds of integration errors over time: the errors of a run's outputs, divided by
    the measurement noise, and the relative errors of the outputs' derivatives by the parameters.
    Vertical lines mark times beyond which fits fail from wrong guesses, or errors are too large.

    >>> axes = plot.integration_error(limits)
    """
    errors = {
        "error of the run over the noise": horizon.error,
        "relative error of derivatives": horizon.derivative_error,
    }
    return _over_time(horizon, errors.items(), "error", None, axes)


def _over_time(
    horizon: FitHorizon,
    curves: Iterable[tuple[str, np.ndarray]],
    quantity: str,
    title: str | None,
    axes: Axes | None,
) -> Axes:
    # `curves`: label and values (N,) at the N times of the horizon. `title`: of the legend.
    axes = style.axes_or_new(axes)
    times = horizon.times * 1e3  # ms
    # A logarithmic axis has no zero: values of zero, as at the start, are gaps.
    style.draw_lines(axes, ((name, times, np.where(y > 0.0, y, np.nan)) for name, y in curves))
    limits = {
        "guesses fail": (horizon.convergence, style.DARK),
        "integration fails": (horizon.numerical, style.GREY),
    }
    for label, (time, colour) in limits.items():
        if np.isfinite(time):  # a limit that the record does not reach is infinite
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
    axes.set_yscale("log")
    axes.legend(frameon=False, title=title, loc="lower right")
    return style.dress(axes, "time, ms", quantity)


Loop = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Position and torque of a joint at N times, (N,) each, as logged and then as predicted."""


class FittedRobot(Protocol):
    """What the figure needs of `clearjoint.results.RobotFit`, which this module must not import."""

    def hysteresis(self) -> Mapping[str, Loop]:
        """Return logged and predicted positions and torques, by name of the driven joint."""
        ...


def joint_hysteresis(fit: FittedRobot) -> np.ndarray:
    """Draw the torque of each driven joint over the joint's position, as logged and as predicted by
    a `fit` from `cj.fit_robot`.

    **Returns:** array (number of joints,) of the axes in a new figure.

    **Raises:** `ValueError` if the log has torque and position of no driven joint.

    >>> from types import SimpleNamespace
    >>> angle = np.linspace(0.0, 1.0, 20)
    >>> loop = cj.results.Hysteresis(angle, angle**2, angle, 1.1 * angle**2)
    >>> result = SimpleNamespace(hysteresis=lambda: {"elbow": loop})  # or of cj.fit_robot
    >>> axes = plot.joint_hysteresis(result)
    """
    loops = fit.hysteresis()
    remedy = "log both of them"
    require(bool(loops), "fit", [*loops], "with torque and position of a driven joint", remedy)
    _, (axes,) = style.panels(len(loops), (4.6, 3.6))
    for (joint, loop), drawn in zip(loops.items(), axes, strict=True):
        position, torque, *predicted = loop
        drawn.plot(position, torque, ".", color=style.GREY, markersize=3, label="logged")
        drawn.plot(*predicted, color=style.BLUE, linewidth=0.8, label="predicted")
        style.dress(drawn, f"position of {joint}, rad or m", "torque, N m or N")
        style.legend_above(drawn, 2)
    return axes
