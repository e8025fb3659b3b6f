"""Outputs of a sweep over two of its parameters."""

from typing import TypedDict

import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.patches import Patch

from .labels import scale_axes, scaled, suits_logarithm, tick_logarithm
from .outcomes import of_lanes
from .style import axes_or_new, dress


class Fill(TypedDict):
    """Look of an area: colours of its face and hatching, and the pattern of this."""

    facecolor: str
    edgecolor: str
    hatch: str


MISSING = Fill(facecolor="0.85", edgecolor="0.55", hatch="////")


def parameter_map(
    dataset: xr.Dataset, variable: str, x: str, y: str, *, axes: Axes | None = None
) -> Axes:
    """One output of a sweep over two parameters, in colours that a bar explains.

    Lanes that failed or are pending are grey and hatched.

    **Arguments:** `dataset`: of `sweep` or `open_sweep`, with further axes selected away;
    `variable`: the output's name; `x`, `y`: the parameters', to the right and upwards.

    **Returns:** the axes, and colours, logarithmic where values spread over a decade.

    >>> stiffness = cj.Axis(lambda scene: scene.forces["spring"].stiffness, [50, 100, 200, 400])
    >>> speed = cj.Peak(cj.quantities.Velocity("ball"), "m/s")
    >>> mass = cj.Axis(lambda scene: scene.bodies["ball"].mass, [0.5, 1.0])
    >>> axes = {"stiffness": stiffness, "mass": mass}
    >>> found = cj.sweep(scene, state, 0.5, axes, {"speed": speed}, progress=False)
    >>> drawn = plot.parameter_map(found, "speed", "stiffness", "mass")
    """
    axes = axes_or_new(axes)
    right, up = scaled(dataset[x]), scaled(dataset[y])
    values, label, _ = scaled(of_lanes(dataset, variable, (y, x)))
    norm = LogNorm() if suits_logarithm(values) else Normalize()
    mesh = axes.pcolormesh(right.values, up.values, values, norm=norm, shading="nearest")
    scale_axes(axes, right.values, up.values, swept="xy")
    bar = axes.figure.colorbar(mesh, ax=axes, label=label)
    if suits_logarithm(values):
        tick_logarithm(bar.ax.yaxis, values)
    axes.patch.set(**MISSING)
    missing = int((values != values).sum())
    if missing:
        patch = Patch(**MISSING, label=f"failed or pending: {missing}")
        axes.legend(handles=[patch], loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
    dress(axes, right.label, up.label)
    axes.grid(False)
    return axes
