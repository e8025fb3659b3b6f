"""`clearjoint sweep`: run a scene for many values of its numbers."""

from pathlib import Path

import numpy as np
import xarray as xr

from .._fields.checks import require_array_names
from .._result_codes import result_numbers
from .._scene_files.documents import FileLocation
from .._sweeps.axes import Axis
from .._sweeps.store.store import open_sweep
from .._sweeps.sweep import sweep as run_sweep
from .endings import FAILED, INTERRUPTED, WELL, CommandResult, has_error_stream, say
from .folders import STORE, Summary, remove_old, write_scene, write_summary
from .study import AxisPart, FoundPath, Study, SweepPart, find_path


def sweep(study: Study, folder: Path) -> CommandResult:
    """Run a study's section [sweep], and write its store. Lanes that the folder's store has already
    are not run again. The sweep counts as failed only if no lane ran to its end, since it often
    includes values with which a mechanism can't run. After Ctrl-C, results so far are written."""
    part = study.parts.sweep
    if part is None:
        study.location.at("sweep").refuse(None, "a section [sweep]", "add [sweep.axes.<name>]")
    axes = sweep_axes(study, part)
    lanes = int(np.prod(shape_of_lanes(axes, part)))
    # A chunk is written to the store when all its lanes have ended. With many chunks, long sweeps
    # show results early, and a process that is killed loses few lanes.
    chunk = int(np.clip(np.ceil(lanes / 16), 1, 256)) if part.chunk is None else part.chunk
    end, settings = study.end(part.end), study.settings("sweep")
    requested = study.outputs_of_sweep(part)
    folder.mkdir(parents=True, exist_ok=True)
    write_scene(folder, study.scene, study.state)
    code = WELL
    try:
        dataset = run_sweep(
            study.scene,
            study.state,
            end,
            axes,
            requested.outputs,
            settings,
            requested.save,
            zipped=part.zipped,
            path=folder / STORE,
            chunk=chunk,
            start_time=study.parts.run.start,
            progress=has_error_stream(),
        )
    except KeyboardInterrupt:
        if not (folder / STORE).exists():  # nothing is finished that could be reported
            raise
        dataset, code = open_sweep(folder / STORE), INTERRUPTED
    summary, line = _summary(dataset, code)
    remove_old(folder)  # figures of an earlier result
    write_summary(folder, "sweep", study, summary)
    if code == INTERRUPTED:
        pending = summary["lanes pending"]
        say(f"interrupted; {pending} lanes are pending: run the same command to continue")
    elif not summary["lanes successful"]:
        say(f"error: no lane ran to its end; their result codes are in {folder}")
        code = FAILED
    return CommandResult(code, line, dataset=dataset)


def sweep_axes(study: Study, part: SweepPart) -> dict[str, Axis]:
    """Return the axes of a study's section [sweep] by name, and check the section's outputs."""
    location = study.location.at("sweep")
    axes = {}
    for name, axis in part.axes.items():
        axis_location = location.at("axes", name)
        target = find_path(axis.path, study.scene, study.state, axis_location.at("path"))
        make = Axis.initial if target.in_state else Axis
        axes[name] = make(target.path, _values(axis, target, axis_location))
    if not axes:
        location.at("axes").refuse({}, "at least one axis", "add [sweep.axes.<name>]")
    sizes = [axis.values.size for axis in axes.values()]
    if part.zipped and len(set(sizes)) > 1:
        expected = "axes of equal length, since they are zipped"
        remedy = "give all axes as many values, or leave `zipped` out"
        location.at("axes").refuse(sizes, expected, remedy)
    # Each output is checked alone, so that an error names its place in the file.
    study.check_elements(part.outputs, "sweep", "outputs")
    with location.at("outputs").in_errors():
        require_array_names("outputs", part.outputs, "rename them")
    return axes


def shape_of_lanes(axes: dict[str, Axis], part: SweepPart) -> list[int]:
    """Return the number of values of each axis; only their common number if axes are zipped."""
    sizes = [axis.values.size for axis in axes.values()]
    return sizes[:1] if part.zipped else sizes


def _values(part: AxisPart, target: FoundPath, location: FileLocation) -> np.ndarray:
    if part.values is not None:
        values = [target.number(v, location.at("values", k)) for k, v in enumerate(part.values)]
        return np.array(values)
    start = target.number(part.start, location.at("start"))
    stop = target.number(part.stop, location.at("stop"))
    if part.spacing == "linear":
        return np.linspace(start, stop, part.count)
    if min(start, stop) <= 0.0:
        location.at("spacing").refuse((start, stop), "positive ends", 'or write spacing = "linear"')
    return np.geomspace(start, stop, part.count)


def _summary(dataset: xr.Dataset, exit_code: int) -> tuple[Summary, str]:
    codes = dataset["result"].values
    counts = {name: int((codes == number).sum()) for name, number in result_numbers().items()}
    done = counts.pop("successful")
    pending = int((codes < 0).sum())  # lanes that have not run have the code -1
    summary = {
        "ended": "interrupted" if exit_code == INTERRUPTED else "all lanes are done",
        "lanes": codes.size,
        "lanes successful": done,
        "lanes pending": pending,
        **{f"lanes {name}": number for name, number in counts.items() if number},
        **{f"axis {name}": axis.size for name, axis in dataset["result"].coords.items()},
    }
    failed = codes.size - done - pending
    steps = int(dataset["accepted"].clip(min=0).sum())  # lanes that have not run have -1
    in_newtons = [v.values for v in dataset.data_vars.values() if v.attrs.get("units") == "N"]
    forces = [float(np.nanmax(values)) for values in in_newtons if np.isfinite(values).any()]
    force = f", largest force {max(forces):.4g} N" if forces else ""
    return summary, f"{codes.size} lanes, {failed} failed, {pending} pending, {steps} steps{force}"
