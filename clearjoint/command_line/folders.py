"""Write and read the folders of results."""

import json
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..dynamics.formulation import Formulation
from ..export.tabular import write_netcdf
from ..fields.cautions import quiet
from ..model.bodies import BodyState, State
from ..model.scene import Scene
from ..result_codes import RESULTS
from ..scene_files.files import load, save
from ..simulation.results.impact_table import Impacts
from ..simulation.results.solution import Crossings, Solution, Trajectory
from ..simulation.results.state_tables import BRISTLES, CONTACTS, STATE_PARTS, contact_label

if TYPE_CHECKING:
    import xarray as xr

    from .study import Study

SUMMARY = "summary.json"
SCENE, REACHED = "scene.toml", "reached.toml"
MOTION, OBSERVED, IMPACTS, OUTPUTS = "motion", "observed", "impacts", "outputs"
"""Names of the tables of a run, each in a netCDF and in a CSV file."""
NUMBERS = "numbers.csv"
"""File of the outputs that are one number of the run."""
SECTION = "section "
"""Prefix of the names of the tables of sections."""
STORE = "sweep.zarr"
FIGURES = "figures"
PAGE = "index.html"

Summary = Mapping[str, str | int | float]


@dataclass(frozen=True)
class Folder:
    """A folder with the results of a run, a sweep or a fit; ``folder / name`` is a path in it.

    - `path`: path of the folder.
    """

    path: Path

    @staticmethod
    def made(path: Path) -> "Folder":
        """Return the folder at a path, which is created if it does not exist."""
        path.mkdir(parents=True, exist_ok=True)
        return Folder(path)

    @staticmethod
    def found(path: Path) -> "Folder":
        """Return the folder at a path, which must contain results.

        **Raises:** `ValueError` for a folder without results.
        """
        if not (path / SUMMARY).is_file():
            raise ValueError(
                f"{path}: found no {SUMMARY}, expected a folder of results: pass the folder that "
                "`clearjoint run`, `sweep` or `fit` wrote (--out)."
            )
        return Folder(path)

    def __truediv__(self, name: str) -> Path:
        return self.path / name

    @property
    def figures(self) -> Path:
        """Path of the folder of the figures, which is created if it does not exist."""
        folder = self.path / FIGURES
        folder.mkdir(exist_ok=True)
        return folder

    def pictures(self) -> list[Path]:
        """Return the paths of the figures, sorted by name."""
        return sorted((self.path / FIGURES).glob("*.png"))

    def write_summary(self, kind: str, study: "Study", results: Summary, start: float) -> None:
        """Write the file with the summary of the results, for users and for `clearjoint report`.

        **Arguments:** `kind`: "run", "sweep" or "fit"; `results`: further entries by name; `start`:
        value of `time.perf_counter` when the command began, s.
        """
        summary = {
            "kind": kind,
            "title": study.title,
            "file": str(study.path),
            **results,
            "seconds": round(time.perf_counter() - start, 2),
        }
        text = json.dumps(summary, indent=2, ensure_ascii=False)
        (self / SUMMARY).write_text(text + "\n", encoding="utf-8")

    def summary(self) -> dict[str, str | int | float]:
        """Read the summary: entries by name, among them "kind" and "title"."""
        return json.loads((self / SUMMARY).read_text(encoding="utf-8"))

    def write_scene(self, scene: Scene, state: State, name: str = SCENE) -> None:
        """Write a scene and a state to a scene file in the folder; write nothing if they can't be
        saved, such as a state with NaN."""
        with suppress(ValueError):
            save(scene, state, self / name)

    def write_table(self, name: str, table: "xr.Dataset", csv: bool = True) -> None:
        """Write a data set to the netCDF file `name`.nc, and with `csv` also to `name`.csv."""
        from ..export.tabular import to_frame

        write_netcdf(table, self / f"{name}.nc")
        if csv:
            to_frame(table).to_csv(self / f"{name}.csv")

    def table(self, name: str) -> "xr.Dataset | None":
        """Read the data set in the netCDF file `name`.nc; return ``None`` without such a file."""
        import xarray as xr

        path = self / f"{name}.nc"
        if not path.exists():
            return None
        table = xr.load_dataset(path, engine="scipy")
        return table.rename({n: v.attrs.get("original_name", n) for n, v in table.items()})


def scene_and_solution(folder: Folder) -> tuple[Scene, Solution]:
    """Read the scene of a run and its solution from a folder; the solution has no accepted steps,
    since these are not stored.

    **Raises:** `ValueError` for a folder without a run.
    """
    motion = folder.table(MOTION)
    if motion is None or not (folder / SCENE).exists():
        raise ValueError(
            f"{folder.path}: found no {MOTION}.nc and {SCENE}, expected both: run "
            "`clearjoint run` again."
        )
    with quiet():
        scene, _ = load(folder / SCENE)
    reached = {
        str(name).removeprefix("final_"): values
        for name, values in motion.data_vars.items()
        if str(name).startswith("final_")
    }
    redundant = motion.attrs["redundant_constraints"]
    names = () if redundant == "none" else tuple(redundant.split(", "))
    # The file has the message of the result; one of another version counts as not finished.
    results = {RESULTS[item]: item for item in RESULTS._name_to_item.values()}
    solution = Solution(
        time=float(motion.attrs["time_reached"]),
        final=_state(scene, reached),
        result=results.get(motion.attrs["result"], RESULTS.max_steps_reached),
        attempts=int(motion.attrs["attempts"]),
        accepted=int(motion.attrs["accepted"]),
        saved=Trajectory(motion["time"].values, _state(scene, dict(motion.data_vars))),
        saved_count=motion.sizes["time"],
        steps=None,
        impacts=_impacts(folder.table(IMPACTS)),
        formulation=Formulation(redundant=bool(names)),
        redundant_constraints=names,
        sections=_sections(folder),
        settings=tuple(
            (key, value.item() if isinstance(value, np.generic) else value)
            for key, value in motion.attrs.items()
            if key.startswith("setting_")
        ),
    )
    return scene, solution


def _state(scene: Scene, tables: Mapping) -> State:
    """Return the state, with a leading axis of times if the tables have one, from the tables that
    `state_arrays` has made."""
    bodies = {
        name: BodyState(*(tables[part].sel(body=name).values for part in STATE_PARTS))
        for name in scene.bodies
    }
    entry_speeds = _by_contact(scene, tables.get("entry_speed"), CONTACTS)
    bristles = _by_contact(scene, tables.get("bristle_deflection"), BRISTLES)
    ledger = tables.get("ledger")
    work = (
        {}
        if ledger is None
        else {str(n): ledger.sel(integral=n).values for n in ledger.integral.values}
    )
    return State(bodies, entry_speeds, work, bristles)


def _by_contact(
    scene: Scene, table: "xr.DataArray | None", dim: str
) -> dict[str, dict[str, np.ndarray]]:
    if table is None:
        return {}
    labels = table[dim].values.tolist()
    by_joint = {
        joint: {
            contact: table.sel({dim: contact_label(joint, contact)}).values
            for contact in family
            if contact_label(joint, contact) in labels
        }
        for joint, family in scene.laws().items()
    }
    return {joint: family for joint, family in by_joint.items() if family}


def _impacts(table: "xr.Dataset | None") -> Impacts | None:
    if table is None:
        return None
    columns = {f.name: table[f.name].values for f in fields(Impacts)}
    names = {name: columns[name].astype(object) for name in ("joint", "contact")}
    return Impacts(**{**columns, **names})


def _sections(folder: Folder) -> dict[str, Crossings]:
    sections = {}
    for path in sorted(folder.path.glob(f"{SECTION}*.nc")):
        table = folder.table(path.stem)
        assert table is not None
        units = {str(name): table[name].attrs.get("units", "1") for name in table.data_vars}
        values = {name: table[name].values for name in units}
        sections[path.stem.removeprefix(SECTION)] = Crossings(table["time"].values, values, units)
    return sections
