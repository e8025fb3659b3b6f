"""`clearjoint sweep`: a scene for many values, in a store that goes on where it was stopped."""

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
from .folders import STORE, Folder
from .reports import write_sweep_report
from .study import Study
from .study_parts import AxisPart, SweepPart

if TYPE_CHECKING:
    import xarray as xr

Reading = Callable[[object, FileLocation], float]
"""What reads a number at a place."""
PIECES = 16
"""Chunks of a store, unless told how long they are: what is lost at most when it is stopped."""
LONGEST = 256


@dataclass(frozen=True)
class SweepArguments:
    """What a study's sweep takes: `axes`, `outputs`, and lanes in a chunk."""

    axes: dict[str, Axis]
    outputs: Mapping[str, Output]
    save: Saving
    chunk: int


def sweep(study: Study, out: Path, progress: bool) -> CommandResult:
    """Run a study's sweep into the store in a folder."""
    part = study.parts.sweep
    if part is None:
        study.place.at("sweep").refuse(None, "a section [sweep]", "add [sweep.axes.<name>]")
    arguments, begun = sweep_arguments(study, part), time.perf_counter()
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
    summary = _summary(study, dataset, code, time.perf_counter() - begun)
    folder.write_summary(summary)
    write_sweep_report(folder, dataset.load())
    code = _told(folder, summary, code)
    return CommandResult(code, _line(dataset, summary))


def sweep_arguments(study: Study, part: SweepPart) -> SweepArguments:
    """Axes, outputs and chunk of a study's sweep.

    **Raises:** `ValueError` for places and outputs that the scene does not have.
    """
    place = study.place.at("sweep")
    axes = {name: _axis(study, axis, place.at("axes").at(name)) for name, axis in part.axes.items()}
    if not axes:
        place.at("axes").refuse({}, "one axis at least", "add [sweep.axes.<name>]")
    for name, output in part.outputs.items():
        check_output(name, output, study.scene, place.at("outputs").at(name))
    try:
        check_outputs(part.outputs, study.scene, ledger=True)
    except ValueError as error:
        raise ValueError(f"{place.at('outputs')}: {error}") from error
    sizes = [axis.values.size for axis in axes.values()]
    lanes = sizes[0] if part.zipped else int(np.prod(sizes))
    chunk = part.chunk or min(max(-(-lanes // PIECES), 1), LONGEST)
    return SweepArguments(axes, part.outputs, Saving(sections=study.sections()), chunk)


def check_output(name: str, output: object, scene: Scene, where: FileLocation) -> None:
    """Check that the scene has what an output names, which may be a quantity too.

    **Raises:** `ValueError` with the place in the file.
    """
    if isinstance(output, AbstractQuantity):
        return
    try:
        check_outputs({name: output}, scene, ledger=True)  # pyright: ignore
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error


def _axis(study: Study, part: AxisPart, where: FileLocation) -> Axis:
    found = study.find(part.place, where.at("place"))
    make = Axis.initial if found.in_state else Axis
    return make(found.place, _values(part, found.number, where))


def _values(part: AxisPart, number: Reading, where: FileLocation) -> np.ndarray:
    if part.values is not None:
        values = [number(value, where.at("values").at(k)) for k, value in enumerate(part.values)]
        return np.array(values)
    start, stop = number(part.start, where.at("start")), number(part.stop, where.at("stop"))
    if part.spacing == "linear":
        return np.linspace(start, stop, part.count)
    if min(start, stop) <= 0.0:
        where.at("spacing").refuse((start, stop), "positive ends", 'or write spacing = "linear"')
    return np.geomspace(start, stop, part.count)


def _summary(
    study: Study, dataset: "xr.Dataset", code: int, seconds: float
) -> dict[str, str | int | float]:
    codes = dataset["result"].values
    numbers = {name: int((codes == number).sum()) for name, number in result_numbers().items()}
    failed = {f"lanes {name}": n for name, n in numbers.items() if n and name != "successful"}
    axes = [str(name) for name in dataset["result"].coords]
    values = {f"axis {name}": int(dataset[name].size) for name in axes if name in dataset.coords}
    return {
        "kind": "sweep",
        "title": study.title,
        "file": str(study.path),
        "ended": "interrupted" if code == INTERRUPTED else "all lanes are done",
        "lanes": int(codes.size),
        "lanes successful": numbers["successful"],
        "lanes pending": int((codes < 0).sum()),
        **failed,
        **values,
        "seconds": round(seconds, 2),
    }


def _line(dataset: "xr.Dataset", summary: Mapping[str, str | int | float]) -> str:
    """What came of a sweep, in a line."""
    failed = (
        int(summary["lanes"]) - int(summary["lanes successful"]) - int(summary["lanes pending"])
    )
    parts = [f"{summary['lanes']} lanes, {failed} failed, {summary['lanes pending']} pending"]
    parts.append(f"{int(dataset['accepted'].clip(min=0).sum())} steps")
    forces = [
        float(np.nanmax(one.values))
        for one in dataset.data_vars.values()
        if one.attrs.get("units") == "N" and np.isfinite(one.values).any()
    ]
    if forces:
        parts.append(f"largest force {max(forces):.4g} N")
    return ", ".join(parts)


def _told(folder: Folder, summary: Mapping[str, str | int | float], code: int) -> int:
    """The exit code: a sweep has failed if none of its lanes ran to its end."""
    if code == INTERRUPTED:
        say(f"interrupted; {summary['lanes pending']} lanes are pending: the same command goes on")
        return code
    if not summary["lanes successful"]:
        say(f"error: no lane ran to its end; their result codes are in {folder.path}")
        return FAILED
    return WELL
