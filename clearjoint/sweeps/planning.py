"""What the lanes of a sweep share, what each has for itself, and by what a store knows them."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import jax
import numpy as np

from ..fields.checks import require
from ..math.vectors import fold_constants
from ..model.scene import Scene
from ..simulation.lanes.lane import Plan, impact_log
from ..simulation.lanes.tasks import Common, Task
from ..simulation.reductions.reductions import AbstractReduction
from ..simulation.run.impact_recorder import ImpactRecorder
from ..simulation.run.sections import Section
from ..simulation.step.dense_output import require_dense
from ..simulation.step.method import Scheme
from ..simulation.step.settings import Settings
from ..simulation.step.spans import check_span, checked_times
from .axes import Axis, Lanes, variable_leaves
from .outputs import AbstractSaved, ImpactTable, Output
from .store.identity import Identity, row_digests, run_digests
from .store.program import RUN, programs


def common_values(
    lanes: Lanes, scheme: Scheme, outputs: Mapping[str, Output], start_time: float, max_steps: int
) -> Common:
    """What the lanes share: how they are run, and which outputs they have."""
    saved, _ = _saved_output(outputs)
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
    capacity |= {log: tables[name].count for name, found in logs.items() for log in found}
    folded_scene, start = (
        fold_constants(lanes.scene, lanes.varied),
        np.asarray(start_time, dtype=float),
    )
    return Common(plan, folded_scene, start, capacity, channels, saved, tables=logs)


def lane_tasks(
    lanes: Lanes,
    end_time: float | Callable[[Scene], float],
    start_time: float,
    settings: Settings,
    outputs: Mapping[str, Output],
) -> Task:
    """What each lane has for itself: scene, state, end, first step and times to save at."""
    _, saved = _saved_output(outputs)
    count = len(jax.tree.leaves(lanes.states)[0])
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
    """(lanes,) s, the end of each of `count` lanes.

    **Raises:** `ValueError` for ends that are not finite and after the start.
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


def _saved_output(outputs: Mapping[str, Output]) -> tuple[str, AbstractSaved | None]:
    """The one output that is saved at times, and its name; "" and ``None`` if there is none."""
    found = ((name, o) for name, o in outputs.items() if isinstance(o, AbstractSaved))
    return next(found, ("", None))


def program_tracer(
    common: Common, axes: Mapping[str, Axis], lanes: Lanes
) -> Callable[[], dict[str, str]]:
    """A function that returns digests of the programs that the lanes run, as the process that calls
    it traces them."""
    folded_scene = fold_constants(lanes.scene, variable_leaves(lanes, axes))
    start_time = float(common.start_time)
    return partial(programs, common.plan, folded_scene, lanes.state, start_time, common.channels)


def identity(of_programs: Mapping[str, str], common: Common, lanes: Lanes, tasks: Task) -> Identity:
    """Digests by which a store recognises the sweep."""
    digests = {RUN: run_digests(lanes, tasks)}
    if tasks.save_at is not None:
        digests[common.saved] = row_digests([tasks.save_at])
    return Identity(of_programs, digests)
