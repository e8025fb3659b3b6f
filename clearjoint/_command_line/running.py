"""`clearjoint run`: simulate a scene and write the results to a folder."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import pandas as pd
import xarray as xr
from typing_extensions import override

from .._dynamics.journals import depths
from .._export.datasets import Labelled, labelled_dataset, write_netcdf
from .._fields.cautions import quiet
from .._math.vectors import Scalar
from .._model.scene import Scene
from .._result_codes import RESULTS
from .._simulation.reductions.base import AbstractReduction, result_name
from .._simulation.reductions.quantities import Peak
from .._simulation.results.impact_table import Impacts
from .._simulation.results.observe import Observation, observe, values_along
from .._simulation.results.solution import Crossings, Solution, by_contact, contact_label
from .._simulation.run.outputs import Table
from .._simulation.run.rejections import Rejections
from .._simulation.run.saving import Saving
from .._simulation.run.simulate import simulate
from .._simulation.run.terminal import RunInterrupted
from .._simulation.step.dense_output import require_dense
from .._simulation.step.method import Scheme
from .._simulation.step.settings import Settings
from ..quantities.base import AbstractQuantity, Instant
from . import folders
from .endings import FAILED, INTERRUPTED, WELL, CommandResult, has_error_stream, say
from .study import RunPart, Study

DRAWN = 10_000
"""Least number of intervals in the curves of a run's figures."""
SHARP = "N", "N m", "m/s^2", "rad/s^2"
"""Units of forces and accelerations: in an impact, they change faster than states are saved."""
LARGEST, SMALLEST = " largest", " smallest"
"""Suffixes of an output's name, in the names of the reductions that find its extremes."""


PREFIXES = {Crossings: folders.SECTION, Impacts: folders.TABLE, Rejections: folders.REJECTED}


class Negative(AbstractQuantity):
    """The negative of a quantity, whose `Peak` is the negative of the quantity's minimum."""

    quantity: AbstractQuantity = eqx.field(static=True)

    @override
    def __call__(self, now: Instant) -> Scalar:
        return -self.quantity(now)

    @override
    def check(self, scene: Scene) -> None:
        self.quantity.check(scene)


def run(study: Study, folder: Path) -> CommandResult:
    """Run a study's scene and write the tables of its results, also after a failure or Ctrl-C."""
    settings = study.settings("run")
    extremes = extremes_of(study.parts.run, settings)
    times = study.parts.run.saved_times(study.end())
    # For the figures, each interval between saved states is divided: rounded up, into so many parts
    # that there are at least `DRAWN`.
    parts = -(-DRAWN // (len(times) - 1))
    # Before the run: where no folder can be made, the results of a long run would be lost.
    folder.mkdir(parents=True, exist_ok=True)
    solution, code = _simulated(study, settings, extremes, divided(times, parts))
    drawn = solution.saved
    if drawn is not None:
        # Every `parts`-th time is one at which the study saves a state.
        saved = jax.tree.map(lambda rows: rows[::parts], drawn)
        solution = replace(solution, saved=saved, saved_count=len(saved))
    tables = [folders.DRAWN, folders.MOTION, folders.OBSERVED, folders.IMPACTS, folders.OUTPUTS]
    tables += [f"{prefix}*" for prefix in PREFIXES.values()]
    folders.remove_old(folder, tables, files=[folders.NUMBERS, folders.PDF, folders.VIEW])
    folders.write_scene(folder, study.scene, study.state)
    # All tables are left out if no state was saved, since most of them describe the saved states.
    force, contact = 0.0, ""
    if drawn is not None and len(drawn):
        force, contact = write_results(study, solution, extremes, folder)
        write_netcdf(drawn.to_xarray(), folder / f"{folders.DRAWN}.nc")
    folders.write_scene(folder, study.scene, solution.final, folders.REACHED)
    summary = _summary(study, solution, code == INTERRUPTED)
    if force:
        summary |= {"largest_contact_force_N": force, "largest_contact_force_of": contact}
    folders.write_summary(folder, "run", study, {**summary, **dict(solution.settings)})
    reached = f"t = {float(solution.time):.6g} s"
    if code != WELL:
        failure = f"error: the run ended at {reached}: {RESULTS[solution.result]}"
        say(failure if code == FAILED else f"interrupted at {reached}")
        say(
            f"the results so far are in {folder}; to continue, name {folders.REACHED} as the scene "
            f"of the study, and pass --set run.start={float(solution.time)!r}"
        )
    count = "" if solution.impacts is None else f", {len(solution.impacts)} finished impacts"
    largest = f", largest force of a contact {force:.4g} N ({contact})" if force else ""
    return CommandResult(code, f"{int(solution.accepted)} steps to {reached}{count}{largest}")


def divided(times: np.ndarray, parts: int) -> np.ndarray:
    """Return times, s, that divide each interval between the given `times` into `parts` equal
    intervals; every `parts`-th of the returned times is exactly one of the given times."""
    fractions = np.arange(parts * (len(times) - 1) + 1) / parts
    return np.interp(fractions, np.arange(len(times)), times)


def _simulated(
    study: Study, settings: Settings, extremes: Mapping[str, AbstractReduction], times: np.ndarray
) -> tuple[Solution, int]:
    """Run a study's scene, saving states at `times`, (N,) s; return the solution, also of a run
    that failed or was interrupted, and the exit code."""
    part = study.parts.run
    # Quantities are computed after the run, so that they don't change a bit of its states.
    recorded = {n: o for n, o in part.outputs.items() if not isinstance(o, AbstractQuantity)}
    try:
        solution = simulate(
            study.scene,
            study.state,
            study.end(),
            settings,
            # Without contacts, there is no table of impacts.
            Saving(times, impacts=bool(study.scene.contact_joints())),
            outputs={**recorded, **extremes},
            start_time=part.start,
            throw=False,
            progress=has_error_stream(),
        )
    except RunInterrupted as stopped:
        assert isinstance(stopped.solution, Solution)
        return stopped.solution, INTERRUPTED
    return solution, WELL if solution.result == RESULTS.successful else FAILED


def _summary(study: Study, solution: Solution, interrupted: bool) -> dict[str, str | int | float]:
    summary: dict[str, str | int | float] = {
        "ended": "interrupted" if interrupted else RESULTS[solution.result],
        "start_time_s": study.parts.run.start,
        "time_reached_s": float(solution.time),
        "steps_accepted": int(solution.accepted),
        "steps_tried": int(solution.attempts),
    }
    if solution.impacts is not None:
        # Contacts that last are no finished impacts, but an `ImpactCount` counts their onsets.
        with quiet():
            ends = depths(study.scene, solution.final).values()
        touching = sum(int(depth > 0.0) for family in ends for depth in family.values())
        summary |= {"finished_impacts": len(solution.impacts), "contacts_at_the_end": touching}
    return summary


def extremes_of(part: RunPart, settings: Settings) -> dict[str, AbstractReduction]:
    """Return two reductions for each output with a unit in `SHARP`: its largest and smallest value,
    also between saved states; but none, after a warning, if the solver has no dense output."""
    extremes: dict[str, AbstractReduction] = {}
    for name, output in part.outputs.items():
        if isinstance(output, AbstractQuantity) and output.unit in SHARP:
            extremes[name + LARGEST] = Peak(output, output.unit)
            extremes[name + SMALLEST] = Peak(Negative(output), output.unit)
    if hidden := {"time", *extremes} & part.outputs.keys():
        raise ValueError(
            f"run.outputs: got {min(hidden)!r}, expected a name that neither the time nor an "
            "extreme of another output has: rename the output."
        )
    if extremes:
        # Only explicit Runge-Kutta methods have dense output. `redundant` does not affect the
        # solver, so any value serves here.
        try:
            require_dense(Scheme.of(settings, redundant=False).method.solver)
        except ValueError:
            extremes = {}
            say(
                "warning: the solver has no dense output: extremes of outputs between saved states "
                "are unknown; choose an explicit solver, or save more often"
            )
    return extremes


def write_results(
    study: Study, solution: Solution, extremes: Mapping[str, AbstractReduction], folder: Path
) -> tuple[float, str]:
    """Write the tables of a run, with `extremes`, the result of `extremes_of`. Return the largest
    force of a contact, N, and the contact's label."""
    # The peak of a `Negative` is the negative of the smallest value.
    smallest = {name: -solution.outputs[name] for name in extremes if name.endswith(SMALLEST)}
    solution = replace(solution, outputs={**solution.outputs, **smallest})
    observed = observe(study.scene, solution)
    formulation = {folders.FORMULATION: folders.formulation_text(solution.formulation)}
    motion = solution.to_xarray().assign_attrs(formulation)
    tables = {folders.MOTION: motion, folders.OBSERVED: observed.to_xarray()}
    if solution.impacts is not None:
        tables[folders.IMPACTS] = solution.impacts.to_xarray()
    for name, output in solution.outputs.items():
        if isinstance(output, Table):  # sections, impacts and rejected steps have a file each
            tables[f"{PREFIXES[type(output)]}{name}"] = output.to_xarray()
    for name, table in tables.items():
        folders.write_table(folder, name, table)
    outputs = study.parts.run.outputs
    # All quantities share a table along the saved states, and all reductions a table of numbers.
    quantities = {n: item for n, item in outputs.items() if isinstance(item, AbstractQuantity)}
    if quantities:
        folders.write_table(folder, folders.OUTPUTS, _outputs(quantities, study.scene, solution))
    reductions = {n: item for n, item in outputs.items() if isinstance(item, AbstractReduction)}
    if reductions := {**reductions, **extremes}:
        _write_numbers(solution, reductions, folder)
    return _largest_force(solution, observed)


def _outputs(
    quantities: Mapping[str, AbstractQuantity], scene: Scene, solution: Solution
) -> xr.Dataset:
    """Return quantities at the saved states. Those for which `extremes_of` has reductions have the
    extremes as attributes. Print a note if saved values miss one by over 2 % of the range."""
    saved, rows, numbers = solution.saved, ("time",), solution.outputs
    assert saved is not None
    variables = {}
    for name, quantity in quantities.items():
        values, extremes = values_along(scene, solution, quantity, saved), {}
        if name + LARGEST in numbers:
            largest, smallest = numbers[name + LARGEST], numbers[name + SMALLEST]
            extremes = {
                "largest": largest,
                "largest_time": numbers[f"{name}{LARGEST}_time"],
                "smallest": smallest,
                "smallest_time": numbers[f"{name}{SMALLEST}_time"],
            }
            low, high = values.min(), values.max()
            # The user should know if an extreme lies far outside the saved samples.
            if max(largest - high, low - smallest) > 0.02 * (largest - smallest):
                say(
                    f"note: the saved samples of {name} are between {low:.4g} and {high:.4g} "
                    f"{quantity.unit}, the run between {smallest:.4g} and {largest:.4g} "
                    f"{quantity.unit}: {folders.NUMBERS} has these extremes; a smaller save_every "
                    "gives more samples"
                )
        variables[name] = Labelled(rows, values, quantity.unit, type(quantity).__name__, extremes)
    times = {"time": Labelled(rows, saved.times, "s", "time")}
    return labelled_dataset("outputs of a run", variables, times)


def _write_numbers(
    solution: Solution, reductions: Mapping[str, AbstractReduction], folder: Path
) -> None:
    rows = []
    for name, reduction in reductions.items():
        for part, unit in reduction.units().items():
            output = result_name(name, part)
            rows.append((output, solution.outputs[output], unit))
    frame = pd.DataFrame(rows, columns=["output", "value", "unit"])
    frame.to_csv(folder / folders.NUMBERS, index=False)


def _largest_force(solution: Solution, observed: Observation) -> tuple[float, str]:
    # Both are needed: saved states miss the peaks of most impacts, and the table of impacts lacks
    # contacts that have not ended in the run.
    forces = [
        (float(contact.normal_force.max()), label)
        for label, contact in by_contact(observed.contacts).items()
    ]
    if (impacts := solution.impacts) is not None and len(impacts):
        k = int(np.argmax(impacts.peak_force))
        label = contact_label(impacts.joint[k], impacts.contact[k])
        forces.append((float(impacts.peak_force[k]), label))
    return max(forces, default=(0.0, ""))
