"""Draw the figures and write the page of a folder of results, for `clearjoint report` and at the
end of the commands `run`, `sweep`, `fit` and `wear`."""

import base64
import re
from html import escape
from pathlib import Path
from urllib.parse import quote

import pandas as pd
import xarray as xr

from ..durability.wear import open_wear
from ..export.tabular import to_frame
from ..identification.fit import Fit
from ..model.scene import Scene
from ..plot.report_tables import IMPACT_COLUMNS, impact_rows
from ..simulation.results.observe import observe
from ..simulation.results.solution import Solution
from ..sweeps.store.store import open_sweep
from ..views.viewing import view
from . import figures
from .endings import say
from .figures import worn_parts
from .folders import FIGURES, MOTION, NUMBERS, PAGE, STORE, WEAR_STORE, read_run, read_summary

ROWS = 20
"""Rows of a table that the page shows at most."""
STAGES, PROFILES = "stages.csv", "profiles.csv"
"""Files of the tables of wear: depths before each stage, and around each worn part at the end."""
VIEW = "view.html"
"""File of the page with the animation of a run."""
STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 70rem; margin: 2rem auto; padding: 0 1rem;
  color: #1a1a1a; background: #fff; }
table { border-collapse: collapse; margin: 1rem 0; font-size: 13px; display: block;
  overflow-x: auto; }
th, td { border-bottom: 1px solid #ddd; padding: .2rem .7rem; text-align: right;
  overflow-wrap: anywhere; }
th { text-align: left; } .summary td { text-align: left; }
figure { display: inline-block; margin: .5rem; vertical-align: top; }
figure img { max-width: 100%; height: auto; } figcaption { color: #555; font-size: 13px; }
pre { background: #f6f6f6; padding: 1rem; overflow-x: auto; font-size: 13px; }
"""
"""Style sheet of the page."""


def write_report(folder: Path) -> None:
    """Draw the figures of the results in a folder again, and write the HTML page that shows them.

    Of a fit only the page is written, with the existing figures, since the folder does not have all
    that they were drawn from.

    **Raises:** `ValueError` for a folder without results.
    """
    kind = read_summary(folder)["kind"]
    if kind == "run":
        write_run_report(folder)
    elif kind == "sweep":
        write_sweep_report(folder, open_sweep(folder / STORE).load())
    elif kind == "wear":
        write_wear_report(folder, open_wear(folder / WEAR_STORE))
    else:
        write_page(folder)


def write_run_report(folder: Path) -> None:
    """Write the page of a run from the files in its folder.

    If these include saved states, its figures are drawn and, if the packages for it are installed,
    the 3D animation is written, too.
    """
    parts = []
    if (folder / NUMBERS).exists():
        numbers = pd.read_csv(folder / NUMBERS).set_index("output")
        parts.append(_table("Outputs", numbers, len(numbers)))
    if (folder / f"{MOTION}.nc").exists():
        scene, solution = read_run(folder)
        figures.draw_run(folder, scene, solution, observe(scene, solution))
        _write_view(folder, scene, solution)
        if solution.impacts is not None and len(solution.impacts):
            rows = impact_rows(solution.impacts, len(solution.impacts))
            frame = pd.DataFrame(rows, columns=list(IMPACT_COLUMNS), index=range(1, len(rows) + 1))
            parts.append(_table("Hardest impacts", frame, ROWS))
    write_page(folder, *parts)


def write_sweep_report(folder: Path, dataset: xr.Dataset) -> None:
    """Draw the figures of a sweep, and write its page and a CSV table with a row for each lane."""
    frame = lane_table(dataset)
    frame.to_csv(folder / "sweep.csv", index=False)
    figures.draw_sweep(folder, dataset)
    write_page(folder, _table("Lanes", frame, ROWS))


def write_fit_report(folder: Path, found: Fit) -> None:
    """Draw the figures of a fit and write its page."""
    figures.draw_fit(folder, found)
    write_page(folder)


def write_wear_report(folder: Path, found: xr.Dataset) -> None:
    """Draw the figures of a result of `clearjoint.wear`, and write its page and CSV tables of the
    stages and of the worn profiles."""
    frame = stage_table(found)
    frame.to_csv(folder / STAGES, index=False)
    last = found.isel(stage=-1)
    profiles = {"angle [rad]": found["angle"].values} | {
        f"{part} of {joint} [m]": last[f"{part}_depth"].sel(joint=joint).values
        for joint, part in worn_parts(found)
    }
    pd.DataFrame(profiles).to_csv(folder / PROFILES, index=False)
    figures.draw_wear(folder, found)
    write_page(folder, _table("Stages", frame, len(frame)))


def stage_table(found: xr.Dataset) -> pd.DataFrame:
    """Return a table with a row for each stage of a result of `clearjoint.wear`: the number of
    cycles before it, the largest force in each joint, N, and the largest and the mean depth, m, and
    the volume, m^3, of each part that has worn. The last stage has no run and no force."""
    columns = {"cycles": found["cycles"].values}
    for joint in found["joint"].values:
        columns[f"force in {joint} [N]"] = found["force"].sel(joint=joint).values
    for joint, part in worn_parts(found):
        depths = found[f"{part}_depth"].sel(joint=joint).transpose("stage", "angle").values
        columns[f"{part} of {joint}, largest [m]"] = depths.max(axis=1)
        columns[f"{part} of {joint}, mean [m]"] = depths.mean(axis=1)
        columns[f"{part} of {joint}, volume [m^3]"] = (
            found[f"{part}_volume"].sel(joint=joint).values
        )
    return pd.DataFrame(columns)


def write_page(folder: Path, *parts: str) -> None:
    """Write the HTML page of a folder of results, which loads nothing from the network.

    It contains the summary, the text files, the figures, and links to all files.

    **Arguments:** `parts`: further parts of the page, as HTML.
    """
    summary = read_summary(folder)
    title = escape(str(summary.pop("title")))
    # Options of a setting that are None are left out: "Tsit5" for "Tsit5(scan_kind=None)".
    rows = {
        key.replace("_", " "): re.sub(r"\((\w+=None(, )?)+\)", "", str(value))
        for key, value in summary.items()
        if str(value) != "None"
    }
    with pd.option_context("display.max_colwidth", None):  # or pandas would cut long texts
        table = pd.Series(rows).to_frame().to_html(header=False, border=0, classes="summary")
    texts = [
        f"<h2>Report</h2><pre>{escape(path.read_text('utf-8'))}</pre>"
        for path in folder.glob("*.txt")
    ]
    pictures = [_picture(path) for path in sorted((folder / FIGURES).glob("*.png"))]
    names = sorted(path.name for path in folder.iterdir() if path.is_file() and path.name != PAGE)
    links = "".join(f'<li><a href="{quote(name)}">{escape(name)}</a></li>' for name in names)
    files = f"<h2>Files</h2><ul>{links}</ul>"
    body = "\n".join([f"<h1>{title}</h1>{table}", *texts, *pictures, *parts, files])
    head = f'<meta charset="utf-8"><title>{title}</title><style>{STYLE}</style>'
    html = f'<!doctype html><html lang="en"><head>{head}</head><body>{body}</body></html>\n'
    (folder / PAGE).write_text(html, encoding="utf-8")


def _picture(path: Path) -> str:
    """Return the HTML of a figure, which contains the picture itself, with the name of its PNG file
    as caption."""
    content = path.read_bytes()
    data = base64.b64encode(content).decode()
    name = escape(path.stem.replace("_", " "))
    # The header of a PNG has its width. Pictures have more pixels than the page needs, so that they
    # stay sharp on screens with a high resolution.
    width = round(int.from_bytes(content[16:20], "big") * 0.55)
    image = f'<img alt="{name}" width="{width}" src="data:image/png;base64,{data}">'
    return f"<figure>{image}<figcaption>{name}</figcaption></figure>"


def _table(title: str, frame: pd.DataFrame, rows: int) -> str:
    """Return the HTML of a heading and of the first `rows` rows of a data frame, with a note if
    there are more."""
    shown = frame.head(rows).to_html(float_format="{:.5g}".format, border=0)
    more = f"<p>{rows} of {len(frame)} rows</p>" if len(frame) > rows else ""
    return f"<h2>{escape(title)}</h2>{shown}{more}"


def lane_table(dataset: xr.Dataset) -> pd.DataFrame:
    """Return a table with a row for each lane of a sweep: the values of the axes, and the outputs
    that are one number of the lane."""
    dims = dataset["result"].dims
    table = dataset[[name for name in dataset.data_vars if dataset[name].dims == dims]]
    # A sweep over a grid has a dimension for each axis: they become columns of one list of lanes.
    if dims != ("lane",):
        table = table.stack(lane=dims, create_index=False)
        labels = {dim: ("lane", table[dim].values, dataset[dim].attrs) for dim in dims}
        table = table.drop_vars(dims).assign_coords(labels)
    return to_frame(table, "lane")


def _write_view(folder: Path, scene: Scene, solution: Solution) -> None:
    """Write the page with the 3D animation, or a note if the extra for it is not installed."""
    try:
        view(scene, solution).save(folder / VIEW)
    except ImportError as error:
        say(f"note: {VIEW} is not written. {error}")
