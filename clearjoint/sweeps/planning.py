"""Division of a sweep into the data that all lanes share and the data of each lane."""

from collections.abc import Callable, Mapping
from dataclasses import replace

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
from ..simulation.reductions.reductions import AbstractReduction
from ..simulation.run.impact_recorder import ImpactRecorder
from ..simulation.run.sections import Section
from ..simulation.step.dense_output import require_dense
from ..simulation.step.method import Scheme
from ..simulation.step.settings import Settings
from ..simulation.step.spans import check_span, checked_times
from .axes import Lanes
from .outputs import AnySaved, ImpactTable, Output


def checked_starts(
    lanes: Lanes, start_time: float, coordinates: AbstractCoordinates
) -> tuple[Lanes, bool]:
    """Check the constraints of each lane at the start, as `simulate` does.

    **Arguments:** `start_time`: s; `coordinates`: coordinates that the solver uses.

    **Returns:** the lanes, and whether any lane has redundant constraints. A lane whose constraints
    are nearly redundant, so that their rank is uncertain, is added to `Lanes.bad`.

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

    **Arguments:** `scheme`: method of the integration; `outputs`: outputs by name; `start_time`: s;
    `max_steps`: largest number of steps of a lane.

    **Raises:** `ValueError` if outputs need a dense output that the solver lacks.
    """
    saved = next((name for name, o in outputs.items() if isinstance(o, AnySaved)), "")
    sections = {name: o for name, o in outputs.items() if isinstance(o, Section)}
    recorded = {name: o for name, o in outputs.items() if isinstance(o, AnySaved | Section)}
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

    **Arguments:** `end_time`: s, a number or a function of the lane's scene; `start_time`: s;
    `settings`: settings of the integration; `outputs`: outputs by name.

    **Raises:** `ValueError` for ends that are not finite or not after the start, for times to save
    at that are outside of the run, and for different numbers of these times.
    """
    saved = next((output for output in outputs.values() if isinstance(output, AnySaved)), None)
    count = len(jax.tree.leaves(lanes.states)[0])
    # Scenes of single lanes are slow to make: only the user's functions of a scene need them.
    scenes = [lanes.of(k)[0] for k in range(count)] if callable(end_time) or saved else []
    given = [end_time(s) for s in scenes] if callable(end_time) else [end_time] * count
    ends = np.asarray(given, dtype=float)
    wrong = ends[~(np.isfinite(ends) & (ends > start_time))]
    expected = f"finite and after start_time = {start_time}"
    require(not wrong.size, "end_time", wrong[:1], expected, "give times in s")
    check_span(start_time, float(ends.min()))
    first_steps = np.full(count, settings.length_of_first_step(start_time, ends), dtype=float)
    times = None
    if saved is not None:
        rows = [saved.at(scene) for scene in scenes]
        counts = sorted({len(row) for row in rows})
        expected = "equally many in all lanes"
        require(len(counts) == 1, "times", counts, expected, "repeat the last one")
        spans = zip(rows, ends, strict=True)
        times = np.stack([checked_times(start_time, end, row, "times") for row, end in spans])
    return Task(lanes.scenes, lanes.states, ends, first_steps, times)
