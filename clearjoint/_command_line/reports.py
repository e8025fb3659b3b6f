"""Draw the figures of results, and write the page of a folder."""

import base64
import re
from html import escape
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib import pyplot
from matplotlib.axes import Axes

from .. import plot
from .._durability.wear import open_wear
from .._durability.wear_derivatives import PARTS
from .._export.datasets import to_frame
from .._identification.fit import Fit
from .._model.clearance_joints.journal_bases import HasJournal
from .._model.scene import Scene
from .._robot_fits.fit_robot import RobotFit
from .._simulation.results.impact_table import Impacts
from .._simulation.results.observe import observe
from .._simulation.results.solution import Solution
from .._sweeps.outputs import NOT_OUTPUTS
from .._sweeps.store.store import open_sweep
from .._views.viewing import view
from ..plot.report_page import IMPACT_COLUMNS, impact_rows
from ..plot.style import fitting_unit, scaled
from . import folders
from .endings import say
from .wearing import stage_table, worn_parts


def _draw_run(folder: Path, scene: Scene, solution: Solution) -> None:
    observed = observe(scene, solution)
    for name, joint in scene.contact_joints().items():
        if isinstance(joint, HasJournal):
            clearance = float(np.asarray(joint.clearance))
            _save(folder, f"{name} orbit", plot.journal_orbit(observed, name, clearance))
        forces = plot.contact_forces(observed, name)
        _mark_peaks(forces, solution.impacts, name)
        _save(folder, f"{name} forces", forces)
    _save(folder, "energies", plot.energy_ledger(observed)[0])
    outputs = folders.read_table(folder, folders.OUTPUTS)
    for name, values in ({} if outputs is None else outputs).items():
        _save(folder, f"output {name}", _over_time(values))
    # The outputs of a run that was read from a folder are its sections.
    for name, crossings in solution.outputs.items():
        if len(crossings):
            _save(folder, f"section {name}", plot.poincare_section(crossings))
    title = str(folders.read_summary(folder)["title"])
    plot.report(scene, solution, folder / folders.PDF, title=title)


def _draw_output(folder: Path, dataset: xr.Dataset, name: str, axes: list[str]) -> None:
    if not np.isfinite(dataset[name].values).any():  # all lanes failed or have not run yet
        return
    if len(axes) == 1 or dataset["result"].dims == ("lane",):
        _save(folder, name, plot.against(dataset, name, axes[0]))
    # A curve for each value of the second axis: there are colours for six curves.
    elif len(axes) == 2 and dataset.sizes[axes[1]] <= 6:
        drawn = plot.style.axes_or_new(None)
        for value in dataset[axes[1]].values:
            plot.against(dataset.sel({axes[1]: value}), name, axes[0], axes=drawn)
        _save(folder, name, drawn)
    elif len(axes) == 2:
        _save(folder, name, plot.parameter_map(dataset, name, axes[0], axes[1]))
    else:
        say(f"note: no figure of {name}, since the sweep has {len(axes)} axes, more than two")


def _mark_peaks(forces: Axes, impacts: Impacts | None, joint: str) -> None:
    """Mark the peaks of a joint's impacts, which curves through the saved states may miss."""
    if impacts is None:
        return
    of_joint = impacts.joint == joint
    if not of_joint.any():
        return
    # The figure has chosen its units, which its labels tell.
    peaks = impacts.peak_force[of_joint] * (1e-3 if "kN" in forces.get_ylabel() else 1.0)
    times = impacts.peak_time[of_joint] * (1e3 if forces.get_xlabel().endswith("ms") else 1.0)
    forces.plot(times, peaks, ".", color=plot.style.DARK, markersize=3, label="peaks of impacts")
    # 5 % of room above the highest dot.
    forces.set_ylim(top=1.05 * max(peaks.max(), forces.get_ylim()[1]))
    plot.style.legend_above(forces, min(len(forces.get_legend_handles_labels()[1]), 4))


def _over_time(output: xr.DataArray) -> Axes:
    """Draw an output at the saved states over time. Dots show extremes, if its `attrs` have any."""
    axes = plot.style.axes_or_new(None)
    times, values = scaled(output["time"]), scaled(output)
    axes.plot(times.values, values.values, color=plot.style.BLUE, linewidth=1.4)
    # Only outputs that change fast, such as forces, have extremes from between the saved states.
    if "largest" in output.attrs:
        for which in ("largest", "smallest"):
            x = times.factor * output.attrs[f"{which}_time"]
            y = values.factor * output.attrs[which]
            axes.plot(x, y, "o", color=plot.style.DARK, markersize=4)
    return plot.style.dress(axes, times.label, values.label)


def _save(folder: Path, name: str, axes: Axes) -> None:
    file = folders.file_name(name)
    (folder / folders.FIGURES).mkdir(exist_ok=True)
    figure = axes.get_figure(root=True)
    assert figure is not None
    figure.savefig(folder / folders.FIGURES / f"{file}.png", dpi=150)
    pyplot.close(figure)


ROWS = 20
"""Largest number of impacts, or of lanes of a sweep, in a table of the page."""
STAGES, PROFILES = "stages.csv", "profiles.csv"
STYLE = Path(__file__).parent / "templates" / "page.css"


def write_report(folder: Path, dataset: xr.Dataset | None = None) -> None:
    """Draw the figures of a folder, and write its page. `dataset`: of a sweep, by default read from
    its store. The figures of a fit stay, since the folder lacks some of their data."""
    kind = folders.read_summary(folder)["kind"]
    if kind == "run":
        write_run_report(folder)
    elif kind == "sweep":
        dataset = open_sweep(folder / folders.STORE) if dataset is None else dataset
        write_sweep_report(folder, dataset.load())
    elif kind == "wear":
        store, needed = folder / folders.WEAR_STORE, ["force", *(f"{p}_volume" for p in PARTS)]
        results = open_wear(store)
        folders.require_names(store, needed, results)
        write_wear_report(folder, results)
    else:  # a fit, whose command has drawn the figures
        write_page(folder)


def write_run_report(folder: Path) -> None:
    """Write the page of a run from the files in its folder and, if these include saved states,
    figures, a PDF report of one page, and the 3D animation."""
    parts = []
    if (folder / folders.NUMBERS).exists():
        numbers = pd.read_csv(folder / folders.NUMBERS).set_index("output")
        parts.append(_table("Outputs", numbers, len(numbers)))
    if (folder / f"{folders.MOTION}.nc").exists():
        scene, solution = folders.read_run(folder)
        _draw_run(folder, scene, solution)
        _write_view(folder, scene, solution)
        if solution.impacts is not None and len(solution.impacts):
            rows = impact_rows(solution.impacts, len(solution.impacts))
            frame = pd.DataFrame(rows, columns=list(IMPACT_COLUMNS), index=range(1, len(rows) + 1))
            parts.append(_table("Hardest impacts", frame, ROWS))
    write_page(folder, *parts)


def write_sweep_report(folder: Path, dataset: xr.Dataset) -> None:
    """Draw the figures of a sweep, and write its page and a CSV table with a row for each lane.

    An output is drawn over a single axis, or the first of zipped axes, as a curve; over two axes,
    as a curve for each value of the second or, for more than six values, as a map of colours.
    Poincaré sections over a single axis become bifurcation diagrams.
    """
    frame = lane_table(dataset)
    frame.to_csv(folder / "sweep.csv", index=False)
    lanes = dataset["result"]
    axes = [str(dim) for dim in lanes.dims]
    if axes == ["lane"]:  # zipped axes, of which the first is drawn
        axes = [str(name) for name in lanes.coords if lanes[name].dims == ("lane",)][:1]
    for name, variable in dataset.items():
        # Outputs with more dimensions than the lanes, such as saved motions, are not drawn.
        is_output = name not in NOT_OUTPUTS
        if variable.dims == lanes.dims and is_output and variable.dtype.kind == "f":
            _draw_output(folder, dataset, str(name), axes)
    # A section "onset" has the variable "onset_count", the dimension "onset_number", and variables
    # along this dimension, such as "onset_speed" for its channel "speed". The variables of an
    # `ImpactTable` have such names too, but a third dimension, along the contacts.
    for name in {str(v).removesuffix("_count") for v in dataset if str(v).endswith("_count")}:
        for variable in (str(v) for v, rows in dataset.items() if f"{name}_number" in rows.dims):
            channel = variable.removeprefix(f"{name}_")
            if len(axes) == 1 and channel != "time" and dataset[variable].ndim == 2:
                drawn = plot.bifurcation(dataset, name, channel, axes[0])
                _save(folder, f"{name} {channel}", drawn)
    write_page(folder, _table("Lanes", frame, ROWS))


def draw_fit(folder: Path, fit: Fit) -> None:
    _save(folder, "fitted", plot.fitted(fit)[0, 0])
    if len(fit.parameters) > 1:
        _save(folder, "correlations", plot.correlations(fit))


def draw_robot_fit(folder: Path, result: RobotFit) -> None:
    if result.hysteresis():
        _save(folder, "hysteresis", plot.joint_hysteresis(result)[0])
    draw_fit(folder, result.fit)


def write_wear_report(folder: Path, dataset: xr.Dataset) -> None:
    frame = stage_table(dataset)
    frame.to_csv(folder / STAGES, index=False)
    profiles, depths, volumes = {"angle [rad]": dataset["angle"].values}, {}, {}
    for joint, part in worn_parts(dataset):
        name = f"{part} of {joint}"
        profiles[f"{name} [m]"] = dataset[f"{part}_depth"].sel(joint=joint).isel(stage=-1).values
        depths[name] = frame[f"{name}, largest [m]"]
        volumes[name] = 1e9 * frame[f"{name}, volume [m^3]"]  # in mm^3
        _save(folder, name, plot.worn_profile(dataset, joint, part))
    pd.DataFrame(profiles).to_csv(folder / PROFILES, index=False)
    forces = {str(joint): frame[f"force in {joint} [N]"] for joint in dataset["joint"].values}
    figures = (
        ("depths", "largest depth", "m", depths),
        ("volumes", "worn volume", "mm^3", volumes),
        ("forces", "largest force", "N", forces),
    )
    for figure, quantity, unit, curves in figures:
        values = np.array(list(curves.values()))
        # If no part has worn, there are no depths and volumes. The forces of the last stage are
        # NaN, so a result with a single stage has no finite force.
        finite = values[np.isfinite(values)]
        if finite.size == 0:
            continue
        factor, shown = fitting_unit(finite, unit)
        axes = plot.style.axes_or_new(None)
        lines = ((name, frame["cycles"], factor * values) for name, values in curves.items())
        plot.style.draw_lines(axes, lines)
        plot.style.dress(axes, "cycles", f"{quantity}, {shown}")
        plot.style.legend_above(axes, min(len(curves), 2))
        _save(folder, figure, axes)
    write_page(folder, _table("Stages", frame, len(frame)))


def write_page(folder: Path, *parts: str) -> None:
    """Write a folder's page, which needs no network. `parts`: HTML to place below the figures."""
    summary = folders.read_summary(folder)
    title = escape(str(summary.pop("title")))

    def shown(value: object) -> str:
        # Options of a setting that are None are left out: "Tsit5" for "Tsit5(scan_kind=None)".
        text = f"{value:.6g}" if isinstance(value, float) else str(value)
        return re.sub(r"\((\w+=None(, )?)+\)", "", text)

    entries = {key: value for key, value in summary.items() if str(value) != "None"}
    rows = {key.replace("_", " "): shown(value) for key, value in entries.items()}
    with pd.option_context("display.max_colwidth", None):  # or pandas would cut long texts
        table = pd.Series(rows).to_frame().to_html(header=False, border=0, classes="summary")
    reports = [escape(path.read_text("utf-8")) for path in folder.glob("*.txt")]
    texts = [f"<h2>Report</h2><pre>{report}</pre>" for report in reports]
    pictures = [_picture(path) for path in sorted((folder / folders.FIGURES).glob("*.png"))]
    names = sorted({path.name for path in folder.iterdir() if path.is_file()} - {folders.PAGE})
    links = "".join(f'<li><a href="{quote(name)}">{escape(name)}</a></li>' for name in names)
    files = f"<h2>Files</h2><ul>{links}</ul>"
    body = "\n".join([f"<h1>{title}</h1>{table}", *texts, *pictures, *parts, files])
    style = STYLE.read_text(encoding="utf-8")
    head = f'<meta charset="utf-8"><title>{title}</title><style>\n{style}</style>'
    html = f'<!doctype html><html lang="en"><head>{head}</head><body>{body}</body></html>\n'
    (folder / folders.PAGE).write_text(html, encoding="utf-8")


def _picture(path: Path) -> str:
    content = path.read_bytes()
    data = base64.b64encode(content).decode()
    name = escape(path.stem)
    # The header of a PNG has its width. Pictures have more pixels than the page needs, so that they
    # stay sharp on screens with a high resolution.
    width = round(int.from_bytes(content[16:20], "big") * 0.55)
    image = f'<img alt="{name}" width="{width}" src="data:image/png;base64,{data}">'
    return f"<figure>{image}<figcaption>{name}</figcaption></figure>"


def _table(title: str, frame: pd.DataFrame, rows: int) -> str:
    shown = frame.head(rows).to_html(float_format="{:.5g}".format, border=0)
    more = f"<p>{rows} of {len(frame)} rows</p>" if len(frame) > rows else ""
    return f"<h2>{escape(title)}</h2>{shown}{more}"


def lane_table(dataset: xr.Dataset) -> pd.DataFrame:
    """Return a table with a row per lane of a sweep: axes, and outputs that are single numbers."""
    dims = dataset["result"].dims
    table = dataset[[name for name in dataset.data_vars if dataset[name].dims == dims]]
    # A sweep over a grid has a dimension for each axis. The lanes become one list, in which the
    # values of the axes are columns.
    if dims != ("lane",):
        table = table.stack(lane=dims, create_index=False)
        labels = {dim: ("lane", table[dim].values, dataset[dim].attrs) for dim in dims}
        table = table.drop_vars(dims).assign_coords(labels)
    return to_frame(table, "lane")


def _write_view(folder: Path, scene: Scene, solution: Solution) -> None:
    try:
        view(scene, solution).save(folder / folders.VIEW)
    except ImportError as error:  # the packages for views are optional
        say(f"note: {folders.VIEW} is not written. {error}")
