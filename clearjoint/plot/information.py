"""What data can tell against the length of the record."""

import numpy as np
from matplotlib.axes import Axes

from ..fields.drawn_text import shown
from ..information.analysis import Identifiability
from .style import GREY, axes_or_new, dress, lines


def record_length(report: Identifiability, *, axes: Axes | None = None) -> Axes:
    """Bounds of the parameters' standard deviations against the length of the record.

    One line a parameter, all of them estimated together, in the scales' coordinates: of a logarithm
    the relative error. Lines are thin and faint where the parameter is not identifiable.

    **Arguments:** `report`: from `identifiability`; `report.of(...)` draws a sensor alone.

    **Returns:** the axes; time in ms, the deviations logarithmic.

    >>> probe = cj.Sensor(x, times, noise=1e-4)
    >>> report = cj.identifiability(scene, state, {"stiffness": stiffness}, {"probe": probe})
    >>> axes = plot.record_length(report)
    """
    axes = axes_or_new(axes)
    times, deviations = report.times * 1e3, report.over_time()
    for k, (name, (colour, style)) in enumerate(zip(report.names, lines(), strict=False)):
        finite = np.where(np.isfinite(deviations[:, k]), deviations[:, k], np.nan)
        identifiable = np.where(finite <= report.limits[k], finite, np.nan)
        axes.plot(times, finite, color=colour, linewidth=0.8, alpha=0.4)
        label = shown(report.scales[k].label(name))
        axes.plot(times, identifiable, color=colour, linestyle=style, linewidth=2, label=label)
    for k, limit in enumerate(np.unique(report.limits)):
        label = "not identifiable above" if k == 0 else None
        axes.axhline(limit, color=GREY, linewidth=0.8, linestyle=":", label=label)
    axes.set_yscale("log")
    axes.legend(frameon=False)
    return dress(axes, "length of the record, ms", "standard deviation")
