"""Sweeps: one scene with many values of its parameters."""

import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from os import PathLike
from typing import Any

import diffrax
import jax
import numpy as np
import xarray as xr

from ..bodies import State
from ..coordinates import AbstractCoordinates
from ..dynamics import AbstractStabilisation
from ..fields import require
from ..joint_coordinates import JointCoordinates
from ..lanes import Plan
from ..pool import Common, Task
from ..records import require_dense
from ..reductions import AbstractReduction
from ..results import result_numbers
from ..scene import Scene
from ..simulate import check_precision, check_values, make_formulation, make_method
from ..steps import Method
from ..structure import constraint_report
from ..vectors import structured
from .axes import Axis, Lanes, lanes_of
from .describe import describe, scene_settings, structure_setting, versions
from .execution import run_chunks
from .layout import RESULT, Coordinate, Layout
from .outputs import Saved, Section
from .progress import lane_progress
from .store import SweepMemory, SweepStore
from .task import Results, Work, joined
from .variables import variables_of

Output = AbstractReduction | Saved | Section
CHUNK = 256


def sweep(
    scene: Scene,
    state: State,
    end_time: float | Callable[[Scene], float],
    axes: Mapping[str, Axis],
    outputs: Mapping[str, Output] | None = None,
    *,
    zipped: bool = False,
    path: str | PathLike | None = None,
    executor: Any = None,
    devices: Sequence[Any] | None = None,
    chunk: int = CHUNK,
    start_time: float = 0.0,
    rtol: float = 1e-6,
    atol: float | None = None,
    solver: diffrax.AbstractSolver | None = None,
    controller: diffrax.AbstractStepSizeController | None = None,
    first_step: float | None = None,
    coordinates: AbstractCoordinates | None = None,
    stabilisation: AbstractStabilisation | None = None,
    landing_tolerance: float | None = 1e-12,
    ledger: bool = False,
    max_steps: int = 10_000_000,
    progress: bool = True,
) -> xr.Dataset:
    """Simulate a scene for many values of its parameters.

    Lanes, one for each combination of values, are integrated together, each on its own time and
    step size; a lane's numbers are those of the single run, whatever runs beside it. A lane that
    fails keeps its result code and the time it reached, and the others are untouched.

    **Arguments:**

    - `scene`, `state`, `end_time` s, and from `start_time` on the settings of `simulate`.
      `end_time` may be a function of the lane's scene, say of a crank's speed.
    - `axes`: the values of each parameter by name; see `Axis`. Their outer product, or with
      `zipped` as many lanes as each has values, for lists and designs of experiments.
    - `outputs`: what is kept of each lane, by name: reductions (`Peak`, `ImpactCount`,
      `DissipatedEnergy`, `Statistics`, or a subclass of `AbstractReduction`), one `Saved`, and
      `Section`. The final state, result code, time reached, and steps are always kept.
    - `path`: a Zarr store, which is written chunk by chunk. A sweep that finds its own store there
      computes only what is missing. `open_sweep(path)` reads it, finished or not.
    - `executor`: a `concurrent.futures.Executor` (of processes that are spawned, not forked) or a
      `dask.distributed.Client` (of clusters: ``pip install 'clearjoint[cluster]'``), to which
      chunks are handed; unless given, all `devices` of this process share the lanes. With Dask,
      chunks of a worker that dies are computed elsewhere.
    - `chunk`: lanes in a chunk of the store, and of what an executor gets.

    **Returns:** an `xarray.Dataset` along the axes (along "lane" if zipped), with units and the
    settings as attributes.

    **Raises:** `ValueError` for arguments that no sweep can use, and for a store that belongs to
    other settings; `ChunkError` if an executor fails.
    """
    check_precision(False)
    outputs = {} if outputs is None else outputs
    _check_outputs(outputs, ledger)
    settings = {
        "end_time": end_time,
        "start_time": start_time,
        "rtol": rtol,
        "atol": atol,
        "solver": solver,
        "controller": controller,
        "first_step": first_step,
        "method: coordinates": coordinates,
        "stabilisation": stabilisation,
        "landing_tolerance": landing_tolerance,
        "ledger": ledger,
        "max_steps": max_steps,
    }
    layout = Layout(
        tuple(
            Coordinate(name, axis.values, axis.unit_in(scene, state)) for name, axis in axes.items()
        ),
        chunk,
        *variables_of(scene, outputs),
        settings=_described(scene, state, axes, outputs, settings),
        zipped=zipped,
    )
    lanes = lanes_of(scene, state, axes, layout.values())
    check_values(scene, state, rtol, atol, first_step, landing_tolerance)
    coordinates = JointCoordinates() if coordinates is None else coordinates
    report = constraint_report(*lanes.first(), start_time, coordinates)
    formulation = make_formulation(coordinates, stabilisation, bool(report.redundant), ledger)
    method = make_method(solver, controller, formulation, landing_tolerance, rtol, atol)
    common = _common(lanes, method, outputs, start_time, max_steps)
    tasks = _tasks(lanes, end_time, start_time, first_step, outputs.get(common.saved))
    work = Work(common, tasks, tuple(scene.bodies), frozenset(lanes.bad), layout.variables, chunk)
    store = SweepMemory(layout) if path is None else SweepStore.open(path, layout)
    _compute(work, store, executor, devices, progress)
    results = store.dataset()
    _report_failures(results, lanes)
    return results


def _common(
    lanes: Lanes, method: Method, outputs: Mapping[str, Output], start_time: float, max_steps: int
) -> Common:
    """What the lanes share: how they are run, and what is kept of them."""
    saved = next((name for name, o in outputs.items() if isinstance(o, Saved)), "")
    sections = {name: o for name, o in outputs.items() if isinstance(o, Section)}
    recorded = {name: o for name, o in outputs.items() if isinstance(o, Saved | Section)}
    if recorded:
        require_dense(method.solver)
    plan = Plan(
        method,
        {name: o for name, o in outputs.items() if isinstance(o, AbstractReduction)},
        {name: section.condition for name, section in sections.items()},
        bool(saved),
        np.asarray(max_steps),
    )
    channels = {
        name: {key: quantity for key, (quantity, _) in output.channels.items()}
        for name, output in recorded.items()
    }
    capacity = {name: section.count for name, section in sections.items()}
    form = structured(lanes.scene, lanes.varied)
    return Common(plan, form, np.asarray(start_time, dtype=float), capacity, channels, saved)


def _check_outputs(outputs: Mapping[str, Output], ledger: bool) -> None:
    for name, output in outputs.items():
        require(
            isinstance(output, Output),
            f"outputs[{name!r}]",
            output,
            "a reduction, a Saved or a Section",
            "subclass AbstractReduction, or pass one of clearjoint's",
        )
        needs = isinstance(output, AbstractReduction) and output.needs_ledger
        require(
            ledger or not needs, "ledger", ledger, f"True for outputs[{name!r}]", "pass ledger=True"
        )
    saves = [name for name, output in outputs.items() if isinstance(output, Saved)]
    require(len(saves) <= 1, "outputs", saves, "with one Saved at most", "join their times")


def _described(
    scene: Scene,
    state: State,
    axes: Mapping[str, Axis],
    outputs: Mapping[str, Output],
    settings: Mapping[str, Any],
) -> dict[str, str]:
    """All that decides the numbers, as texts. What an axis varies is described by its values."""
    for axis in axes.values():
        with suppress(ValueError):
            scene, state = axis.setter(scene, state)(scene, state, axis.values[0])
    return {
        **{name: describe(value) for name, value in settings.items()},
        **{f"axis {name}": axis.described() for name, axis in axes.items()},
        **{f"output {name}": describe(output) for name, output in outputs.items()},
        "structure": structure_setting(scene),
        **scene_settings(scene, state),
        **versions(),
    }


def _tasks(
    lanes: Lanes, end_time: Any, start_time: float, first_step: float | None, saved: Any
) -> Task:
    count = len(jax.tree.leaves(lanes.states)[0])
    scenes = [lanes.of(k)[0] for k in range(count)] if callable(end_time) or saved else []
    ends = [end_time(s) for s in scenes] if callable(end_time) else [end_time] * count
    ends = np.asarray(ends, dtype=float)
    wrong = ends[~(np.isfinite(ends) & (ends > start_time))]
    require(
        not wrong.size,
        "end_time",
        wrong[:1],
        f"finite and after start_time = {start_time}",
        "give times in s",
    )
    steps = 1e-6 * (ends - start_time) if first_step is None else np.full(count, float(first_step))
    return Task(
        lanes.scenes, lanes.states, ends, steps, _save_times(saved, scenes, start_time, ends)
    )


def _save_times(
    saved: Saved | None, scenes: Sequence[Scene], start_time: float, ends: np.ndarray
) -> np.ndarray | None:
    """(lanes, K) s."""
    if saved is None:
        return None
    rows = [saved.at(scene) for scene in scenes]
    counts = sorted({len(row) for row in rows})
    require(len(counts) == 1, "times", counts, "equally many in all lanes", "repeat the last one")
    times = np.stack(rows)
    require(
        bool((times[:, 0] >= start_time).all()) and bool((times[:, -1] <= ends).all()),
        "times",
        [times.min(), times.max()],
        "between start_time and end_time",
        "leave out the times outside",
    )
    return times


def _compute(
    work: Work,
    store: SweepMemory | SweepStore,
    executor: Any,
    devices: Sequence[Any] | None,
    progress: bool,
) -> None:
    """Run what the store lacks."""
    missing = store.missing()
    spans = {chunk: range(*store.layout.span(chunk).indices(len(work))) for chunk in missing}
    left = sum(len(span) for span in spans.values())
    with lane_progress(len(work), len(work) - left, progress) as bar:
        if executor is not None:

            def on_done(chunk: int, results: Results) -> None:
                store.write(chunk, results)
                bar.update(len(spans[chunk]))

            run_chunks(work, missing, executor, on_done)
        elif missing:
            collected: dict[int, dict[int, Results]] = {chunk: {} for chunk in missing}
            done = len(work) - left

            def on_ended(lane: int, results: Results) -> None:
                nonlocal done
                done += 1
                chunk = lane // work.chunk
                collected[chunk][lane] = results
                if len(collected[chunk]) == len(spans[chunk]):
                    rows = collected.pop(chunk)
                    store.write(chunk, joined([rows[k] for k in spans[chunk]]))

            def on_progress(lanes: float) -> None:
                bar.update(int(done + lanes) - bar.n)

            lanes = [lane for span in spans.values() for lane in span]
            work.run(lanes, on_ended, devices=devices, on_progress=on_progress)


def _report_failures(results: xr.Dataset, lanes: Lanes) -> None:
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
