"""Sweeps: one scene with many values of its parameters."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from os import PathLike
from typing import TYPE_CHECKING

from ..fields.checks import require, require_array_names, require_count
from ..fields.conversion import with_arrays
from ..model.bodies import State
from ..model.scene import Scene
from ..simulation.run.run_checks import check_numbers, check_precision
from ..simulation.run.saving import Saving, saving_or_nothing
from ..simulation.step import presets
from ..simulation.step.method import Scheme
from ..simulation.step.settings import Settings, settings_or
from .axes import Axis, lanes_of
from .computing import computed
from .descriptions import decisive, informative
from .executors import AbstractSubmitter
from .layout import Coordinate, Layout
from .outputs import Output, check_outputs
from .planning import common_values, identity, lane_tasks, program_tracer
from .reports import report_failures, report_journals_outside
from .saved_states import outputs_beside
from .starts import checked_starts
from .store.store import SweepMemory, SweepStore
from .variables import variables_of
from .work import Work

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
    threads: int | None = None,
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
      `DissipatedEnergy`, `MeanPowerLost`, `Statistics`, `ArchardWear`, or a subclass of
      `AbstractReduction`), one `Saved`, `Section`, and `ImpactTable`:
      ``{"hits": cj.ImpactTable(20)}`` tables the first 20 impacts of every contact, the peak force
      of which is ``hits_peak_force``. The final state, result code, time reached, and steps are
      always kept.
    - `settings`: how to integrate; `clearjoint.presets.default` unless given.
    - `save`: what else to keep of each lane, as in `simulate`: the states at times, as
      ``saved_position``, ``saved_orientation``, ``saved_velocity`` and ``saved_spin`` along
      ``saved_time``, and sections, which are outputs of the same names. Every step of a lane can't
      be kept, and impacts only in an `ImpactTable`.
    - `path`: a Zarr store, which is written chunk by chunk. A sweep that finds its own store there
      computes only what is missing or damaged, so that values of axes, axes and outputs can be
      added. It is known by its lanes' numbers and by what JAX traces of their runs, not by source
      texts or names. `open_sweep(path)` reads it, finished or not, and so does
      ``xarray.open_zarr(path)``. Lanes are stored while others run: a process that is killed loses
      those that run, and of those that have ended a chunk or the last ten seconds.
    - `executor`: a `concurrent.futures.Executor` (of processes that are spawned, not forked; a
      script that makes one stands behind ``if __name__ == "__main__":``) or a
      `dask.distributed.Client` (of clusters: ``pip install 'clearjoint[cluster]'``), to which
      chunks are handed; unless given, threads of this process share the lanes. With Dask, chunks
      of a worker that dies are computed elsewhere.
    - `threads`: how many share the lanes in this process: as many as `configure` says, unless
      given. No result depends on it.
    - `chunk`: lanes in a chunk of the store, and of what an executor gets.

    **Returns:** an `xarray.Dataset` along the axes (along "lane" if zipped), with units and the
    settings as attributes.

    **Raises:** `ValueError` for arguments that no sweep can use, and for a store that belongs to
    other settings; `ChunkError` if an executor fails.

    >>> axis = cj.Axis(lambda scene: scene.forces["spring"].stiffness, [100.0, 400.0])
    >>> speed = cj.Peak(cj.quantities.Velocity("ball"), "m/s")
    >>> found = cj.sweep(scene, state, 0.5, {"stiffness": axis}, {"speed": speed}, progress=False)
    >>> np.round(found["speed"].values, 4)  # 0.1 m times 10 and 20 rad/s
    array([1., 2.])
    """
    settings = settings_or(settings, presets.default)
    settings.require_double()
    check_precision(False)
    scene, state = with_arrays((scene, state))
    outputs = outputs_beside({} if outputs is None else outputs, saving_or_nothing(save), scene)
    _check_axes(axes)
    check_outputs(outputs, scene, settings.ledger)
    if threads is not None:
        require_count("threads", threads, "give a number of threads, or None")
    labels = tuple(Coordinate(name, a.values, a.unit_in(scene, state)) for name, a in axes.items())
    decides = decisive(settings, start_time)
    layout = Layout(labels, chunk, *variables_of(scene, outputs), decides, zipped)
    lanes = lanes_of(scene, state, axes, layout.values())
    layout = replace(layout, notes=informative(settings, end_time, outputs, axes, lanes))
    check_numbers(scene, state)
    lanes, redundant = checked_starts(lanes, start_time, settings.coordinates)
    scheme = Scheme.of(settings, redundant)
    common = common_values(lanes, scheme, outputs, start_time, settings.max_steps)
    tasks = lane_tasks(lanes, end_time, start_time, settings, outputs)
    if path is None:
        trace, store = None, SweepMemory(layout)
    else:
        trace = program_tracer(common, axes, lanes)
        digests = trace()
        common = replace(common, programs=tuple(digests.items()))
        store = SweepStore.open(path, layout, identity(digests, common, lanes, tasks))
    work = Work(common, tasks, tuple(scene.bodies), frozenset(lanes.bad), layout.variables)
    results = computed(work, store, trace, executor, threads, progress)
    report_failures(results, lanes)
    report_journals_outside(results, lanes)
    return results


def _check_axes(axes: Mapping[str, Axis]) -> None:
    remedy = 'pass for example {"clearance": cj.Axis(place, values)}'
    require_array_names("axes", axes, remedy)
    for name, axis in axes.items():
        kind = type(axis).__name__
        require(isinstance(axis, Axis), f"axes[{name!r}]", kind, "an Axis", remedy)
