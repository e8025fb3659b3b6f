"""Division of a sweep into data shared by its lanes, data of each lane, and digests for a store."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import jax
import numpy as np

from ..dynamics.assembly import ACCEPTED_VIOLATION, require_certain, require_freedom
from ..dynamics.constraint_report import dependent, start_rows_of_lanes
from ..dynamics.coordinates import AbstractCoordinates
from ..fields.checks import require
from ..math.vectors import fold_constants
from ..model.scene import Scene
from ..simulation.lanes.lane import Plan, impact_log
from ..simulation.lanes.tasks import Common, Task
from ..simulation.reductions.base import AbstractReduction
from ..simulation.run.impact_recorder import ImpactRecorder
from ..simulation.run.sections import Section
from ..simulation.step.dense_output import require_dense
from ..simulation.step.method import Scheme
from ..simulation.step.settings import Settings
from ..simulation.step.spans import check_span, checked_times
from .axes import Axis, Lanes, variable_leaves
from .outputs import AnySaved, ImpactTable, Output
from .store.identity import Identity, row_digests, run_digests
from .store.program import RUN, programs


def checked_starts(
    lanes: Lanes, start_time: float, coordinates: AbstractCoordinates
) -> tuple[Lanes, bool]:
    """Check the constraints of each lane at the start, as `simulate` does.

    **Arguments:** `start_time`: s; `coordinates`: the solver's choice of coordinates.

    **Returns:** the lanes, and whether any lane has redundant constraints. Lanes with nearly
    redundant constraints, whose rank is uncertain, are marked as bad.

    **Raises:** `ValueError` if the mechanism has no degree of freedom.
    """
    require_freedom(lanes.scene, lanes.of(0)[1], coordinates)
    rows = start_rows_of_lanes(lanes.scene, lanes.scenes, lanes.states, start_time, coordinates)
    bad, redundant = dict(lanes.bad), False
    known: dict[bytes, np.ndarray] = {}
    # The runs of lanes that violate their constraints end with the result code not_assembled.
    residuals = np.concatenate([rows.values, rows.rates], axis=1)
    for lane in np.flatnonzero((np.abs(residuals) <= ACCEPTED_VIOLATION).all(axis=1)).tolist():
        if lane in bad:
            continue
        dependent_rows, uncertain = dependent(rows.names, rows.left[lane], known)
        try:
            require_certain(uncertain)
            redundant = redundant or bool(dependent_rows)
        except ValueError as error:
            bad[lane] = str(error)
    return replace(lanes, bad=dict(sorted(bad.items()))), redundant


def common_values(
    lanes: Lanes, scheme: Scheme, outputs: Mapping[str, Output], start_time: float, max_steps: int
) -> Common:
    """Return the data that all lanes share: the constant scene, settings of the run, and outputs.

    **Raises:** `ValueError` if outputs need a dense output that the solver lacks.
    """
    saved, _ = _saved_output(outputs)
    sections = {name: o for name, o in outputs.items() if isinstance(o, Section)}
    recorded = {name: o for name, o in outputs.items() if isinstance(o, AnySaved | Section)}
    tables = {name: o for name, o in outputs.items() if isinstance(o, ImpactTable)}
    if recorded or tables:
        require_dense(scheme.method.solver)
    plan = Plan(
        scheme,
        {name: o for name, o in outputs.items() if isinstance(o, AbstractReduction)},
        {name: section.state_recorder for name, section in sections.items()},
        bool(saved),
        np.asarray(max_steps),
        {name: ImpactRecorder(table.joint, table.window()) for name, table in tables.items()},
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
    capacity |= {log: tables[name].count for name, contacts in logs.items() for log in contacts}
    # Numbers that lanes share may be folded into the program; varied ones must stay arguments.
    folded_scene = fold_constants(lanes.scene, lanes.varied)
    start = np.asarray(start_time, dtype=float)
    return Common(plan, folded_scene, start, capacity, channels, saved, tables=logs)


def lane_tasks(
    lanes: Lanes,
    end_time: float | Callable[[Scene], float],
    start_time: float,
    settings: Settings,
    outputs: Mapping[str, Output],
) -> Task:
    """Return the data of all lanes: scenes, states, end times, first steps, and times to save at.

    Times are in s. `end_time` is a number or a function of the lane's scene.
    """
    _, saved = _saved_output(outputs)
    count = len(jax.tree.leaves(lanes.states)[0])
    # Scenes of single lanes are slow to make: only the user's functions of a scene need them.
    scenes = [lanes.of(k)[0] for k in range(count)] if callable(end_time) or saved else []
    ends = _ends(end_time, scenes, count, start_time)
    first_steps = np.full(count, settings.length_of_first_step(start_time, ends), dtype=float)
    times = _save_times(saved, scenes, start_time, ends)
    return Task(lanes.scenes, lanes.states, ends, first_steps, times)


def _ends(
    end_time: float | Callable[[Scene], float],
    scenes: Sequence[Scene],
    count: int,
    start_time: float,
) -> np.ndarray:
    """Return the end time of each lane, (lanes,) s.

    `scenes`: scene of each lane, for an `end_time` that is a function; else they are not used.

    **Raises:** `ValueError` for ends that are not finite or not after the start.
    """
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
    check_span(start_time, float(ends.min()))
    return ends


def _save_times(
    saved: AnySaved | None, scenes: Sequence[Scene], start_time: float, ends: np.ndarray
) -> np.ndarray | None:
    """Return the times at which each lane is saved, (lanes, K) s; ``None`` without an output to
    save.

    **Raises:** `ValueError` for times outside the run, or another number of times in some lanes.
    """
    if saved is None:
        return None
    rows = [saved.at(scene) for scene in scenes]
    counts = sorted({len(row) for row in rows})
    require(len(counts) == 1, "times", counts, "equally many in all lanes", "repeat the last one")
    spans = zip(rows, ends, strict=True)
    return np.stack([checked_times(start_time, end, row, "times") for row, end in spans])


def _saved_output(outputs: Mapping[str, Output]) -> tuple[str, AnySaved | None]:
    """Return the name and the output of the one `AnySaved`; "" and ``None`` if there is
    none."""
    saved = ((name, o) for name, o in outputs.items() if isinstance(o, AnySaved))
    return next(saved, ("", None))


def program_tracer(
    common: Common, axes: Mapping[str, Axis], lanes: Lanes
) -> Callable[[], dict[str, str]]:
    """Return a function that traces the lanes' programs in the process that calls the function.

    The function returns digests of the programs by name. Worker processes compare them with the
    digests of the process that made the sweep.
    """
    # All leaves that the axes can change are arguments of the program, even if they are equal in
    # all present lanes: more values on an axis must not change the digests.
    folded_scene = fold_constants(lanes.scene, variable_leaves(lanes, axes))
    start_time = float(common.start_time)
    return partial(programs, common.plan, folded_scene, lanes.state, start_time, common.channels)


def identity(of_programs: Mapping[str, str], common: Common, lanes: Lanes, tasks: Task) -> Identity:
    """Return the digests of programs and of lanes by which a store recognises the sweep.

    **Arguments:** `of_programs`: digests of the programs by name.
    """
    digests = {RUN: run_digests(lanes, tasks)}
    if tasks.save_at is not None:
        digests[common.saved] = row_digests([tasks.save_at])
    return Identity(of_programs, digests)
