"""`clearjoint run`: one run of a scene, and its results in a folder."""

import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..datasets.labelled import Labelled, labelled_dataset
from ..fields.checks import require, require_positive
from ..results import RESULTS
from ..simulation.interruptions import RunInterrupted
from ..simulation.observe import observe
from ..simulation.quantity_values import values_along
from ..simulation.saving import Saving
from ..simulation.simulate import simulate
from ..simulation.solution import Solution
from .endings import FAILED, INTERRUPTED, WELL, say
from .folders import IMPACTS, MOTION, OBSERVED, OUTPUTS, REACHED, SECTION, Folder
from .reports import write_run_report
from .study import Study
from .study_parts import RunPart

if TYPE_CHECKING:
    import xarray as xr

FRAMES = 1000
"""States that are saved of a run, unless told how often."""


def run(study: Study, out: Path, progress: bool) -> int:
    """Run a study's scene and write what was computed; the exit code."""
    begun, part = time.perf_counter(), study.parts.run
    code, solution = _solution(study, part, progress)
    folder = Folder.made(out)
    if solution.saved is not None and len(solution.saved):
        write_results(study, solution, folder)
    folder.write_scene(study.scene, solution.final, REACHED)
    folder.write_summary(_summary(study, solution, code, time.perf_counter() - begun))
    write_run_report(folder)
    _tell(solution, folder, code)
    return code


def _solution(study: Study, part: RunPart, progress: bool) -> tuple[int, Solution]:
    end = study.end()
    contacts = bool(study.scene.contact_joints())
    save = Saving(saved_times(part, end), impacts=contacts, sections=study.sections())
    settings = study.settings(part, "run")
    try:
        solution = simulate(
            study.scene,
            study.state,
            end,
            settings,
            save,
            start_time=part.start,
            throw=False,
            progress=progress,
        )
    except RunInterrupted as stopped:
        assert isinstance(stopped.solution, Solution)
        return INTERRUPTED, stopped.solution
    return (WELL if solution.result == RESULTS.successful else FAILED), solution


def saved_times(part: RunPart, end: float) -> np.ndarray:
    """The times at which a run's states are saved, s."""
    every = part.save_every
    if every is None:
        return np.linspace(part.start, end, FRAMES + 1)
    require_positive("save_every", every, "give it in s")
    duration = end - part.start
    shorter = f"at most the duration, {duration:g} s"
    require(every <= duration, "save_every", every, shorter, "save more often")
    count = int(np.floor(duration / every * (1.0 + 1e-12)))
    return np.minimum(part.start + every * np.arange(count + 1), end)


def write_results(study: Study, solution: Solution, folder: Folder) -> None:
    """Write the tables of a run: motion, observation, impacts, sections and outputs."""
    folder.write_scene(study.scene, study.state)
    folder.write_table(MOTION, solution.to_xarray())
    folder.write_table(OBSERVED, observe(study.scene, solution).to_xarray())
    if solution.impacts is not None:
        folder.write_table(IMPACTS, solution.impacts.to_xarray())
    for name, crossings in solution.sections.items():
        folder.write_table(f"{SECTION}{name}", crossings.to_xarray())
    if study.parts.run.outputs:
        folder.write_table(OUTPUTS, _outputs(study, solution))


def _outputs(study: Study, solution: Solution) -> "xr.Dataset":
    """The quantities that the study asks for, along the saved states."""
    saved, rows = solution.saved, ("time",)
    assert saved is not None
    variables = {
        name: Labelled(
            rows, values_along(study.scene, solution, one, saved), one.unit, type(one).__name__
        )
        for name, one in study.parts.run.outputs.items()
    }
    times = {"time": Labelled(rows, saved.times, "s", "time")}
    return labelled_dataset("outputs of a run", variables, times)


def _summary(
    study: Study, solution: Solution, code: int, seconds: float
) -> dict[str, str | int | float]:
    ending = "interrupted" if code == INTERRUPTED else RESULTS[solution.result]
    impacts = {} if solution.impacts is None else {"impacts": len(solution.impacts)}
    return {
        "kind": "run",
        "title": study.title,
        "file": str(study.path),
        "ended": ending,
        "start_time_s": study.parts.run.start,
        "time_reached_s": float(solution.time),
        "steps_accepted": int(solution.accepted),
        "steps_tried": int(solution.attempts),
        **impacts,
        **dict(solution.settings),
        "seconds": round(seconds, 2),
    }


def _tell(solution: Solution, folder: Folder, code: int) -> None:
    reached = f"t = {float(solution.time):.6g} s"
    if code == FAILED:
        say(f"error: the run ended at {reached}: {RESULTS[solution.result]}")
    if code == INTERRUPTED:
        say(f"interrupted at {reached}")
    if code != WELL:
        say(f"what was computed is in {folder.path}; {REACHED} can be continued from")
