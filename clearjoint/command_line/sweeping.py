"""`clearjoint sweep`: run a scene for many values; an interrupted sweep can be continued."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..model.scene import Scene
from ..quantities.base import AbstractQuantity
from ..result_codes import result_numbers
from ..scene_files.locations import FileLocation
from ..simulation.run.saving import Saving
from ..sweeps.axes import Axis
from ..sweeps.outputs import Output, check_outputs
from ..sweeps.store.store import open_sweep
from ..sweeps.sweep import sweep as run_sweep
from .endings import FAILED, INTERRUPTED, WELL, CommandResult, say
from .folders import STORE, Folder, Summary
from .reports import write_sweep_report
from .study import Study
from .study_parts import AxisPart, SweepPart

if TYPE_CHECKING:
    import xarray as xr

Reading = Callable[[object, FileLocation], float]
"""Function that converts an entry of a study file, and its location, to a number in SI units."""
PIECES = 16
"""Default number of chunks of lanes that are stored together; an interruption loses at most one."""
LONGEST = 256
"""Largest default number of lanes in a chunk."""


@dataclass(frozen=True)
class SweepArguments:
    """Arguments of `clearjoint.sweep` of the same names, made from a study.

    - `axes`, `outputs`: swept parameters and outputs, by name.
    - `save`: what is saved of each lane.
    - `chunk`: number of lanes that are stored together.
    """

    axes: dict[str, Axis]
    outputs: Mapping[str, Output]
    save: Saving
    chunk: int


def sweep(study: Study, out: Path, progress: bool) -> CommandResult:
    """Run the sweep of a study's section [sweep], and write its store, tables, figures and page to
    the folder `out`.

    **Returns:** the exit code, and the result in a line.

    **Raises:** `ValueError` for a study without this section, and for wrong entries in it.
    """
    part = study.parts.sweep
    if part is None:
        study.location.at("sweep").refuse(None, "a section [sweep]", "add [sweep.axes.<name>]")
    arguments, start = sweep_arguments(study, part), time.perf_counter()
    end = study.end(part.end)
    settings = study.ledger_for(study.settings(part, "sweep"), part.outputs)
    folder = Folder.made(out)
    folder.write_scene(study.scene, study.state)
    code = WELL
    try:
        dataset = run_sweep(
            study.scene,
            study.state,
            end,
            arguments.axes,
            arguments.outputs,
            settings,
            arguments.save,
            zipped=part.zipped,
            path=folder / STORE,
            chunk=arguments.chunk,
            start_time=study.parts.run.start,
            progress=progress,
        )
    except KeyboardInterrupt:
        if not (folder / STORE).exists():
            raise
        dataset, code = open_sweep(folder / STORE), INTERRUPTED
    summary = _summary(dataset, code)
    folder.write_summary("sweep", study, summary, start)
    write_sweep_report(folder, dataset.load())
    if code == INTERRUPTED:
        pending = summary["lanes pending"]
        say(f"interrupted; {pending} lanes are pending: run the same command to continue")
    elif not summary["lanes successful"]:
        say(f"error: no lane ran to its end; their result codes are in {folder.path}")
        code = FAILED
    return CommandResult(code, _line(dataset, summary))


def sweep_arguments(study: Study, part: SweepPart) -> SweepArguments:
    """Return the arguments of `clearjoint.sweep` for a study.

    **Arguments:** `study`: the study; `part`: its section [sweep].

    **Raises:** `ValueError` without axes, and for paths and outputs that the scene does not have.
    The message names the place in the study's file.
    """
    location = study.location.at("sweep")
    axes = {}
    for name, axis in part.axes.items():
        axis_location = location.at("axes", name)
        # The path may select a number of the scene or of the initial state.
        found = study.find(axis.path, axis_location.at("path"))
        new_axis = Axis.initial if found.in_state else Axis
        axes[name] = new_axis(found.path, _values(axis, found.number, axis_location))
    if not axes:
        location.at("axes").refuse({}, "at least one axis", "add [sweep.axes.<name>]")
    # Each output is checked alone, so that an error names its place in the file, and then all are
    # checked together. The ledger counts as kept, because `sweep` adds it for outputs that need it.
    for name, output in part.outputs.items():
        check_output(name, output, study.scene, location.at("outputs", name))
    with location.at("outputs").in_errors():
        check_outputs(part.outputs, study.scene, ledger=True)
    sizes = [axis.values.size for axis in axes.values()]
    # Zipped axes have equal numbers of values, one for each lane; others form a grid of lanes.
    lanes = sizes[0] if part.zipped else int(np.prod(sizes))
    lanes_per_piece = -(-lanes // PIECES)  # rounded up
    chunk = part.chunk or min(max(lanes_per_piece, 1), LONGEST)
    return SweepArguments(axes, part.outputs, Saving(sections=study.sections()), chunk)


def check_output(name: str, output: object, scene: Scene, location: FileLocation) -> None:
    """Check that the scene has the elements that a reduction names; quantities are not checked.

    **Raises:** `ValueError` with the location in the file.
    """
    if isinstance(output, AbstractQuantity):
        return
    with location.in_errors():
        check_outputs({name: output}, scene, ledger=True)  # pyright: ignore


def _values(part: AxisPart, number: Reading, location: FileLocation) -> np.ndarray:
    if part.values is not None:
        values = [number(v, location.at("values", k)) for k, v in enumerate(part.values)]
        return np.array(values)
    start, stop = number(part.start, location.at("start")), number(part.stop, location.at("stop"))
    if part.spacing == "linear":
        return np.linspace(start, stop, part.count)
    if min(start, stop) <= 0.0:
        location.at("spacing").refuse((start, stop), "positive ends", 'or write spacing = "linear"')
    return np.geomspace(start, stop, part.count)


def _summary(dataset: "xr.Dataset", code: int) -> Summary:
    codes = dataset["result"].values
    numbers = {name: int((codes == number).sum()) for name, number in result_numbers().items()}
    failed = {f"lanes {name}": n for name, n in numbers.items() if n and name != "successful"}
    axes = [str(name) for name in dataset["result"].coords]
    values = {f"axis {name}": int(dataset[name].size) for name in axes if name in dataset.coords}
    return {
        "ended": "interrupted" if code == INTERRUPTED else "all lanes are done",
        "lanes": int(codes.size),
        "lanes successful": numbers["successful"],
        "lanes pending": int((codes < 0).sum()),
        **failed,
        **values,
    }


def _line(dataset: "xr.Dataset", summary: Summary) -> str:
    """Return the result of a sweep as one line of text."""
    failed = (
        int(summary["lanes"]) - int(summary["lanes successful"]) - int(summary["lanes pending"])
    )
    parts = [f"{summary['lanes']} lanes, {failed} failed, {summary['lanes pending']} pending"]
    parts.append(f"{int(dataset['accepted'].clip(min=0).sum())} steps")
    forces = [
        float(np.nanmax(output.values))
        for output in dataset.data_vars.values()
        if output.attrs.get("units") == "N" and np.isfinite(output.values).any()
    ]
    if forces:
        parts.append(f"largest force {max(forces):.4g} N")
    return ", ".join(parts)
