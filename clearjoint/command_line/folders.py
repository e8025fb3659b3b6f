"""Folders of results: what is in them, and how a run is read back."""

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..dynamics.formulation import Formulation
from ..export.provenance import Notes
from ..export.tabular import write_netcdf
from ..fields.cautions import quiet
from ..model.bodies import BodyState, State
from ..model.scene import Scene
from ..result_codes import RESULTS
from ..scene_files.files import load, save
from ..simulation.results.impact_table import Impacts
from ..simulation.results.solution import Solution, Trajectory
from ..simulation.results.state_tables import BRISTLES, CONTACTS, STATE_PARTS, contact_label
from ..simulation.run.sections import Crossings

if TYPE_CHECKING:
    import xarray as xr

SUMMARY = "summary.json"
SCENE, REACHED = "scene.toml", "reached.toml"
MOTION, OBSERVED, IMPACTS, OUTPUTS = "motion", "observed", "impacts", "outputs"
"""Names of the tables of a run, each in a netCDF and in a CSV file."""
NUMBERS = "numbers.csv"
"""What is one number of a run."""
SECTION = "section "
"""Of each section's table, before its name."""
STORE = "sweep.zarr"
FIGURES = "figures"
PAGE = "index.html"

Summary = Mapping[str, str | int | float]


@dataclass(frozen=True)
class Folder:
    """A folder of results."""

    path: Path

    @staticmethod
    def made(path: Path) -> "Folder":
        """The folder at a path, made if it is not there."""
        path.mkdir(parents=True, exist_ok=True)
        return Folder(path)

    @staticmethod
    def found(path: Path) -> "Folder":
        """The folder at a path, which has results.

        **Raises:** `ValueError` for any other.
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
        """The folder of the figures, made if it is not there."""
        folder = self.path / FIGURES
        folder.mkdir(exist_ok=True)
        return folder

    def pictures(self) -> list[Path]:
        """The figures, in their order."""
        return sorted((self.path / FIGURES).glob("*.png"))

    def write_summary(self, summary: Summary) -> None:
        """Write what the results are, for a reader and for `clearjoint report`."""
        text = json.dumps(dict(summary), indent=2, ensure_ascii=False)
        (self / SUMMARY).write_text(text + "\n", encoding="utf-8")

    def summary(self) -> dict[str, str | int | float]:
        """What the results are."""
        return json.loads((self / SUMMARY).read_text(encoding="utf-8"))

    def write_scene(self, scene: Scene, state: State, name: str = SCENE) -> None:
        """Write a scene with a state; a state that no file can hold, such as NaN, is left out."""
        with suppress(ValueError):
            save(scene, state, self / name)

    def write_table(self, name: str, table: "xr.Dataset", csv: bool = True) -> None:
        """Write a dataset as netCDF, and as CSV."""
        from ..export.tabular import to_frame

        write_netcdf(table, self / f"{name}.nc")
        if csv:
            to_frame(table).to_csv(self / f"{name}.csv")

    def table(self, name: str) -> "xr.Dataset | None":
        """A dataset that was written, if it was."""
        import xarray as xr

        path = self / f"{name}.nc"
        if not path.exists():
            return None
        found = xr.load_dataset(path, engine="scipy")
        return found.rename({n: v.attrs.get("original_name", n) for n, v in found.items()})


def scene_and_solution(folder: Folder) -> tuple[Scene, Solution]:
    """The scene of a run and its solution, as far as files hold it.

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
    finals = [str(name) for name in motion.data_vars if str(name).startswith("final_")]
    reached = {name.removeprefix("final_"): motion[name] for name in finals}
    redundant = motion.attrs["redundant_constraints"]
    names = () if redundant == "none" else tuple(redundant.split(", "))
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
        settings=_settings(motion),
    )
    return scene, solution


def _settings(motion: "xr.Dataset") -> Notes:
    """The settings of a run, of which a file holds numbers as arrays."""
    found = {k: v for k, v in motion.attrs.items() if k.startswith("setting_")}
    return tuple((k, v.item() if isinstance(v, np.generic) else v) for k, v in found.items())


def _state(scene: Scene, tables: Mapping) -> State:
    """States of the parts that `state_arrays` made."""
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
    found = {
        joint: {
            contact: table.sel({dim: contact_label(joint, contact)}).values
            for contact in family
            if contact_label(joint, contact) in labels
        }
        for joint, family in scene.laws().items()
    }
    return {joint: family for joint, family in found.items() if family}


def _impacts(table: "xr.Dataset | None") -> Impacts | None:
    if table is None:
        return None
    columns = {f.name: table[f.name].values for f in fields(Impacts)}
    names = {name: columns[name].astype(object) for name in ("joint", "contact")}
    return Impacts(**{**columns, **names})


def _sections(folder: Folder) -> dict[str, Crossings]:
    found = {}
    for path in sorted(folder.path.glob(f"{SECTION}*.nc")):
        table = folder.table(path.stem)
        assert table is not None
        units = {str(name): table[name].attrs.get("units", "1") for name in table.data_vars}
        values = {name: table[name].values for name in units}
        found[path.stem.removeprefix(SECTION)] = Crossings(table["time"].values, values, units)
    return found
