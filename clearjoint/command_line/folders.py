"""Write and read the files in a folder of results."""

import json
import re
import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import fields, replace
from pathlib import Path
from zlib import crc32

import numpy as np
import xarray as xr

from ..dynamics.formulation import Formulation
from ..export.datasets import to_frame, write_netcdf
from ..fields.cautions import quiet
from ..fields.checks import errors_about, require
from ..model.bodies import BodyState, State
from ..model.scene import Scene
from ..result_codes import RESULTS
from ..scene_files.files import load, save
from ..simulation.results.impact_table import Impacts
from ..simulation.results.solution import (
    BRISTLES,
    CONTACTS,
    STATE_PARTS,
    Crossings,
    Solution,
    Trajectory,
    contact_label,
)
from .study import CLASSES, Study

SUMMARY = "summary.json"
"""File of the summary: kind, title and ending of the results."""
SCENE, REACHED = "scene.toml", "reached.toml"
"""Files of the scene with its initial state, and with the state at the end of the run."""
MOTION, OBSERVED, IMPACTS, OUTPUTS = "motion", "observed", "impacts", "outputs"
"""Names of the tables of a run, each in a netCDF and in a CSV file: the saved states; the forces,
accelerations and energies at these states; the impacts; and the outputs of the study that are
quantities at these states."""
DRAWN = "drawn"
"""Name of the netCDF file of further states of a run between the saved ones, for its figures."""
NUMBERS = "numbers.csv"
"""File of the outputs that are one number of the run."""
SECTION = "section "
"""Prefix of the names of the tables of Poincaré sections."""
STORE, WEAR_STORE = "sweep.zarr", "wear.zarr"
"""Folders of the Zarr stores of a sweep and of wear."""
FIGURES = "figures"
"""Folder of the figures."""
PAGE = "index.html"
"""File of the page that shows all results."""

Summary = Mapping[str, str | int | float]
"""Entries of a summary by name."""


def write_summary(folder: Path, kind: str, study: Study, results: Summary) -> None:
    """Write the file with the summary of the results, for users and for `clearjoint report`.

    The summary has the kind and the title of the results, the path of the study's file, `results`,
    and the time, s, since that file was read.

    **Arguments:** `kind`: "run", "sweep", "fit" or "wear"; `results`: further entries by name.
    """
    seconds = round(time.perf_counter() - study.started, 2)
    title = study.parts.title or study.path.stem
    head = {"kind": kind, "title": title, "file": str(study.path)}
    text = json.dumps({**head, **results, "seconds": seconds}, indent=2, ensure_ascii=False)
    (folder / SUMMARY).write_text(text + "\n", encoding="utf-8")


def read_summary(folder: Path) -> dict[str, str | int | float]:
    """Return the entries of the summary by name, among them "kind" and "title".

    **Raises:** `ValueError` for a folder without results.
    """
    if not (folder / SUMMARY).is_file():
        raise ValueError(
            f"{folder}: found no {SUMMARY}, expected a folder of results: pass the folder that "
            "`clearjoint run`, `sweep`, `fit` or `wear` wrote (--out)."
        )
    return json.loads((folder / SUMMARY).read_text(encoding="utf-8"))


def write_scene(folder: Path, scene: Scene, state: State, name: str = SCENE) -> None:
    """Write a scene and a state to the scene file `name` in the folder. Write nothing if they can't
    be saved: a failed run may have ended in a state with NaN."""
    with suppress(ValueError):
        save(scene, state, folder / name)


def remove_old(folder: Path, tables: Iterable[str] = (), files: Iterable[str] = ()) -> None:
    """Remove figures, tables and files of earlier results of a command from its folder.

    If they were kept, the new page would also show those that the command does not write again,
    such as the figure of an output that is no longer in the study. A folder without a summary does
    not contain results, so nothing is removed from it.

    **Arguments:** `tables`: names of tables, as for `write_table`, and `files`: names of files;
    "*" in a name stands for any characters.
    """
    if (folder / SUMMARY).is_file():
        both = [f"{table}.{suffix}" for table in tables for suffix in ("nc", "csv")]
        for pattern in (f"{FIGURES}/*.png", *both, *files):
            for path in folder.glob(pattern):
                path.unlink()


def file_name(name: str) -> str:
    """Return the name of the file, without suffix, for the table or figure with the given name.

    Slashes are replaced by "_". Of a long name only the start and the end are kept, because file
    systems allow names of at most 255 bytes. A name that was changed gets a checksum, so that
    different names give different files.
    """
    safe = name.replace("/", "_")
    if len(safe.encode()) > 200:
        safe = f"{safe[:40]}_{safe[-20:]}"
    return safe if safe == name else f"{safe}_{crc32(name.encode()):08x}"


def write_table(folder: Path, name: str, table: xr.Dataset) -> None:
    """Write a dataset to the files `name`.nc (netCDF) and `name`.csv, with the name changed by
    `file_name` if files can't have it."""
    file = file_name(name)
    # The name of the table is kept as an attribute, because the name of the file may differ.
    write_netcdf(table.assign_attrs(table=name), folder / f"{file}.nc")
    to_frame(table).to_csv(folder / f"{file}.csv")


def read_table(folder: Path, name: str) -> xr.Dataset | None:
    """Return the dataset in the file `name`.nc; ``None`` without such a file."""
    path = folder / f"{name}.nc"
    if not path.exists():
        return None
    table = xr.load_dataset(path, engine="scipy")
    # Names that netCDF does not allow were changed when the file was written.
    return table.rename({n: v.attrs.get("original_name", n) for n, v in table.items()})


def read_run(folder: Path) -> tuple[Scene, Solution]:
    """Return the scene and the solution of a run in a folder, from which the figures of the run can
    be drawn again.

    The field `steps` of the solution is None, since the accepted steps are not stored. If the run
    ended with a message that this version of the package does not know, the result code is
    `max_steps_reached`.

    **Raises:** `ValueError` for a folder without saved states or without the file of the scene, and
    for coordinates or a stabilisation of a class that this version does not know.
    """
    motion = read_table(folder, MOTION)
    if motion is None or not (folder / SCENE).exists():
        files = f"{MOTION}.nc and {SCENE}"
        remedy = "run `clearjoint run` again"
        raise ValueError(f"{folder}: found no {files}, expected both: {remedy}.")
    # Warnings about unusual values were issued when the run was made.
    with quiet():
        scene, _ = load(folder / SCENE)
    redundant = motion.attrs["redundant_constraints"]
    names = () if redundant == "none" else tuple(redundant.split(", "))
    # The file has the message of the result instead of its code. The message of another version may
    # be unknown here; such a run counts as one that was not finished.
    results = {RESULTS[item]: item for item in RESULTS._name_to_item.values()}
    with errors_about(f"{folder / MOTION}.nc"):
        formulation = formulation_of(motion.attrs, bool(names))
    impacts = read_table(folder, IMPACTS)
    solution = Solution(
        time=float(motion.attrs["time_reached"]),
        final=_state(scene, motion, "final_"),
        result=results.get(motion.attrs["result"], RESULTS.max_steps_reached),
        attempts=int(motion.attrs["attempts"]),
        accepted=int(motion.attrs["accepted"]),
        saved=Trajectory(motion["time"].values, _state(scene, motion)),
        saved_count=motion.sizes["time"],
        steps=None,
        impacts=None if impacts is None else _impacts(impacts),
        formulation=formulation,
        redundant_constraints=names,
        sections=_sections(folder),
        settings=tuple(
            (key, value.item() if isinstance(value, np.generic) else value)
            for key, value in motion.attrs.items()
            if key.startswith("setting_")
        ),
    )
    return scene, solution


def read_drawn(folder: Path, scene: Scene, solution: Solution) -> Solution:
    """Return a solution from `read_run` with further states between its saved ones, for figures;
    `solution` itself for results of an earlier version, which have none."""
    table = read_table(folder, DRAWN)
    if table is None:
        return solution
    path = Trajectory(table["time"].values, _state(scene, table))
    return replace(solution, saved=path, saved_count=len(path))


def formulation_of(notes: Mapping[str, object], redundant: bool) -> Formulation:
    """Return the formulation of a run: its coordinates, its stabilisation of constraints, and
    whether it integrates the energy ledger (powers of damping, friction, films, drives and
    stabilisation).

    **Arguments:**

    - `notes`: attributes of a table of the run. The attributes "setting_coordinates",
      "setting_stabilisation" and "setting_ledger" are texts such as
      "Baumgarte(alpha=5.0, beta=5.0)"; the defaults of `Formulation` replace absent ones.
    - `redundant`: whether some constraints depend on others.

    **Raises:** `ValueError` for a class that this version of the package does not know.
    """
    chosen = {}
    # A text names a class and its fields, from which the object is made again.
    for name in ("coordinates", "stabilisation"):
        kind, _, arguments = str(notes.get(f"setting_{name}", "")).partition("(")
        if kind:
            numbers = re.findall(r"(\w+)=([^,)]+)", arguments)
            known = [one for one in CLASSES if one.__name__ == kind]
            expected, remedy = "a class of this version", "run `clearjoint run` again"
            require(len(known) == 1, f"setting_{name}", kind, expected, remedy)
            chosen[name] = known[0](**{key: float(number) for key, number in numbers})
    ledger = notes.get("setting_ledger") == "True"
    return Formulation(**chosen, redundant=redundant, ledger=ledger)


def _state(scene: Scene, table: xr.Dataset, prefix: str = "") -> State:
    """Return the state, or the states at N times, in a table of states.

    **Arguments:** `table`: arrays such as "position" along "body" and "component", with or without
    a first axis of times; `prefix`: text in front of their names, "final_" for the final state.
    """
    bodies = {
        name: BodyState(*(table[prefix + part].sel(body=name).values for part in STATE_PARTS))
        for name in scene.bodies
    }
    ledger, work = table.get(f"{prefix}ledger"), {}
    if ledger is not None:
        work = {str(n): ledger.sel(integral=n).values for n in ledger["integral"].values}
    entry_speeds = _by_contact(scene, table.get(f"{prefix}entry_speed"), CONTACTS)
    bristles = _by_contact(scene, table.get(f"{prefix}bristle_deflection"), BRISTLES)
    return State(bodies, entry_speeds, work, bristles)


def _by_contact(
    scene: Scene, table: xr.DataArray | None, dim: str
) -> dict[str, dict[str, np.ndarray]]:
    """Return the values of one state variable of the contacts, by joint and contact.

    Contacts that are not in the table are left out.

    **Arguments:** `table`: array of the variable, None if no contact has this variable; `dim`:
    dimension of the array along the contacts, which are named as by `contact_label`.
    """
    by_joint: dict[str, dict[str, np.ndarray]] = {}
    for joint, family in ({} if table is None else scene.laws()).items():
        for contact in family:
            if (label := contact_label(joint, contact)) in table[dim].values:  # pyright: ignore
                values = table.sel({dim: label}).values  # pyright: ignore
                by_joint.setdefault(joint, {})[contact] = values
    return by_joint


def _impacts(table: xr.Dataset) -> Impacts:
    columns = {f.name: table[f.name].values for f in fields(Impacts)}
    names = {name: columns[name].astype(object) for name in ("joint", "contact")}
    return Impacts(**{**columns, **names})


def _sections(folder: Path) -> dict[str, Crossings]:
    sections = {}
    for path in sorted(folder.glob(f"{SECTION}*.nc")):
        table = read_table(folder, path.stem)
        assert table is not None
        units = {str(name): row.attrs.get("units", "1") for name, row in table.items()}
        values = {name: table[name].values for name in units}
        # Files of earlier versions lack the name of the table.
        name = str(table.attrs.get("table", path.stem)).removeprefix(SECTION)
        sections[name] = Crossings(table["time"].values, values, units)
    return sections
