"""Draw the figures of results as PNG files."""

from typing import TYPE_CHECKING
from zlib import crc32

import matplotlib
import numpy as np

from .. import plot
from ..identification.fit import Fit
from ..model.clearance_joints.journal_bases import HasJournal
from ..model.scene import Scene
from ..plot.labels import scaled
from ..plot.sections import section_points
from ..simulation.results.impact_table import Impacts
from ..simulation.results.observation import Observation
from ..simulation.results.solution import Solution
from .endings import say
from .folders import OUTPUTS, Folder

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 150
"""Resolution of the files, dots per inch."""
LONGEST_FILE = 200
"""Longest file name without suffix, bytes; file systems allow 255."""
MOST_LINES = 6
"""Values of a second axis up to which each gets a curve; for more, a map is drawn."""


def draw_run(folder: Folder, scene: Scene, solution: Solution, observed: Observation) -> None:
    """Draw the figures of a run: orbit and forces of each clearance joint, energies, outputs,
    sections, and the report on one page.

    **Arguments:** `observed`: observation of the saved states.
    """
    matplotlib.use("agg")
    for name, joint in scene.contact_joints().items():
        if isinstance(joint, HasJournal):
            clearance = float(np.asarray(joint.clearance))
            _write(folder, f"{name} orbit", plot.journal_orbit(observed, name, clearance))
        forces = plot.contact_forces(observed, name)
        _mark_peaks(forces, solution.impacts, name)
        _write(folder, f"{name} forces", forces)
    _write(folder, "energies", plot.energy_ledger(observed)[0])
    outputs = folder.table(OUTPUTS)
    if outputs is not None:
        for name in map(str, outputs.data_vars):
            drawn = _over_time(outputs, name)
            _mark_extremes(drawn, outputs, name)
            _write(folder, f"output {name}", drawn)
    for name, crossings in solution.sections.items():
        _draw_section(folder, name, crossings.to_xarray())
    title = str(folder.summary()["title"])
    plot.report(scene, solution, folder / "report.pdf", title=title)


def draw_sweep(folder: Folder, dataset: "xr.Dataset") -> None:
    """Draw the figures of a sweep: each output over the first axis, and, for two axes, one curve
    for each value of the second axis, or a map; and bifurcation diagrams."""
    matplotlib.use("agg")
    axes = [str(dim) for dim in dataset["result"].dims]
    if axes == ["lane"]:
        coordinates = dataset["result"].coords
        axes = [str(name) for name in coordinates if coordinates[name].dims == ("lane",)][:1]
    for name, variable in dataset.data_vars.items():
        along_lanes = variable.dims == dataset["result"].dims
        is_output = name not in ("result", "attempts", "accepted", "time_reached")
        if along_lanes and is_output and variable.dtype.kind == "f":
            _draw_output(folder, dataset, str(name), axes)
    for name in {str(v).removesuffix("_count") for v in dataset if str(v).endswith("_count")}:
        channels = [v for v in dataset if f"{name}_number" in dataset[v].dims]
        for channel in (str(v).removeprefix(f"{name}_") for v in channels):
            if len(axes) == 1 and channel != "time" and dataset[f"{name}_{channel}"].ndim == 2:
                _write(folder, f"{name} {channel}", plot.bifurcation(dataset, name, channel))


def draw_fit(folder: Folder, found: Fit) -> None:
    """Draw the figures of a fit: measured series with predictions, and the correlations of the
    estimated parameters."""
    matplotlib.use("agg")
    _save(folder, "fitted", plot.fitted(found)[0, 0].figure)
    if len(found.parameters) > 1:
        _write(folder, "correlations", plot.correlations(found))


def _draw_output(folder: Folder, dataset: "xr.Dataset", name: str, axes: list[str]) -> None:
    finite = np.isfinite(dataset[name].values)
    if not finite.any():
        return
    if len(axes) == 1 or dataset["result"].dims == ("lane",):
        _write(folder, name, plot.against(dataset, name, axes[0]))
    elif len(axes) == 2 and dataset.sizes[axes[1]] <= MOST_LINES:
        drawn = None
        for value in dataset[axes[1]].values:
            drawn = plot.against(dataset.sel({axes[1]: value}), name, axes[0], axes=drawn)
        assert drawn is not None
        _write(folder, name, drawn)
    elif len(axes) == 2:
        _write(folder, name, plot.parameter_map(dataset, name, axes[0], axes[1]))
    else:
        say(f"note: no figure of {name}, since the sweep has {len(axes)} axes, more than two")


def _mark_peaks(forces: "Axes", impacts: Impacts | None, joint: str) -> None:
    """Mark the peak of each impact of a joint in a figure of forces, since saved states may miss
    it."""
    if impacts is None or not (of_joint := impacts.joint == joint).any():
        return
    peaks = impacts.peak_force[of_joint] * (1e-3 if "kN" in forces.get_ylabel() else 1.0)
    times = impacts.peak_time[of_joint] * (1e3 if forces.get_xlabel().endswith("ms") else 1.0)
    forces.plot(times, peaks, ".", color=plot.style.DARK, markersize=3, label="peaks of impacts")
    forces.set_ylim(top=1.05 * max(peaks.max(), forces.get_ylim()[1]))
    columns = len(forces.get_legend_handles_labels()[1])
    forces.legend(
        loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=min(columns, 4), frameon=False
    )


def _mark_extremes(drawn: "Axes", outputs: "xr.Dataset", name: str) -> None:
    """Mark the largest and the smallest value of an output, if known, since saved states may miss
    them."""
    attributes = outputs[name].attrs
    if "largest" not in attributes:
        return
    times, values = scaled(outputs["time"]), scaled(outputs[name])
    for which in ("largest", "smallest"):
        x, y = times.factor * attributes[f"{which}_time"], values.factor * attributes[which]
        drawn.plot(x, y, "o", color=plot.style.DARK, markersize=4)


def _draw_section(folder: Folder, name: str, crossings: "xr.Dataset") -> None:
    """Draw the crossings of a section: the second channel over the first one, or a single channel
    over time."""
    channels = list(map(str, crossings.data_vars))[:2]
    channels = ["time", *channels] if len(channels) == 1 else channels
    if crossings.sizes["time"]:
        values = [crossings[channel].values for channel in channels]
        units = [str(crossings[channel].attrs.get("units", "1")) for channel in channels]
        times = crossings["time"].values
        drawn = section_points(times, values, channels, units, None, None, None)
        _write(folder, f"section {name}", drawn)


def _over_time(table: "xr.Dataset", name: str) -> "Axes":
    axes = plot.style.axes_or_new(None)
    times, values = scaled(table["time"]), scaled(table[name])
    axes.plot(times.values, values.values, color=plot.style.BLUE, linewidth=1.4)
    return plot.style.dress(axes, times.label, values.label)


def _write(folder: Folder, name: str, axes: "Axes") -> None:
    _save(folder, name, axes.figure)  # pyright: ignore


def _save(folder: Folder, name: str, figure: "Figure") -> None:
    from matplotlib import pyplot

    file = name.replace(" ", "_").replace("/", "_")
    if len(file.encode()) > LONGEST_FILE:
        file = f"{file[:40]}_{crc32(file.encode()):08x}_{file[-20:]}"
    figure.savefig(folder.figures / f"{file}.png", dpi=DPI)
    pyplot.close(figure)
