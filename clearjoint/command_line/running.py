"""`clearjoint run`: simulate a scene and write the results to a folder."""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import equinox as eqx
import numpy as np

from ..export.labelled import Labelled, labelled_dataset
from ..fields.checks import require, require_positive
from ..math.vectors import Scalar
from ..model.scene import Scene
from ..quantities.base import AbstractQuantity
from ..quantities.instant import Instant
from ..result_codes import RESULTS
from ..simulation.reductions.base import AbstractReduction
from ..simulation.reductions.quantities import Peak
from ..simulation.results.observation import Observation
from ..simulation.results.observe import observe
from ..simulation.results.quantity_values import values_along
from ..simulation.results.solution import Solution
from ..simulation.results.state_tables import contact_label
from ..simulation.run.interruptions import RunInterrupted
from ..simulation.run.saving import Saving
from ..simulation.run.simulate import simulate
from ..simulation.step.dense_output import require_dense
from ..simulation.step.method import Scheme
from ..simulation.step.settings import Settings
from .endings import FAILED, INTERRUPTED, WELL, CommandResult, say
from .folders import IMPACTS, MOTION, NUMBERS, OBSERVED, OUTPUTS, REACHED, SECTION, Folder, Summary
from .reports import write_run_report
from .study import Study
from .study_parts import RunPart

if TYPE_CHECKING:
    import xarray as xr

FRAMES = 1000
"""Default number of equal intervals between the saved states of a run."""
SHARP = "N", "N m", "m/s^2", "rad/s^2"
"""Units of quantities that change during an impact faster than states are saved."""
LARGEST, SMALLEST = " largest", " smallest"
"""Suffixes by which the reductions that find an output's extremes are named after the output."""
MISSED = 0.02
"""A note is printed if the samples of an output miss an extreme by more than this fraction of the
output's range."""


class Negative(AbstractQuantity):
    """The negative of a quantity: its peak is the negative of the smallest value."""

    quantity: AbstractQuantity = eqx.field(static=True)

    def __call__(self, now: Instant) -> Scalar:
        """Return the negative value."""
        return -self.quantity(now)

    def check(self, scene: Scene) -> None:
        """Check that the scene has the elements of the quantity."""
        self.quantity.check(scene)


def run(study: Study, out: Path, progress: bool) -> CommandResult:
    """Run a study's scene, and write tables, figures and a page to the folder `out`.

    **Returns:** the exit code, and the result in a line.
    """
    start, part = time.perf_counter(), study.parts.run
    reductions = reductions_of(part, study.settings(part, "run"))
    code, solution = _solution(study, part, reductions, progress)
    folder = Folder.made(out)
    largest = (0.0, "")
    if solution.saved is not None and len(solution.saved):
        largest = write_results(study, solution, reductions, folder)
    folder.write_scene(study.scene, solution.final, REACHED)
    folder.write_summary("run", study, _summary(study, solution, code, largest), start)
    write_run_report(folder)
    reached = f"t = {float(solution.time):.6g} s"
    if code == FAILED:
        say(f"error: the run ended at {reached}: {RESULTS[solution.result]}")
    if code == INTERRUPTED:
        say(f"interrupted at {reached}")
    if code != WELL:
        say(f"the results so far are in {folder.path}; {REACHED} has the state to continue from")
    force = f", largest force {largest[0]:.4g} N ({largest[1]})" if largest[1] else ""
    count = "" if solution.impacts is None else f", {len(solution.impacts)} impacts"
    return CommandResult(code, f"{int(solution.accepted)} steps to {reached}{count}{force}")


def reductions_of(part: RunPart, settings: Settings) -> dict[str, AbstractReduction]:
    """Return the reductions of a run by name: those among its outputs, and two for each output
    that is a quantity with a unit of `SHARP`, which find its largest and smallest value."""
    chosen: dict[str, AbstractReduction] = {}
    for name, output in part.outputs.items():
        if isinstance(output, AbstractReduction):
            chosen[name] = output
        elif output.unit in SHARP:
            chosen[name + LARGEST] = Peak(output, output.unit)
            chosen[name + SMALLEST] = Peak(Negative(output), output.unit)
    try:
        if chosen:
            require_dense(Scheme.of(settings, redundant=False).method.solver)
    except ValueError:
        requested = {name: one for name, one in chosen.items() if name in part.outputs}
        if len(requested) < len(chosen):
            say(
                "warning: the solver has no dense output: extremes of outputs between saved states "
                "are unknown; choose an explicit solver, or save more often"
            )
        return requested
    return chosen


def _solution(
    study: Study, part: RunPart, reductions: Mapping[str, AbstractReduction], progress: bool
) -> tuple[int, Solution]:
    end = study.end()
    contacts = bool(study.scene.contact_joints())
    times, sections = saved_times(part, end), study.sections()
    save = Saving(times, impacts=contacts, sections=sections, outputs=reductions)
    settings = study.ledger_for(study.settings(part, "run"), part.outputs)
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
    """Return the times (N,), s, at which a run's states are saved.

    **Raises:** `ValueError` for a `save_every` that is not positive or exceeds the duration.
    """
    every = part.save_every
    if every is None:
        return np.linspace(part.start, end, FRAMES + 1)
    require_positive("save_every", every, "give it in s")
    duration = end - part.start
    shorter = f"at most the duration, {duration:g} s"
    require(every <= duration, "save_every", every, shorter, "save more often")
    count = int(np.floor(duration / every * (1.0 + 1e-12)))
    return np.minimum(part.start + every * np.arange(count + 1), end)


def write_results(
    study: Study,
    solution: Solution,
    reductions: Mapping[str, AbstractReduction],
    folder: Folder,
) -> tuple[float, str]:
    """Write the tables of a run: motion, observation, impacts, sections and outputs.

    **Returns:** the largest normal force of a contact, N, and the contact.
    """
    folder.write_scene(study.scene, study.state)
    folder.write_table(MOTION, solution.to_xarray())
    observed = observe(study.scene, solution)
    folder.write_table(OBSERVED, observed.to_xarray())
    if solution.impacts is not None:
        folder.write_table(IMPACTS, solution.impacts.to_xarray())
    for name, crossings in solution.sections.items():
        folder.write_table(f"{SECTION}{name}", crossings.to_xarray())
    if any(isinstance(output, AbstractQuantity) for output in study.parts.run.outputs.values()):
        folder.write_table(OUTPUTS, _outputs(study, solution))
    if reductions:
        _write_numbers(solution, reductions, folder)
    return _largest_force(solution, observed)


def _outputs(study: Study, solution: Solution) -> "xr.Dataset":
    """Return the outputs that are quantities at the saved states; known extremes are attributes."""
    saved, rows = solution.saved, ("time",)
    assert saved is not None
    variables = {}
    for name, quantity in study.parts.run.outputs.items():
        if not isinstance(quantity, AbstractQuantity):
            continue
        values, attributes = values_along(study.scene, solution, quantity, saved), {}
        if name + LARGEST in solution.outputs:
            attributes = _extremes(name, solution)
            _note_missed_extremes(name, values, attributes, quantity.unit)
        title = type(quantity).__name__
        variables[name] = Labelled(rows, values, quantity.unit, title, attributes)
    times = {"time": Labelled(rows, saved.times, "s", "time")}
    return labelled_dataset("outputs of a run", variables, times)


def _extremes(name: str, solution: Solution) -> dict[str, float]:
    """Return the largest and the smallest value of an output and their times, s, under the keys
    "largest", "largest_time", "smallest" and "smallest_time"."""
    outputs = solution.outputs
    return {
        "largest": outputs[name + LARGEST],
        "largest_time": outputs[f"{name}{LARGEST}_time"],
        "smallest": -outputs[name + SMALLEST],
        "smallest_time": outputs[f"{name}{SMALLEST}_time"],
    }


def _note_missed_extremes(
    name: str, values: np.ndarray, extremes: Mapping[str, float], unit: str | None
) -> None:
    """Print a note if the saved samples of an output miss its extremes."""
    largest, smallest = extremes["largest"], extremes["smallest"]
    missed = max(largest - values.max(), values.min() - smallest)
    if missed > MISSED * (largest - smallest):
        say(
            f"note: the saved samples of {name} are between {values.min():.4g} and "
            f"{values.max():.4g} {unit}, the run between {smallest:.4g} and {largest:.4g} {unit}: "
            f"{NUMBERS} has these extremes; a smaller save_every gives more samples"
        )


def _write_numbers(
    solution: Solution, reductions: Mapping[str, AbstractReduction], folder: Folder
) -> None:
    """Write the outputs that are one number of the run, with their units."""
    import pandas as pd

    rows = []
    for name, reduction in reductions.items():
        sign = -1.0 if isinstance(getattr(reduction, "quantity", None), Negative) else 1.0
        for part, unit in reduction.units().items():
            output = f"{name}_{part}" if part else name
            value = solution.outputs[output]
            rows.append((output, value if part else sign * value, unit))
    frame = pd.DataFrame(rows, columns=["output", "value", "unit"])
    frame.to_csv(folder / NUMBERS, index=False)


def _largest_force(solution: Solution, observed: Observation) -> tuple[float, str]:
    """Return the largest normal force, N, of all finished impacts and saved states, and the label
    of its contact; zero and an empty label without contacts."""
    forces = [
        (float(values.normal_force.max()), contact_label(joint, contact))
        for joint, family in observed.contacts.items()
        for contact, values in family.items()
    ]
    if solution.impacts is not None and len(solution.impacts):
        hardest = int(np.argmax(solution.impacts.peak_force))
        names = solution.impacts.joint[hardest], solution.impacts.contact[hardest]
        forces.append((float(solution.impacts.peak_force[hardest]), contact_label(*names)))
    return max(forces, default=(0.0, ""))


def _summary(study: Study, solution: Solution, code: int, largest: tuple[float, str]) -> Summary:
    ending = "interrupted" if code == INTERRUPTED else RESULTS[solution.result]
    impacts = {} if solution.impacts is None else {"impacts": len(solution.impacts)}
    if largest[1]:
        impacts |= {"largest_force_N": largest[0], "largest_force_of": largest[1]}
    return {
        "ended": ending,
        "start_time_s": study.parts.run.start,
        "time_reached_s": float(solution.time),
        "steps_accepted": int(solution.accepted),
        "steps_tried": int(solution.attempts),
        **impacts,
        **dict(solution.settings),
    }
