"""Sweeps: one scene with many values of its parameters."""

import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from os import PathLike
from typing import TYPE_CHECKING

import jax
import numpy as np

from ..dynamics.journals import HOLD_IT, slid_out
from ..fields.cautions import LeftBearingWarning, caution
from ..fields.checks import require, require_array_names
from ..math.vectors import structured
from ..model.bodies import BodyState, State
from ..model.scene import Scene
from ..results import result_numbers
from ..runtime import Device, busy_devices, program_kind
from ..simulation import presets
from ..simulation.batch.device_pool import Common, Task
from ..simulation.batch.lane import Plan, impact_log
from ..simulation.batch.reductions import AbstractReduction
from ..simulation.dense_output import require_dense
from ..simulation.impact_recorder import ImpactRecorder
from ..simulation.method import Scheme
from ..simulation.run_checks import check_numbers, check_precision
from ..simulation.saving import Saving, saving_or_nothing
from ..simulation.sections import Section
from ..simulation.settings import Settings, settings_or
from ..simulation.spans import checked_times
from .axes import Axis, Lanes, lanes_of, variable_leaves
from .executors import AbstractSubmitter, run_chunks
from .layout import RESULT, Coordinate, LaneArrays, Layout
from .outputs import AbstractSaved, ImpactTable, Output, check_outputs
from .progress import lane_progress
from .saved_states import outputs_beside
from .starts import checked_starts
from .store.identity import Identity, row_digests, run_digests
from .store.notes import describe, number_notes, structure_note, versions
from .store.program import RUN, programs
from .store.store import SweepMemory, SweepStore
from .variables import variables_of
from .work import Chunks, Work, joined

if TYPE_CHECKING:
    import xarray as xr

CHUNK = 256


def sweep(
    scene: Scene,
    state: State,
    end_time: float | Callable[[Scene], float],
    axes: Mapping[str, Axis],
    outputs: Mapping[str, Output] | None = None,
    settings: Settings | None = None,
    save: Saving | None = None,
    *,
    zipped: bool = False,
    path: str | PathLike | None = None,
    executor: AbstractSubmitter | None = None,
    devices: Sequence[Device] | None = None,
    chunk: int = CHUNK,
    start_time: float = 0.0,
    progress: bool = True,
) -> "xr.Dataset":
    """Simulate a scene for many values of its parameters.

    Lanes, one for each combination of values, are integrated together, each on its own time and
    step size; a lane's numbers are those of the single run, whatever runs beside it. A lane that
    fails keeps its result code and the time it reached, and the others are untouched.

    **Arguments:**

    - `scene`, `state`, `start_time`, `end_time` s: as in `simulate`. `end_time` may be a function
      of the lane's scene, say of a crank's speed.
    - `axes`: the values of each parameter by name; see `Axis`. Their outer product, or with
      `zipped` as many lanes as each has values, for lists and designs of experiments.
    - `outputs`: what is kept of each lane, by name: reductions (`Peak`, `ImpactCount`,
      `DissipatedEnergy`, `Statistics`, or a subclass of `AbstractReduction`), one `Saved`,
      `Section`, and `ImpactTable`: ``{"hits": cj.ImpactTable(20)}`` tables the first 20 impacts of
      every contact, the peak force of which is ``hits_peak_force``. The final state, result code,
      time reached, and steps are always kept.
    - `settings`: how to integrate; `clearjoint.presets.default` unless given.
    - `save`: what else to keep of each lane, as in `simulate`: the states at times, as
      ``saved_position``, ``saved_orientation``, ``saved_velocity`` and ``saved_spin`` along
      ``saved_time``, and sections, which are outputs of the same names. Every step of a lane can't
      be kept, and impacts only in an `ImpactTable`.
    - `path`: a Zarr store, which is written chunk by chunk. A sweep that finds its own store there
      computes only what is missing or damaged, so that values of axes, axes and outputs can be
      added. It is known by its lanes' numbers and by what JAX traces of their runs, not by source
      texts or names. `open_sweep(path)` reads it, finished or not.
    - `executor`: a `concurrent.futures.Executor` (of processes that are spawned, not forked; a
      script that makes one stands behind ``if __name__ == "__main__":``) or a
      `dask.distributed.Client` (of clusters: ``pip install 'clearjoint[cluster]'``), to which
      chunks are handed; unless given, all `devices` of this process share the lanes. With Dask,
      chunks of a worker that dies are computed elsewhere.
    - `chunk`: lanes in a chunk of the store, and of what an executor gets.

    **Returns:** an `xarray.Dataset` along the axes (along "lane" if zipped), with units and the
    settings as attributes.

    **Raises:** `ValueError` for arguments that no sweep can use, and for a store that belongs to
    other settings; `ChunkError` if an executor fails.
    """
    settings = settings_or(settings, presets.default)
    settings.require_double()
    check_precision(False)
    outputs = outputs_beside({} if outputs is None else outputs, saving_or_nothing(save), scene)
    _check_axes(axes)
    check_outputs(outputs, scene, settings.ledger)
    units = {name: axis.unit_in(scene, state) for name, axis in axes.items()}
    layout = Layout(
        tuple(Coordinate(name, axis.values, units[name]) for name, axis in axes.items()),
        chunk,
        *variables_of(scene, outputs),
        _decisive(settings, start_time, devices),
        zipped,
        _notes(settings, end_time, outputs),
    )
    lanes = lanes_of(scene, state, axes, layout.values())
    layout = replace(layout, notes={**layout.notes, **_lane_notes(lanes, axes)})
    check_numbers(scene, state)
    lanes, redundant = checked_starts(lanes, start_time, settings.coordinates)
    common = _common(lanes, Scheme.of(settings, redundant), outputs, start_time, settings.max_steps)
    tasks = _tasks(lanes, end_time, start_time, settings, outputs)
    if path is None:
        trace, store = None, SweepMemory(layout)
    else:
        trace = _trace(common, axes, lanes)
        digests = trace()
        common = replace(common, programs=tuple(digests.items()))
        store = SweepStore.open(path, layout, _identity(digests, common, lanes, tasks))
    work = Work(common, tasks, tuple(scene.bodies), frozenset(lanes.bad), layout.variables)
    _compute(work, store, trace, executor, devices, progress)
    results = store.dataset()
    _report_failures(results, lanes)
    _report_journals_outside(results, lanes)
    return results


def _decisive(
    settings: Settings, start_time: float, devices: Sequence[Device] | None
) -> dict[str, str]:
    """Numbers and choices that tell the sweep from others, as a store has them."""
    numbers = {
        "start_time": start_time,
        "rtol": settings.rtol,
        "atol": settings.atol,
        "landing_tolerance": settings.landing_tolerance,
        "ledger": settings.ledger,
        "max_steps": settings.max_steps,
        "program": program_kind(busy_devices() if devices is None else devices),
    }
    return {name: describe(value) for name, value in numbers.items()} | versions()


def _notes(
    settings: Settings,
    end_time: float | Callable[[Scene], float],
    outputs: Mapping[str, Output],
) -> dict[str, str]:
    """What else was asked for, for a reader."""
    choices = {
        "end_time": end_time,
        "solver": settings.solver,
        "controller": settings.controller,
        "first_step": settings.first_step,
        "method: coordinates": settings.coordinates,
        "stabilisation": settings.stabilisation,
        "redundant": settings.redundant,
        **{f"output {name}": output for name, output in outputs.items()},
    }
    return {name: describe(value) for name, value in choices.items()}


def _common(
    lanes: Lanes, scheme: Scheme, outputs: Mapping[str, Output], start_time: float, max_steps: int
) -> Common:
    """What the lanes share: how they are run, and which outputs they have."""
    saved = next((name for name, o in outputs.items() if isinstance(o, AbstractSaved)), "")
    sections = {name: o for name, o in outputs.items() if isinstance(o, Section)}
    recorded = {name: o for name, o in outputs.items() if isinstance(o, AbstractSaved | Section)}
    tables = {name: o for name, o in outputs.items() if isinstance(o, ImpactTable)}
    if recorded or tables:
        require_dense(scheme.method.solver)
    plan = Plan(
        scheme,
        {name: o for name, o in outputs.items() if isinstance(o, AbstractReduction)},
        {name: section.condition for name, section in sections.items()},
        bool(saved),
        np.asarray(max_steps),
        {name: ImpactRecorder(table.joint) for name, table in tables.items()},
    )
    logs = {
        name: tuple(impact_log(name, *contact) for contact in table.contacts(lanes.scene))
        for name, table in tables.items()
    }
    channels = {
        name: {key: quantity for key, (quantity, _) in output.channels.items()}
        for name, output in recorded.items()
    }
    capacity = {name: section.count for name, section in sections.items()}
    capacity |= {log: tables[name].count for name, found in logs.items() for log in found}
    form, start = structured(lanes.scene, lanes.varied), np.asarray(start_time, dtype=float)
    return Common(plan, form, start, capacity, channels, saved, tables=logs)


def _check_axes(axes: Mapping[str, Axis]) -> None:
    remedy = 'pass for example {"clearance": cj.Axis(place, values)}'
    require_array_names("axes", axes, remedy)
    for name, axis in axes.items():
        kind = type(axis).__name__
        require(isinstance(axis, Axis), f"axes[{name!r}]", kind, "an Axis", remedy)


def _lane_notes(lanes: Lanes, axes: Mapping[str, Axis]) -> dict[str, str]:
    """What the lanes have in common, and what makes them differ."""
    states = jax.tree.map(lambda rows: bool((rows != rows[0]).any()), lanes.states)
    return {
        **{f"axis {name}": axis.described() for name, axis in axes.items()},
        "structure": structure_note(lanes.scene),
        **number_notes(lanes.scene, lanes.varied, "scene"),
        **number_notes(lanes.state, states, "state"),
    }


def _trace(common: Common, axes: Mapping[str, Axis], lanes: Lanes) -> Callable[[], dict[str, str]]:
    """A function that returns digests of the programs that the lanes run, as the process that calls
    it traces them."""
    form = structured(lanes.scene, variable_leaves(lanes, axes))
    start_time = float(common.start_time)
    return partial(programs, common.plan, form, lanes.state, start_time, common.channels)


def _identity(
    of_programs: Mapping[str, str], common: Common, lanes: Lanes, tasks: Task
) -> Identity:
    """Digests by which a store recognises the sweep."""
    digests = {RUN: run_digests(lanes, tasks)}
    if tasks.save_at is not None:
        digests[common.saved] = row_digests([tasks.save_at])
    return Identity(of_programs, digests)


def _tasks(
    lanes: Lanes,
    end_time: float | Callable[[Scene], float],
    start_time: float,
    settings: Settings,
    outputs: Mapping[str, Output],
) -> Task:
    """What each lane has for itself: scene, state, end, first step and times to save at."""
    saved = next((output for output in outputs.values() if isinstance(output, AbstractSaved)), None)
    count = len(jax.tree.leaves(lanes.states)[0])
    scenes = [lanes.of(k)[0] for k in range(count)] if callable(end_time) or saved else []
    given = [end_time(s) for s in scenes] if callable(end_time) else [end_time] * count
    ends = np.asarray(given, dtype=float)
    wrong = ends[~(np.isfinite(ends) & (ends > start_time))]
    require(
        not wrong.size,
        "end_time",
        wrong[:1],
        f"finite and after start_time = {start_time}",
        "give times in s",
    )
    first_steps = np.full(count, settings.length_of_first_step(start_time, ends), dtype=float)
    times = _save_times(saved, scenes, start_time, ends)
    return Task(lanes.scenes, lanes.states, ends, first_steps, times)


def _save_times(
    saved: AbstractSaved | None, scenes: Sequence[Scene], start_time: float, ends: np.ndarray
) -> np.ndarray | None:
    """Times (lanes, K), s, at which to save; ``None`` if nothing is to be saved."""
    if saved is None:
        return None
    rows = [saved.at(scene) for scene in scenes]
    counts = sorted({len(row) for row in rows})
    require(len(counts) == 1, "times", counts, "equally many in all lanes", "repeat the last one")
    spans = zip(rows, ends, strict=True)
    return np.stack([checked_times(start_time, end, row, "times") for row, end in spans])


def _compute(
    work: Work,
    store: SweepMemory | SweepStore,
    trace: Callable[[], Mapping[str, str]] | None,
    executor: AbstractSubmitter | None,
    devices: Sequence[Device] | None,
    progress: bool,
) -> None:
    """Run the lanes that the store lacks, and write their results to it."""
    missing = store.missing()
    left = sum(map(len, missing.values()))
    with lane_progress(len(work), len(work) - left, progress) as bar:
        if executor is not None:

            def on_done(chunk: int, results: LaneArrays) -> None:
                store.write(chunk, missing[chunk], results)
                bar.update(len(missing[chunk]))

            run_chunks(Chunks(work, missing, trace), missing, executor, on_done)
        elif missing:
            chunk_of = {lane: chunk for chunk, lanes in missing.items() for lane in lanes}
            collected: dict[int, dict[int, LaneArrays]] = {chunk: {} for chunk in missing}
            done = len(work) - left

            def on_ended(lane: int, results: LaneArrays) -> None:
                nonlocal done
                done += 1
                chunk = chunk_of[lane]
                collected[chunk][lane] = results
                if len(collected[chunk]) == len(missing[chunk]):
                    rows = collected.pop(chunk)
                    store.write(chunk, missing[chunk], joined([rows[k] for k in missing[chunk]]))

            def on_progress(lanes: float) -> None:
                bar.update(int(done + lanes) - bar.n)

            work.run(list(chunk_of), on_ended, devices=devices, on_progress=on_progress)


def _report_failures(results: "xr.Dataset", lanes: Lanes) -> None:
    names = {number: name for name, number in result_numbers().items()}
    counts = Counter(names.get(int(code), "pending") for code in results[RESULT].values.ravel())
    del counts["successful"]
    if counts:
        failed = ", ".join(f"{count} {name}" for name, count in counts.items())
        first = next(iter(lanes.bad.items()), None)
        example = "" if first is None else f" Lane {first[0]}: {first[1]}"
        warnings.warn(
            f"{counts.total()} of {results[RESULT].size} lanes failed: {failed}.{example}",
            stacklevel=3,
        )


def _report_journals_outside(results: "xr.Dataset", lanes: Lanes) -> None:
    """Warn of journals that are outside their bearings at the end of a lane."""
    parts = (results[f"final_{part}"] for part in ("position", "orientation", "velocity", "spin"))
    columns = [part.values.reshape(-1, *part.shape[-2:]) for part in parts]
    bodies = {
        str(name): BodyState(*(column[:, k] for column in columns))
        for k, name in enumerate(results["body"].values)
    }
    for name, excess in slid_out(lanes.contact_joints(), bodies).items():
        count = int(np.count_nonzero(excess > 0.0))
        if count:
            caution(
                f"In {count} of {excess.size} lanes the journal of joint {name!r} has slid out of "
                f"its bearing at the end, by up to {np.nanmax(excess):.3g} m. {HOLD_IT}",
                LeftBearingWarning,
            )
