"""`clearjoint wear`: compute how joints wear over many cycles of a periodic motion."""

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from .._durability.wear import CycleRun, cycles_to_depth, final_state, open_wear, worn
from .._durability.wear import wear as compute_wear
from .._durability.wear_derivatives import PARTS, Part
from .endings import FAILED, INTERRUPTED, WELL, CommandResult, has_error_stream, say
from .folders import WEAR_STORE, Summary, remove_old, write_scene, write_summary
from .study import Study, WearPart

WORN_SCENE = "worn.toml"
"""Scene file with the worn profiles and the state after the last run."""


def wear(study: Study, folder: Path) -> CommandResult:
    """Compute a study's section [wear], and write its store and the worn scene. A computation that
    the folder's store has begun is continued. After Ctrl-C, results so far are written."""
    part = study.parts.wear
    if part is None:
        study.location.at("wear").refuse(None, "a section [wear]", "add [wear.rates.<joint>]")
    store, code = folder / WEAR_STORE, WELL
    try:
        with study.location.at("wear").in_errors():
            dataset = compute_wear(
                study.scene,
                study.state,
                settings=study.settings("wear"),
                start_time=part.start,
                path=store,
                progress=has_error_stream(),
                **_arguments(part),
            )
    except KeyboardInterrupt:
        if not store.exists():  # no stage is finished that could be reported
            raise
        dataset, code = open_wear(store), INTERRUPTED
    write_scene(folder, study.scene, study.state)
    write_scene(folder, worn(study.scene, dataset), final_state(dataset), WORN_SCENE)
    summary, line = _summary(dataset, part, code)
    remove_old(folder)  # figures of an earlier result
    write_summary(folder, "wear", study, summary)
    if code == INTERRUPTED:
        say("interrupted: run the same command to continue")
    elif dataset.attrs["failure"]:
        say(f"error: the computation ended early: {dataset.attrs['failure']}")
        code = FAILED
    table = stage_table(dataset).to_string(index=False, float_format="{:.4g}".format)
    return CommandResult(code, f"{table}\n{line}")


def check_wear_section(study: Study, part: WearPart) -> None:
    with study.location.at("wear").in_errors():
        arguments: dict[str, Any] = _arguments(part) | {"cycles": np.asarray(part.cycles)}
        CycleRun(**arguments).check(study.scene)  # raises an error for entries out of range


def _arguments(part: WearPart) -> dict[str, Any]:
    """Return the entries of the section [wear], `part`, that are arguments of `clearjoint.wear`."""
    others = ("start", "preset", "settings")
    return {name: entry for name, entry in vars(part).items() if name not in others}


def _summary(dataset: xr.Dataset, part: WearPart, code: int) -> tuple[Summary, str]:
    stages, cycles = dataset.sizes["stage"], float(dataset["cycles"][-1])
    ended = "interrupted" if code == INTERRUPTED else dataset.attrs["ending"]
    summary: dict[str, str | int | float] = {"ended": ended, "stages": stages, "cycles": cycles}
    texts = [f"{stages} stages, {cycles:.4g} cycles"]
    for joint, worn_part in worn_parts(dataset):
        name = f"{worn_part} of {joint}"
        deepest = float(dataset[f"{worn_part}_depth"].sel(joint=joint).isel(stage=-1).max())
        summary[f"{name}, depth [m]"] = deepest
        texts.append(f"{name} {1e6 * deepest:.4g} µm deep")
        if part.depth is not None:
            life = cycles_to_depth(dataset, part.depth, joint, worn_part)
            is_reached = np.isfinite(life)  # JSON has no infinite numbers
            summary[f"{name}, cycles to {part.depth:g} m"] = life if is_reached else "not reached"
            if is_reached:
                texts[-1] += f" ({1e6 * part.depth:g} µm after {life:.4g} cycles)"
    return summary, ", ".join(texts)


def worn_parts(dataset: xr.Dataset) -> list[tuple[str, Part]]:
    """Return the parts that have worn, as pairs of a joint's name and "bearing" or "journal"."""
    pairs = product(map(str, dataset["joint"].values), PARTS)
    return [(j, part) for j, part in pairs if (dataset[f"{part}_depth"].sel(joint=j) > 0.0).any()]


def stage_table(dataset: xr.Dataset) -> pd.DataFrame:
    """Return a table of a result of `clearjoint.wear` with a row for each stage: depths and volumes
    before it, and largest forces during its run, which are NaN if the last stage has no run."""
    columns = {"cycles": dataset["cycles"].values}
    for joint in dataset["joint"].values:
        columns[f"force in {joint} [N]"] = dataset["force"].sel(joint=joint).values
    for joint, part in worn_parts(dataset):
        depths = dataset[f"{part}_depth"].sel(joint=joint).transpose("stage", "angle").values
        columns[f"{part} of {joint}, largest [m]"] = depths.max(axis=1)
        columns[f"{part} of {joint}, mean [m]"] = depths.mean(axis=1)
        volumes = dataset[f"{part}_volume"].sel(joint=joint).values
        columns[f"{part} of {joint}, volume [m^3]"] = volumes
    return pd.DataFrame(columns)
