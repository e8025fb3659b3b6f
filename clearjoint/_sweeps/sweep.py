"""Parameter sweeps: simulate one scene for many values of its parameters."""

import os
import re
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from os import PathLike
from typing import TYPE_CHECKING, TypedDict

import jax
import numpy as np
from jaxtyping import PyTree

from .._dynamics.assembly import ACCEPTED_VIOLATION, require_certain, require_freedom
from .._dynamics.constraint_report import check_names, dependent, start_rows_of_lanes
from .._dynamics.coordinates import AbstractCoordinates
from .._dynamics.journals import HOLD_IT, slid_out
from .._export.datasets import describe, described, versions
from .._fields.cautions import LeftBearingWarning, caution, quiet, warn_the_user
from .._fields.checks import (
    as_number,
    require,
    require_array_names,
    require_count,
    require_shape,
    require_types,
)
from .._fields.objects import with_arrays
from .._math.vectors import fold_constants
from .._model.bodies import BodyState, State
from .._model.scene import Scene
from .._native import is_native
from .._parametrisation.paths import parameters
from .._result_codes import RESULTS, result_number, result_numbers
from .._simulation.lanes.lane import SAVED, Common, Task, impact_log
from .._simulation.reductions.base import AbstractReduction
from .._simulation.results.impact_table import IMPACT_UNITS
from .._simulation.results.solution import LABELS, STATE_PARTS, contact_label
from .._simulation.run.impact_recorder import ImpactRecorder
from .._simulation.run.outputs import ImpactTable, Output, Requested, requested_by
from .._simulation.run.rejections import RejectedSteps
from .._simulation.run.run_checks import check_numbers, check_precision, check_structure
from .._simulation.run.saving import Saving
from .._simulation.run.sections import Section
from .._simulation.step import presets
from .._simulation.step.dense_output import require_dense
from .._simulation.step.method import Scheme
from .._simulation.step.settings import Settings, check_span, settings_or
from .axes import Axis, Lanes, lanes_of, variable_leaves
from .computing import compute_missing
from .executors import AbstractSubmitter
from .outputs import PENDING, RESULT, Coordinate, Layout, Variable, sampled_channels, variable_name
from .store.program import identity_of, programs
from .store.store import SweepMemory, SweepStore
from .work import CONTACT, Work

if TYPE_CHECKING:
    import xarray as xr


def variables_of(
    scene: Scene, requested: Requested
) -> tuple[dict[str, Variable], tuple[Coordinate, ...]]:
    """Return descriptions of the results that a sweep stores for each lane, by name, and the labels
    of their dimensions, such as names of bodies, besides those of the sweep's axes."""
    # By the CF conventions, these two attributes give the name of each integer result code.
    codes = {"pending": PENDING, **result_numbers()}
    flags = {"flag_values": [*codes.values()], "flag_meanings": " ".join(codes)}
    variables = {
        RESULT: Variable(dtype="int8", description="result code of the run", attrs=flags),
        "time_reached": Variable(unit="s", description="time at which the run ended"),
        "attempts": Variable(dtype="int64", description="steps tried"),
        "accepted": Variable(dtype="int64", description="steps accepted"),
        **_states(scene, "final", "of the bodies at the end"),
    }
    coordinates = [
        Coordinate("body", np.array(list(scene.bodies), dtype=str)),
        *(Coordinate(name, np.array(labels)) for name, labels in LABELS.items()),
    ]
    # Tables of impacts have a dimension of contacts, which is named after the output, since its
    # labels may differ between outputs.
    for name, table in requested.tables.items():
        labels = [contact_label(*contact) for contact in table.contacts(scene)]
        coordinates.append(Coordinate(variable_name(name, CONTACT), np.array(labels)))
    # `along` are the name and the size of the dimension of sample times, empty without these.
    along, times = ((), ()), requested.save.at(scene)
    if times is not None:
        # Sample times are labels of a dimension if all lanes have the same. Otherwise every lane
        # has equally many, which is checked when their tasks are made.
        name, size = variable_name(SAVED, "time"), np.shape(times)
        if callable(requested.save.times):
            along = (variable_name(SAVED, "number"),), size
            variables[name] = Variable(*along, unit="s", description="sample time")
        else:
            along = (name,), size
            coordinates.append(Coordinate(name, np.asarray(times, dtype=float), "s"))
        if requested.save.states:
            variables |= _states(scene, SAVED, "of the bodies", along)
    for name, output in requested.outputs.items():
        further = _variables_of_output(scene, name, output, along)
        twice = sorted(set(variables) & set(further))
        expected = "an output whose results have unused names"
        require(not twice, f"outputs[{name!r}]", twice, expected, "rename the output")
        variables |= further
    return variables, tuple(coordinates)


Along = tuple[tuple[str, ...], tuple[int, ...]]
"""Names and sizes of dimensions of a variable, such as sample times, besides those of one value."""


def _variables_of_output(
    scene: Scene, name: str, output: Output, sampled: Along
) -> dict[str, Variable]:
    kind = type(output).__name__
    if isinstance(output, AbstractReduction):
        texts = {key: f"{kind}, {key}" if key else kind for key in output.units()}
        return {
            variable_name(name, key): Variable(unit=unit, description=texts[key])
            for key, unit in output.units().items()
        }
    if not isinstance(output, Section | ImpactTable):  # a quantity, at the times to save at
        unit = getattr(output, "unit", None) or ""
        return {name: Variable(*sampled, unit=unit, description=name)}
    # The other outputs are tables of impacts or crossings. They have a variable for each column,
    # along the numbers of the rows. Lanes record different numbers of them, which are counted in a
    # further variable.
    if isinstance(output, ImpactTable):
        dims = variable_name(name, CONTACT), variable_name(name, "number")
        shape, units = (len(output.contacts(scene)), output.count), IMPACT_UNITS
        count = Variable(dims[:1], shape[:1], "int64", description="impacts recorded")
    else:
        dims, shape = (variable_name(name, "number"),), (output.count,)
        units = {"time": "s"} | {key: unit for key, (_, unit) in output.pairs.items()}
        count = Variable(dtype="int64", description="crossings recorded")
    columns = {key: Variable(dims, shape, unit=unit) for key, unit in units.items()}
    return {variable_name(name, key): v for key, v in ({"count": count} | columns).items()}


def _states(
    scene: Scene, name: str, description: str, along: Along = ((), ())
) -> dict[str, Variable]:
    # One variable for each part, such as the positions, along the bodies and the components.
    dims, shape = along
    return {
        variable_name(name, part): Variable(
            (*dims, "body", dim),
            (*shape, len(scene.bodies), len(LABELS[dim])),
            unit=unit,
            description=f"{part} {description}",
        )
        for part, (dim, unit) in STATE_PARTS.items()
    }


def identifying_settings(settings: Settings, start_time: float) -> dict[str, str]:
    """Return, as texts by name, the settings that a store compares, because results depend on them.
    A store recognises other settings, such as the solver, by the digests of the traced programs."""
    names = ("rtol", "atol", "landing_tolerance", "ledger", "max_steps")
    values = {name: getattr(settings, name) for name in names}
    program = "native" if is_native() else f"XLA, {jax.default_backend()}"
    return described({"start_time": start_time, **values, "program": program}) | versions()


def notes_for_readers(
    settings: Settings,
    end_time: float | Callable[[Scene], float],
    requested: Requested,
    axes: Mapping[str, Axis],
    lanes: Lanes,
) -> dict[str, str]:
    """Return, as texts by name, the arguments of a sweep and the numbers that all lanes share, for
    attributes of the results that a store does not compare."""
    # For each leaf of the state, whether it differs between lanes.
    states = jax.tree.map(lambda rows: bool((rows != rows[0]).any()), lanes.states)
    names = ("solver", "controller", "first_step", "stabilisation", "redundant")
    choices = {
        "end_time": end_time,
        **{name: getattr(settings, name) for name in names},
        # The name "coordinates" alone can't be used, because xarray itself writes an attribute of
        # this name to files.
        "method: coordinates": settings.coordinates,
        "save": requested.save,
        **{f"output {name}": output for name, output in requested.outputs.items()},
    }
    return {
        **described(choices),
        **{f"axis {name}": axis.described() for name, axis in axes.items()},
        # Names and kinds of the scene's elements, with 0 in place of their numbers.
        "structure": describe(jax.tree.map(lambda _: 0, lanes.scene)),
        **_constant_numbers(lanes.scene, lanes.varied, "scene"),
        **_constant_numbers(lanes.state, states, "state"),
    }


def _constant_numbers(tree: PyTree, varied: PyTree[bool], name: str) -> dict[str, str]:
    """Return the numbers of a PyTree that all lanes share, as texts by paths that begin with
    `name`. `varied` tells for each leaf of the PyTree whether it differs between lanes."""
    varies = {key: any(jax.tree.leaves(flags)) for key, (flags, _) in parameters(varied).items()}

    # bodies['rod'].mass becomes bodies.rod.mass. Names in netCDF files, as xarray writes them,
    # contain neither "'" nor "/"; those that SciPy writes contain Latin letters only.
    def written(key: str) -> str:
        key = re.sub(r"""\[['"]""", ".", re.sub(r"""['"]\]""", "", key))
        key = key.replace("'", "\\x27").replace("/", "\\x2f")
        return key.encode("latin-1", "backslashreplace").decode("latin-1")

    return {
        f"{name}.{written(key)}": describe(value)
        for key, (value, _) in parameters(tree).items()
        if not varies[key]
    }


PASS_TABLE = 'pass outputs={"hits": cj.ImpactTable(20)}, which keeps the first 20 of each contact'
_PROCESS = os.getpid()
"""Identifier of the process that has imported this module; a forked process has another one."""
CHUNK = 256
"""Default number of lanes in a chunk. For each chunk, a store has a file for each result, and an
executor has one task."""
EndTime = float | Callable[[Scene], float]
"""Time of the end of a lane, s, or a function of its scene that returns it."""


class SweepOptions(TypedDict, total=False):
    """Keyword arguments of `sweep` that functions such as `sobol_indices` pass on."""

    save: Saving | None
    start_time: float
    path: str | PathLike | None
    executor: AbstractSubmitter | None
    threads: int | None
    chunk: int
    progress: bool


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

    Each combination of values is a run, called a lane. Lanes run side by side, but each has its own
    time and step size, so its numbers are those of a single run and don't depend on the other
    lanes. If a lane fails, the results have its code and the time it reached, and the other lanes
    continue. A lane with a value that a scene can't have, or with nearly redundant constraints, is
    not run: its result code is that of `bad_parameters`, and its outputs, final state and numbers
    of steps are NaN, or -1 for integers.

    **Arguments:**

    - `scene`, `state`, `start_time`, `end_time`: as in `simulate`. `end_time` may be a function of
      the lane's scene, for example of the speed of a crank.
    - `axes`: the values of each parameter by name; see `Axis`. The lanes are all combinations of
      the values. With `zipped`, lane i has the i-th value of every axis.
    - `outputs`: results of each lane, by name, as in `simulate`: reductions (`Peak`, `ImpactCount`,
      `DissipatedEnergy`, `MeanPowerLost`, `Statistics`, `ArchardWear`, or a subclass of
      `AbstractReduction`), sections (`Section`), tables of impacts (`ImpactTable`), and quantities,
      which are evaluated at the times of `save`, along ``saved_time``. For instance, ``{"hits":
      cj.ImpactTable(20)}`` records the first 20 impacts of every contact, with their peak forces as
      ``hits_peak_force``. Every lane also has its final state, result code, time reached, and
      numbers of steps.
    - `settings`: by default `clearjoint.presets.default`.
    - `save`: a `Saving` with the sample times of each lane, at which states are saved as
      ``saved_position``, ``saved_orientation``, ``saved_velocity`` and ``saved_spin``, unless its
      `states` is false. Times that are a function of the lane's scene are the variable
      ``saved_time`` along ``saved_number``. Entries for times that a failed lane has not reached
      are NaN. Sweeps can't save every step, and save impacts only by an `ImpactTable`.
    - `path`: folder of a Zarr store, which is written chunk by chunk. If it is the store of this
      sweep, only missing or damaged lanes are computed, so that axes, further values of an axis,
      and outputs can be added later. An axis of a vector can't be added if a component of this
      vector in `scene` is exactly 0 or 1. A store recognises its sweep by the numbers of its lanes
      and the programs that JAX traces, not by source texts or names. `open_sweep(path)` and
      ``xarray.open_zarr(path)`` read the store, also of an unfinished sweep. A process that is
      killed loses the running lanes and, of ended ones, about one second of computing; on a slow
      disk, also lanes of incomplete chunks.
    - `executor`: a `concurrent.futures.Executor` or a `dask.distributed.Client` that computes the
      chunks; by default threads of this process share the lanes. Processes must be spawned, not
      forked, and a script must make the executor below ``if __name__ == "__main__":``, as
      ``ProcessPoolExecutor(4, mp_context=multiprocessing.get_context("spawn"))``. Dask serves for
      clusters (``pip install 'clearjoint[cluster]'``); if a worker dies, another gets its chunks.
    - `threads`: number of threads that share the lanes in this process; by default the number given
      to `configure`, or one for each core. Results don't depend on it.
    - `chunk`: number of lanes in a chunk of the store, and in a task of the executor.

    **Returns:** an `xarray.Dataset` along the axes (along "lane" if zipped), with units and the
    settings as attributes.

    **Raises:** `ValueError` for unsupported arguments, for a store that belongs to another sweep,
    and for a `path` in a forked process; `PermissionError` for lanes that are missing in a store
    which can't be written to; `ChunkError` if an executor fails.

    **Warns:** `UserWarning` with the number of failed lanes, the error message of the first lane
    that was not run, and the number of lanes that are pending because another process has discarded
    their results; another one that names damaged files of the store; `LeftBearingWarning` if a
    journal has slid out of its bearing at the end of a lane.

    >>> axis = cj.Axis(lambda scene: scene.forces["spring"].stiffness, [100.0, 400.0])
    >>> speed = cj.Peak(cj.quantities.Velocity("ball"), "m/s")
    >>> results = cj.sweep(scene, state, 0.5, {"stiffness": axis}, {"speed": speed}, progress=False)
    >>> np.round(results["speed"].values, 4)  # 0.1 m times 10 and 20 rad/s
    array([1., 2.])
    """
    check_names(scene, state)
    settings = settings_or(settings, presets.default)
    settings.require_double()
    check_precision(False)  # `False`: single precision is not allowed
    scene, state = with_arrays((scene, state))
    requested = requested_by(outputs, save)
    remedy = 'pass for example {"clearance": cj.Axis(path, values)}'
    require_array_names("axes", axes, remedy)
    require_types("axes", axes, Axis, "an Axis", remedy)
    save = requested.save
    save.require_none(["steps"], "in a sweep", "pass the lane's scene to simulate() for them")
    save.require_none(["impacts"], "in a sweep", PASS_TABLE)
    remedy = "pass the lane's scene to simulate() for it"
    requested.refuse(RejectedSteps, "another output in a sweep", remedy)
    requested.check_names()
    requested.check(scene, settings.ledger)
    if threads is not None:
        require_count("threads", threads, "give a number of threads, or None")
    if path is not None:
        # JAX computes while the programs are traced, and would wait forever for threads that only
        # the parent process has.
        expected = "None in a process that was forked after clearjoint was imported"
        remedy = "start processes by multiprocessing.get_context('spawn')"
        require(os.getpid() == _PROCESS, "path", str(path), expected, remedy)
    require_shape("start_time", start_time, (), "pass one time in s")
    labels = tuple(Coordinate(name, a.values, a.unit_in(scene, state)) for name, a in axes.items())
    variables, coordinates = variables_of(scene, requested)
    # Settings that change the numbers of a lane; a store with others belongs to another sweep.
    identifying = identifying_settings(settings, start_time)
    layout = Layout(labels, chunk, variables, coordinates, identifying, zipped)
    lanes = lanes_of(scene, state, axes, layout.values())
    layout = replace(layout, notes=notes_for_readers(settings, end_time, requested, axes, lanes))
    check_numbers(scene, state)
    lanes, redundant = checked_starts(lanes, start_time, settings.coordinates)
    scheme = Scheme.of(settings, redundant)
    common = _common_values(lanes, scheme, requested, start_time, settings.max_steps)
    tasks = _lane_tasks(lanes, end_time, start_time, settings, save)
    if path is None:
        # Results in memory need no fingerprint, so that no program is traced for them.
        trace, store = None, SweepMemory(layout)
    else:
        # All leaves that the axes can change are arguments of the programs, even if they are equal
        # in all present lanes: more values on an axis must not change the digests.
        folded = fold_constants(scene, variable_leaves(lanes, axes))
        # Worker processes trace the programs too, to check that they have the same code.
        trace = partial(programs, replace(common, folded_scene=folded), state)
        digests = trace()
        common = replace(common, programs=tuple(digests.items()))
        store = SweepStore.open(path, layout, identity_of(digests, lanes, tasks))
    work = Work(common, tasks, tuple(scene.bodies), frozenset(lanes.bad), layout.variables)
    results = compute_missing(work, store, trace, executor, threads, progress)
    # The warnings are about all lanes, also those that the store already had.
    _warn_of_failures(results, lanes, start_time, settings.coordinates)
    _warn_of_journals_outside(results, lanes)
    return results


def checked_starts(
    lanes: Lanes, start_time: float, coordinates: AbstractCoordinates
) -> tuple[Lanes, bool]:
    """Return the lanes after checks, and whether any lane's constraints are redundant at its start.

    Lanes whose constraints are nearly redundant, so that their rank is uncertain, are added to
    `Lanes.bad`. Lanes whose initial state violates the constraints are left as they are: their runs
    end at once, with the result code of `not_assembled`.
    """
    # All lanes have the same coordinates, so the first lane tells whether something can move.
    _, first_state = lanes.of(0)
    require_freedom(lanes.scene, first_state, coordinates)
    rows = start_rows_of_lanes(lanes.scene, lanes.scenes, lanes.states, start_time, coordinates)
    # `searched` keeps the results of the search for dependent rows. Lanes often have equal rows, so
    # the search is done once for all of them.
    bad, redundant = dict(lanes.bad), False
    searched: dict[bytes, np.ndarray] = {}
    # Only lanes that satisfy their constraints are looked at: the others end as `not_assembled`.
    residuals = np.concatenate([rows.values, rows.rates], axis=1)
    for lane in np.flatnonzero((np.abs(residuals) <= ACCEPTED_VIOLATION).all(axis=1)).tolist():
        if lane in bad:
            continue
        dependent_rows, uncertain = dependent(rows.names, rows.reduced[lane], searched)
        try:
            require_certain(uncertain)
            redundant = redundant or bool(dependent_rows)
        except ValueError as error:
            bad[lane] = str(error)
    return replace(lanes, bad=dict(sorted(bad.items()))), redundant


def _common_values(
    lanes: Lanes, scheme: Scheme, requested: Requested, start_time: float, max_steps: int
) -> Common:
    sections, tables, saves = requested.sections, requested.tables, requested.save.times is not None
    # Crossings, sample times and peaks of impacts lie inside of steps.
    if saves or sections or tables:
        require_dense(scheme.method.solver)
    # A lane writes a log, a list of rows, for each section and each contact of a table of impacts.
    # `capacity`: largest number of rows of a log. `channels`: quantities at crossings and samples.
    logs = {
        name: tuple(impact_log(name, *contact) for contact in table.contacts(lanes.scene))
        for name, table in tables.items()
    }
    channels = {
        name: {key: quantity for key, (quantity, _) in section.pairs.items()}
        for name, section in sections.items()
    }
    if saves:
        channels[SAVED] = sampled_channels(requested, lanes.scene)
    capacity = {name: section.count for name, section in sections.items()}
    capacity |= {log: tables[name].count for name, of_table in logs.items() for log in of_table}
    return Common(
        scheme=scheme,
        # Zeros and ones that all lanes share may become constants of the compiled program, which
        # shortens it; numbers that vary must stay arguments.
        folded_scene=fold_constants(lanes.scene, lanes.varied),
        start_time=np.asarray(start_time, dtype=float),
        max_steps=np.asarray(max_steps),
        reductions=requested.reductions,
        sections={name: section.state_recorder for name, section in sections.items()},
        impacts={n: ImpactRecorder(table.joint, table.window()) for n, table in tables.items()},
        saves=saves,
        capacity=capacity,
        channels=channels,
        tables=logs,
    )


def _lane_tasks(
    lanes: Lanes, end_time: EndTime, start_time: float, settings: Settings, save: Saving
) -> Task:
    """Return the data of all lanes, after checks of their end times and their times to save at."""
    count = len(jax.tree.leaves(lanes.states)[0])
    # Scenes of single lanes are slow to make: only the user's functions of a scene need them.
    is_by_scene = callable(end_time) or callable(save.times)
    scenes = [lanes.of(k)[0] for k in range(count)] if is_by_scene else [lanes.scene] * count
    if callable(end_time):
        ends = np.asarray(as_number([end_time(scene) for scene in scenes], "end_time", "s"))
        require(ends.ndim == 1, "end_time", ends[:1], "a single number", "return one time in s")
    else:
        require_shape("end_time", end_time, (), "pass one time in s")
        ends = np.full(count, end_time, dtype=float)
    wrong = ends[~(np.isfinite(ends) & (ends > start_time))]
    expected = f"finite and after start_time = {start_time}"
    require(not wrong.size, "end_time", wrong[:1], expected, "give times in s")
    check_span(start_time, float(ends.min()))  # the shortest run must not be too short
    first_steps = np.full(count, settings.length_of_first_step(start_time, ends), dtype=float)
    times = None
    if save.times is not None:
        spans = zip(scenes, ends.tolist(), strict=True)
        rows = [np.asarray(save.times_between(scene, start_time, end)) for scene, end in spans]
        counts = sorted({len(row) for row in rows})
        expected, remedy = "equally many in all lanes", "evaluate quantities at equally many"
        require(len(counts) == 1, "times", counts, expected, remedy)
        times = np.stack(rows)
    return Task(lanes.scenes, lanes.states, ends, first_steps, times)


def _warn_of_failures(
    results: "xr.Dataset", lanes: Lanes, start_time: float, coordinates: AbstractCoordinates
) -> None:
    names = {number: name for name, number in result_numbers().items()}
    codes = results[RESULT].values
    counts = Counter(names[int(code)] for code in codes[codes != PENDING])
    del counts["successful"]
    pending, texts = np.count_nonzero(codes == PENDING), []
    if counts:
        failed = ", ".join(f"{count} {name}" for name, count in counts.items())
        texts.append(f"{counts.total()} of {codes.size} lanes failed: {failed}.")
    if lanes.bad:
        texts.append("Lane {}: {}".format(*next(iter(lanes.bad.items()))))
    unassembled = np.flatnonzero(codes.ravel() == result_number(RESULTS.not_assembled))
    if unassembled.size:
        lane = int(unassembled[0])
        # The lane has only its result code: the error of these checks says what is violated.
        try:
            with quiet():
                check_structure(*lanes.of(lane), start_time, coordinates)
        except ValueError as error:
            texts.append(
                f"Lane {lane}: {error} In a sweep, an axis changes the initial state along with "
                "the scene by cj.Axis.change(make, values), where make(scene, state, value) sets "
                "the value by cj.set_value and returns (scene, cj.assemble(scene, state))."
            )
    if pending:
        remedy = "sweep again with the same arguments"
        texts.append(f"{pending} of {codes.size} lanes are pending: {remedy}.")
    if texts:
        warn_the_user(" ".join(texts))


def _warn_of_journals_outside(results: "xr.Dataset", lanes: Lanes) -> None:
    # The final states of all lanes, as arrays (lanes, bodies, components). They are NaN for lanes
    # that were not run, which the comparison with zero leaves out.
    parts = (results[f"final_{part}"] for part in STATE_PARTS)
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
