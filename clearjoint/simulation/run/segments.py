"""Segments of a run: the compiled loop of steps, with its recorders.

A segment ends at the end time, after the last time to save at, after a number of attempts, at a
failure, or when a buffer of rows is full. Python then empties the buffers, shows progress and
starts the next segment.
"""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ...dynamics.system import System
from ...math.vectors import Condition, ConstantFolded, Scalar
from ...model.bodies import State
from ..reductions.reductions import AbstractReduction
from ..step.dense_output import Snapshot, look_inside
from ..step.loops import PLAIN, AbstractLoops
from ..step.method import Scheme
from ..step.step_state import Attempt, Method, Step, choose
from ..step.stepping import blank_attempt, running
from ..step.types import Numbers
from .advance import Recorder, StepOutcome, advance, latest_attempt
from .impact_recorder import ImpactRecord, ImpactRecorder, ImpactRow
from .row_buffer import RowBuffer
from .run_ends import begin_run, named, state_of
from .sections import SectionRecord, SectionRecorder, after_sections


class TimedState(eqx.Module):
    """A time in s and the state at that time, in scalar form, with alike elements in groups."""

    t: Numbers
    state: State


class ReductionRecord(eqx.Module):
    """A reduction and its tally, the data it carries, after the latest accepted step."""

    reduction: AbstractReduction
    tally: PyTree

    def after(self, step_outcome: StepOutcome) -> "ReductionRecord":
        """Return the record after a step was tried: updated if the step was accepted."""
        updated = self.reduction.update(self.tally, step_outcome.now)
        return ReductionRecord(self.reduction, choose(step_outcome.kept, updated, self.tally))


class Progress(eqx.Module):
    """A run between two segments.

    - `step`: the complete state after the latest attempt.
    - `last`: the latest accepted attempt, for states inside it; ``None`` unless states are saved.
    - `record`: states after the accepted steps since the buffer was emptied, or ``None``.
    - `impacts`: contacts that finished since the buffers were emptied, or ``None``.
    - `sections`, `reductions`: records of the whole run so far, by name.
    """

    step: Step
    last: Attempt | None
    record: RowBuffer[TimedState] | None
    impacts: ImpactRecord | None
    sections: dict[str, SectionRecord]
    reductions: dict[str, ReductionRecord]


class SavedStates(eqx.Module):
    """States at the N times to save at of a segment.

    `states`: in scalar form with N in front; `reached`: (N,), whether the run reached each time.
    """

    states: State
    reached: jax.Array


def begin(
    scheme: Scheme,
    folded_scene: ConstantFolded,
    state: State,
    t0: Scalar,
    t_end: Scalar,
    first_step: Scalar,
    saves: bool,
    record_rows: int | None,
    impact_rows: int | None = None,
    sections: dict[str, SectionRecorder] | None = None,
    reductions: dict[str, AbstractReduction] | None = None,
) -> Progress:
    """Return the run before its first step.

    **Arguments:**

    - `scheme`: integration method and formulation of the equations of motion.
    - `folded_scene`, `state`: scene and initial state, in packed form.
    - `t0`, `t_end`, `first_step`: s, start, end and length of the first step, as arrays.
    - `saves`: whether states will be saved at given times.
    - `record_rows`, `impact_rows`: number of rows of the buffer of accepted steps, and of the
      buffer of each contact's impacts; ``None`` to record none.
    - `sections`, `reductions`: recorders of crossings, and reductions, by name.
    """
    method, system = scheme.method, scheme.unpacked(folded_scene)
    step = begin_run(method, system, state, t0, t_end, first_step)
    last = record = impacts = None
    if saves:
        last = blank_attempt(method, system, step, t_end)
    if record_rows is not None:
        row = _row(system, step)
        record = RowBuffer.like(row, record_rows).with_row(row, True)
    crossings = {name: of.start(system, step) for name, of in (sections or {}).items()}
    now = Snapshot(step.t, step.y, step.entry_speeds).instant(system)
    if impact_rows is not None:
        empty = RowBuffer.like(ImpactRow.none(), impact_rows)
        impacts = ImpactRecorder().start(method, system, step, empty)
    tallies = {name: ReductionRecord(of, of.start(now)) for name, of in (reductions or {}).items()}
    # A loop's result has no weak types: with them the next segment would compile anew.
    return jax.tree.map(
        lambda leaf: jnp.asarray(leaf, dtype=jnp.result_type(leaf)),
        Progress(step, last, record, impacts, crossings, tallies),
    )


def segment(
    scheme: Scheme,
    folded_scene: ConstantFolded,
    progress: Progress,
    save_times: Numbers | None,
    t_end: Scalar,
    attempts: Scalar,
    loops: AbstractLoops = PLAIN,
) -> tuple[Progress, SavedStates | None]:
    """Continue a run until its end, a failure, the limit of attempts, a full buffer, or the last
    time to save at, whichever comes first.

    **Arguments:** `save_times`: (N,) s, rising, times to save at, or ``None``; `t_end`: s, end of
    the run; `attempts`: largest number of attempts since the start of the run; `loops`: the kind
    of loops, which depends on how the run is differentiated.

    **Returns:** the run after the segment, and the states at the N times; ``None`` without times.
    """
    method, system = scheme.method, scheme.unpacked(folded_scene)
    if save_times is None:
        return _run(method, system, progress, t_end, t_end, attempts, loops), None

    def save_next(now: Progress, time: Scalar) -> tuple[Progress, SavedStates]:
        # Steps go past the save time and are not cut there: saving must not change the motion.
        now = _run(method, system, now, time, t_end, attempts, loops)
        assert now.last is not None
        state = state_of(system, *look_inside(method, system, now.last, time))
        return now, SavedStates(named(state), jnp.asarray(time <= now.step.t))

    return loops.each(save_next, progress, save_times)


def emptied(progress: Progress) -> Progress:
    """Return the run with empty buffers of steps and impacts, after Python has read their rows."""
    record, impacts = jax.tree.map(
        lambda part: part.emptied() if isinstance(part, RowBuffer) else part,
        (progress.record, progress.impacts),
        is_leaf=_is_buffer,
    )
    return replace(progress, record=record, impacts=impacts)


def _run(
    method: Method,
    system: System,
    progress: Progress,
    stop: Scalar,
    t_end: Scalar,
    attempts: Scalar,
    loops: AbstractLoops,
) -> Progress:
    """Return the run after steps up to the first that ends at or after `stop`, s.

    The steps end earlier at a failure, after `attempts` attempts since the start of the run, and
    when a buffer is full. No step goes past `t_end`, s.
    """

    def goes(now: Progress) -> Condition:
        more = (now.step.t < stop) & running(now.step, t_end, attempts)
        for part in jax.tree.leaves((now.record, now.impacts), is_leaf=_is_buffer):
            if isinstance(part, RowBuffer):
                more = more & jnp.logical_not(part.is_full())
        return more

    def go(now: Progress) -> Progress:
        records = {
            "last": now.last,
            "record": now.record,
            "impacts": now.impacts,
            "sections": now.sections,
            "reductions": now.reductions,
        }
        requested = {name: record for name, record in records.items() if record is not None}
        step, requested = advance(
            method, system, now.step, t_end, requested, RECORDERS, attempt=loops.attempt
        )
        return Progress(step, **{**records, **requested})

    return loops.repeat(goes, go, progress)


def _is_buffer(tree: object) -> bool:
    return isinstance(tree, RowBuffer)


def _with_step(record: RowBuffer[TimedState], step_outcome: StepOutcome) -> RowBuffer[TimedState]:
    """Return the buffer with the state after the step that was tried, if it was accepted."""
    return record.with_row(
        _row(step_outcome.system, step_outcome.tried.step), step_outcome.tried.kept
    )


def _reduced(
    records: dict[str, ReductionRecord], step_outcome: StepOutcome
) -> dict[str, ReductionRecord]:
    """Return the updated records of reductions, by name, after a step was tried."""
    return {name: record.after(step_outcome) for name, record in records.items()}


RECORDERS: dict[str, Recorder] = {
    "last": latest_attempt,
    "record": _with_step,
    "impacts": ImpactRecorder().after,
    "sections": after_sections,
    "reductions": _reduced,
}


def _row(system: System, step: Step) -> TimedState:
    return TimedState(step.t, state_of(system, step.y, step.entry_speeds))
