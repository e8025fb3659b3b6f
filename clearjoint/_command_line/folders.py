"""The files in a folder of results."""

import json
import time
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from zlib import crc32

import numpy as np
import xarray as xr

from .._dynamics.formulation import Formulation
from .._dynamics.sampled_forces import memory_names
from .._export.datasets import to_frame, write_netcdf
from .._fields.cautions import quiet
from .._model.bodies import BodyState, State
from .._model.scene import Scene
from .._result_codes import RESULTS
from .._scene_files.documents import FileLocation
from .._scene_files.files import Writer, load, save
from .._scene_files.reading import Reader
from .._simulation.results import solution as solutions
from .._simulation.results.impact_table import IMPACT_UNITS, NAMED, Impacts
from .study import CLASSES, AbstractStudy

SUMMARY = "summary.json"
SCENE, REACHED = "scene.toml", "reached.toml"
"""Scene files with the state at the start and at the end of the run."""
MOTION, OBSERVED, IMPACTS, OUTPUTS = "motion", "observed", "impacts", "outputs"
"""Tables of a run: saved states; forces, accelerations and energies; impacts; quantities."""
DRAWN = "drawn"
"""NetCDF file of the states from which a run's figures are drawn: more than those saved."""
NUMBERS = "numbers.csv"
FORMULATION = "formulation"
"""Attribute of the table of saved states: the run's formulation, as JSON."""
SECTION, TABLE, REJECTED = "section ", "impacts of ", "rejected steps of "
"""Prefixes of the names of the tables of outputs."""
STORE, WEAR_STORE = "sweep.zarr", "wear.zarr"
FIGURES = "figures"
PAGE, VIEW, PDF = "index.html", "view.html", "report.pdf"

Summary = Mapping[str, str | int | float]


def write_summary(folder: Path, kind: str, study: AbstractStudy, results: Summary) -> None:
    """Write the summary of a computation: the command, `kind`; title and file of the study; the
    `results`; and the time, s, since the study's file was read."""
    seconds = round(time.perf_counter() - study.started, 2)
    head = {"kind": kind, "title": study.title, "file": str(study.path)}
    text = json.dumps({**head, **results, "seconds": seconds}, indent=2, ensure_ascii=False)
    (folder / SUMMARY).write_text(text + "\n", encoding="utf-8")


def read_summary(folder: Path) -> dict[str, str | int | float]:
    """Return the entries of the summary; `ValueError` for a folder without results."""
    summary: dict[str, str | int | float] = {}
    if (folder / SUMMARY).is_file():
        summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    if not {"kind", "title"} <= summary.keys():
        raise ValueError(
            f"{folder}: found no {SUMMARY} with kind and title, expected a folder of results: "
            "pass the folder that `clearjoint run`, `sweep`, `fit` or `wear` wrote (--out)."
        )
    return summary


def write_scene(folder: Path, scene: Scene, state: State, name: str = SCENE) -> None:
    """Write a scene file; write none if the state can't be saved, such as a state with NaN."""
    with suppress(ValueError):
        save(scene, state, folder / name)


def remove_old(folder: Path, tables: Iterable[str] = (), files: Iterable[str] = ()) -> None:
    """Remove earlier results, which a new page would also show: all figures, and the tables
    and files that match the patterns. From a folder without a summary, nothing is removed."""
    if (folder / SUMMARY).is_file():
        table_files = [f"{table}.{suffix}" for table in tables for suffix in ("nc", "csv")]
        for pattern in (f"{FIGURES}/*.png", *table_files, *files):
            for path in folder.glob(pattern):
                path.unlink()


def file_name(name: str) -> str:
    """Return the name, without suffix, of the file of a table or figure: without slashes, and not
    too long for file systems. A changed name gets a checksum, so that files differ if names do."""
    safe = name.replace("/", "_")
    if len(safe.encode()) > 200:
        safe = f"{safe[:40]}_{safe[-20:]}"
    return safe if safe == name else f"{safe}_{crc32(name.encode()):08x}"


def write_table(folder: Path, name: str, table: xr.Dataset) -> None:
    """Write a dataset to `name`.nc (netCDF) and `name`.csv, where `file_name` may change `name`."""
    file = file_name(name)
    # The name of the table is kept as an attribute, because the name of the file may differ.
    write_netcdf(table.assign_attrs(table=name), folder / f"{file}.nc")
    to_frame(table).to_csv(folder / f"{file}.csv")


def read_table(folder: Path, name: str, needed: Iterable[str] = ()) -> xr.Dataset | None:
    """Return the dataset in the file `name`.nc, or ``None`` if there is no such file.

    **Raises:** `ValueError` if the file lacks a variable, coordinate or attribute in `needed`.
    """
    path = folder / f"{name}.nc"
    if not path.exists():
        return None
    table = xr.load_dataset(path, engine="scipy")
    # Names that netCDF does not allow were changed when the file was written.
    table = table.rename({n: v.attrs.get("original_name", n) for n, v in table.items()})
    require_names(path, needed, {*table.variables, *table.attrs})
    return table


def require_names(path: Path, needed: Iterable[str], available: Collection[object]) -> None:
    lacking = [name for name in needed if name not in available]
    if lacking:
        raise ValueError(
            f"{path}: found no {', '.join(lacking)}, expected results of this version and of "
            f"the scene in {SCENE}: compute them again."
        )


def read_run(folder: Path) -> tuple[Scene, solutions.Solution]:
    """Return scene and solution of a run in a folder, without the accepted steps, and with sections
    as the only outputs. Saved states are from the file `DRAWN` or, without this, from `MOTION`."""
    # Names of variables, coordinates and attributes that the tables must have.
    states = ["time", "body", *solutions.STATE_PARTS]
    needed = [*states, *(f"final_{part}" for part in solutions.STATE_PARTS), FORMULATION]
    needed += ["time_reached", "result", "attempts", "accepted", "redundant_constraints"]
    motion, drawn = read_table(folder, MOTION, needed), read_table(folder, DRAWN, states)
    if motion is None or not (folder / SCENE).exists():
        files = f"{MOTION}.nc and {SCENE}"
        remedy = "run `clearjoint run` again"
        raise ValueError(f"{folder}: found no {files}, expected both: {remedy}.")
    # Warnings about unusual values were issued when the run was made.
    with quiet():
        scene, _ = load(folder / SCENE)
    require_names(folder / f"{MOTION}.nc", scene.bodies, motion["body"].values.tolist())
    redundant = motion.attrs["redundant_constraints"]
    names = () if redundant == "none" else tuple(redundant.split(", "))
    # The file has the message of the result instead of its code. The message of another version may
    # be unknown here; such a run counts as one that was not finished.
    results = {RESULTS[item]: item for item in RESULTS._name_to_item.values()}
    notes = {key: value for key, value in motion.attrs.items() if key.startswith("setting_")}
    saved = motion if drawn is None else drawn
    return scene, solutions.Solution(
        time=float(motion.attrs["time_reached"]),
        final=_state(scene, motion, "final_"),
        result=results.get(motion.attrs["result"], RESULTS.max_steps_reached),
        attempts=int(motion.attrs["attempts"]),
        accepted=int(motion.attrs["accepted"]),
        saved=solutions.Trajectory(saved["time"].values, _state(scene, saved)),
        saved_count=saved.sizes["time"],
        steps=None,
        impacts=_impacts(folder),
        formulation=read_formulation(motion.attrs, FileLocation(f"{folder / MOTION}.nc")),
        redundant_constraints=names,
        outputs=_sections(folder),
        settings=tuple((k, v.item() if isinstance(v, np.generic) else v) for k, v in notes.items()),
    )


def _impacts(folder: Path) -> Impacts | None:
    table = read_table(folder, IMPACTS, [*NAMED, *IMPACT_UNITS])
    if table is None:
        return None
    names = {name: table[name].values.astype(object) for name in NAMED}
    return Impacts(**names, **{name: table[name].values for name in IMPACT_UNITS})


def formulation_text(formulation: Formulation) -> str:
    return json.dumps(Writer().table(formulation, FileLocation(MOTION)))


def read_formulation(notes: Mapping[str, object], location: FileLocation) -> Formulation:
    table = json.loads(str(notes[FORMULATION]))
    return Reader(CLASSES).instance(Formulation, table, location.at(FORMULATION))


def _state(scene: Scene, table: xr.Dataset, prefix: str = "") -> State:
    # `prefix`: of the variables of the state in the table, "final_" for the last state of a run.
    parts = {part: table[prefix + part] for part in solutions.STATE_PARTS}
    bodies = {}
    for name in scene.bodies:
        bodies[name] = BodyState(**{n: rows.sel(body=name).values for n, rows in parts.items()})
    ledger, work = table.get(f"{prefix}ledger"), {}
    if ledger is not None:
        work = {str(n): ledger.sel(integral=n).values for n in ledger["integral"].values}
    contacts = scene.laws()
    entry_speeds = _by_label(contacts, table.get(f"{prefix}entry_speed"), solutions.CONTACTS)
    bristles = _by_label(contacts, table.get(f"{prefix}bristle_deflection"), solutions.BRISTLES)
    memory = _by_label(memory_names(scene), table.get(f"{prefix}memory"), solutions.MEMORY)
    return State(bodies, entry_speeds, work, bristles, memory)


def _by_label(
    names: Mapping[str, Iterable[str]], table: xr.DataArray | None, dim: str
) -> dict[str, dict[str, np.ndarray]]:
    # Returns the entries of `table` along its dimension `dim` by the names of an element and of its
    # contact or number, which `names` has by element.
    by_element: dict[str, dict[str, np.ndarray]] = {}
    if table is None:  # such as the entry speeds of a scene whose laws do not use them
        return by_element
    # An element may lack an entry, such as a contact without bristles.
    for element, family in names.items():
        for name in family:
            if (label := solutions.contact_label(element, name)) in table[dim].values:
                by_element.setdefault(element, {})[name] = table.sel({dim: label}).values
    return by_element


def _sections(folder: Path) -> dict[str, solutions.Crossings]:
    sections = {}
    for path in sorted(folder.glob(f"{SECTION}*.nc")):
        table = read_table(folder, path.stem, ["time"])
        assert table is not None
        units = {str(name): row.attrs.get("units", "1") for name, row in table.items()}
        values = {name: table[name].values for name in units}
        # The name of the file may be changed by `file_name`; the attribute has the original name.
        name = str(table.attrs["table"]).removeprefix(SECTION)
        sections[name] = solutions.Crossings(table["time"].values, values, units)
    return sections
