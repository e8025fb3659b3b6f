"""`clearjoint report`: figures and the page of a folder of results."""

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

import pandas as pd

from ..export.tabular import to_frame
from ..identification.fit import Fit
from ..model.scene import Scene
from ..plot.report_tables import IMPACT_COLUMNS, impact_rows
from ..simulation.results.impact_table import Impacts
from ..simulation.results.observe import observe
from ..simulation.results.solution import Solution
from ..sweeps.store.store import open_sweep
from ..views.viewing import view
from . import figures, pages
from .endings import say
from .folders import MOTION, NUMBERS, PAGE, STORE, Folder, scene_and_solution

if TYPE_CHECKING:
    import xarray as xr

ROWS = 20
"""Rows of a table that the page shows."""
TABLE = "sweep.csv"
VIEW = "view.html"


def write_report(folder: Folder) -> None:
    """Draw the figures of a folder anew and write its page."""
    kind = folder.summary()["kind"]
    if kind == "run":
        write_run_report(folder)
    elif kind == "sweep":
        write_sweep_report(folder, open_sweep(folder / STORE).load())
    else:
        write_page(folder)


def write_run_report(folder: Folder) -> None:
    """Figures, page, and the 3D view where there is one, of a run."""
    parts = []
    if folder.table(MOTION) is not None:
        scene, solution = scene_and_solution(folder)
        figures.draw_run(folder, scene, solution, observe(scene, solution))
        _write_view(folder, scene, solution)
        if solution.impacts is not None and len(solution.impacts):
            parts.append(_hardest_impacts(solution.impacts))
    if (folder / NUMBERS).exists():
        numbers = pd.read_csv(folder / NUMBERS).set_index("output")
        parts.insert(0, pages.table("Outputs", numbers, len(numbers)))
    write_page(folder, *parts)


def write_sweep_report(folder: Folder, dataset: "xr.Dataset") -> None:
    """Figures, the table of all lanes as CSV, and the page of a sweep."""
    frame = lane_table(dataset)
    frame.to_csv(folder / TABLE, index=False)
    figures.draw_sweep(folder, dataset)
    write_page(folder, pages.table("Lanes", frame, ROWS))


def write_fit_report(folder: Folder, found: Fit) -> None:
    """Figures, report text and page of a fit."""
    figures.draw_fit(folder, found)
    write_page(folder)


def write_page(folder: Folder, *parts: str) -> None:
    """Write the page of a folder: summary, texts, figures, parts of its own, and the files."""
    summary: Mapping[str, object] = folder.summary()
    texts = [pages.text("Report", path.read_text("utf-8")) for path in folder.path.glob("*.txt")]
    pictures = [pages.picture(path) for path in folder.pictures()]
    beside = sorted(path.name for path in folder.path.iterdir() if path.is_file())
    files = pages.links("Files", [name for name in beside if name != PAGE])
    facts = {key: value for key, value in summary.items() if key != "title" and value != "None"}
    facts = {key: _without_nothing(value) for key, value in facts.items()}
    content = [pages.facts(facts), *texts, *pictures, *parts, files]
    (folder / PAGE).write_text(pages.page(str(summary["title"]), content), encoding="utf-8")


def _without_nothing(value: object) -> object:
    """A setting's text without the options of a class that are not set: "Tsit5(scan_kind=None)"."""
    return re.sub(r"\((\w+=None(, )?)+\)", "", value) if isinstance(value, str) else value


def _hardest_impacts(impacts: Impacts) -> str:
    """The table of the hardest impacts, in the units in which pictures show them."""
    import pandas as pd

    rows = impact_rows(impacts, len(impacts))
    frame = pd.DataFrame(rows, columns=list(IMPACT_COLUMNS), index=range(1, len(rows) + 1))
    return pages.table("Hardest impacts", frame, ROWS)


def lane_table(dataset: "xr.Dataset") -> "pd.DataFrame":
    """A row for each lane of a sweep: its values of the axes and all single numbers of it."""
    dims = dataset["result"].dims
    names = [name for name in dataset.data_vars if dataset[name].dims == dims]
    whole = dataset[names]
    if dims != ("lane",):
        whole = whole.stack(lane=dims, create_index=False)
        labels = {dim: ("lane", whole[dim].values, dataset[dim].attrs) for dim in dims}
        whole = whole.drop_vars(dims).assign_coords(labels)
    return to_frame(whole, "lane")


def _write_view(folder: Folder, scene: Scene, solution: Solution) -> None:
    """The page with the moving mechanism; a note where the extra for it is not installed."""
    try:
        view(scene, solution).save(folder / VIEW)
    except ImportError as error:
        say(f"note: {VIEW} is left out. {error}")
