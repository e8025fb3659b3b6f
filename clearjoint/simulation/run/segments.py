"""Runs of many steps: the native inner loop, and round it the loops that save and record.

A segment ends at the end time, after a number of attempts, at a failure, or when its record of
accepted steps is full. The host then takes what was recorded, shows progress and goes on.
"""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
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
from .run_ends import begin_run, named, state_of
from .sections import SectionRecord, SectionRecorder, after_sections

BLOCK_ROWS = 64


class GrowingTable(eqx.Module):
    """A table that grows by rows.

    A loop copies the buffers it writes into at every turn, so rows go into a small `block` first,
    and full blocks into the large `table`.
    """

    table: PyTree
    count: Scalar
    block: PyTree
    block_count: Scalar

    @staticmethod
    def like(row: PyTree, length: int) -> "GrowingTable":
        """An empty table with room for `length` rows like the given one."""
        none = np.zeros((), int)
        return GrowingTable(_buffer(row, length), none, _buffer(row, BLOCK_ROWS), none)

    def with_row(self, row: PyTree, kept: Scalar) -> "GrowingTable":
        """The row written behind the last one, and counted if it is to be kept."""
        block = jax.tree.map(
            lambda b, leaf: jax.lax.dynamic_update_index_in_dim(b, leaf, self.block_count, 0),
            self.block,
            row,
        )
        return GrowingTable(self.table, self.count, block, self.block_count + kept)

    def flushed(self) -> "GrowingTable":
        """The block moved into the table; what of it is not filled is overwritten later."""
        table = jax.tree.map(
            lambda b, block: jax.lax.dynamic_update_slice_in_dim(b, block, self.count, 0),
            self.table,
            self.block,
        )
        return GrowingTable(table, self.count + self.block_count, self.block, jnp.zeros((), int))

    def block_is_full(self) -> Condition:
        """Whether the block must be moved before another row is written."""
        return self.block_count >= BLOCK_ROWS

    def has_room(self) -> Condition:
        """Whether another full block fits into the table."""
        length = jax.tree.leaves(self.table)[0].shape[0]
        return self.count + BLOCK_ROWS <= length


class TimedState(eqx.Module):
    """A time and the state there, under the names of the condensed scene."""

    t: Numbers
    state: State


class ReductionRecord(eqx.Module):
    """A reduction, and its tally where a run is."""

    reduction: AbstractReduction
    tally: PyTree

    def after(self, step_outcome: StepOutcome) -> "ReductionRecord":
        """The record after a stride."""
        updated = self.reduction.update(self.tally, step_outcome.now)
        return ReductionRecord(self.reduction, choose(step_outcome.kept, updated, self.tally))


class Progress(eqx.Module):
    """A run between two segments.

    `last` is the latest accepted step, kept if states are to be saved; `record` holds the accepted
    steps, if they are asked for. Both are ``None`` otherwise. `sections` holds crossings, and
    `reductions` what is reduced, by name.
    """

    step: Step
    last: Attempt | None
    record: GrowingTable | None
    sections: dict[str, SectionRecord]
    reductions: dict[str, ReductionRecord]


class SavedStates(eqx.Module):
    """States at the times of a segment, and which of these times were reached."""

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
    sections: dict[str, SectionRecorder] | None = None,
    reductions: dict[str, AbstractReduction] | None = None,
) -> Progress:
    """The run before its first step. Numbers are arrays, scene and state in packed form."""
    method, system = scheme.method, scheme.unpacked(folded_scene)
    step = begin_run(method, system, state, t0, t_end, first_step)
    last = record = None
    if saves:
        last = blank_attempt(method, system, step, t_end)
    if record_rows is not None:
        row = _row(system, step)
        record = GrowingTable.like(row, record_rows).with_row(row, 1)
    crossings = {name: of.start(system, step) for name, of in (sections or {}).items()}
    now = Snapshot(step.t, step.y, step.entry_speeds).instant(system)
    tallies = {name: ReductionRecord(of, of.start(now)) for name, of in (reductions or {}).items()}
    # A loop's result has no weak types: with them the next segment would compile anew.
    return jax.tree.map(
        lambda leaf: jnp.asarray(leaf, dtype=jnp.result_type(leaf)),
        Progress(step, last, record, crossings, tallies),
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
    """Go on until the end time, a failure, `attempts` in all, a full record, or the last of the
    times to save at (rising), whichever comes first."""
    method, system = scheme.method, scheme.unpacked(folded_scene)
    if save_times is None:
        return _run_and_record(method, system, progress, t_end, t_end, attempts, loops), None

    def save_next(now: Progress, time: Scalar) -> tuple[Progress, SavedStates]:
        now = _run_and_record(method, system, now, time, t_end, attempts, loops)
        assert now.last is not None
        state = state_of(system, *look_inside(method, system, now.last, time))
        return now, SavedStates(named(state), jnp.asarray(time <= now.step.t))

    return loops.each(save_next, progress, save_times)


def rewound(progress: Progress) -> Progress:
    """The run with an empty record, after the host has taken the rows."""
    none = np.zeros((), int)
    assert progress.record is not None
    return replace(progress, record=replace(progress.record, count=none, block_count=none))


def _run_and_record(
    method: Method,
    system: System,
    progress: Progress,
    stop: Scalar,
    t_end: Scalar,
    attempts: Scalar,
    loops: AbstractLoops,
) -> Progress:
    """Steps until one passes `stop`, emptying the record's block whenever it is full."""
    if progress.record is None:
        return _run(method, system, progress, stop, t_end, attempts, loops)

    def goes(now: Progress) -> Condition:
        assert now.record is not None
        return _running(now, stop, t_end, attempts) & now.record.has_room()

    def go(now: Progress) -> Progress:
        now = _run(method, system, now, stop, t_end, attempts, loops)
        assert now.record is not None
        record = jax.lax.cond(
            now.record.block_is_full(), lambda rows: rows.flushed(), lambda rows: rows, now.record
        )
        return Progress(now.step, now.last, record, now.sections, now.reductions)

    return jax.lax.while_loop(goes, go, progress)


def _running(now: Progress, stop: Scalar, t_end: Scalar, attempts: Scalar) -> Condition:
    return (now.step.t < stop) & running(now.step, t_end, attempts)


def _run(
    method: Method,
    system: System,
    progress: Progress,
    stop: Scalar,
    t_end: Scalar,
    attempts: Scalar,
    loops: AbstractLoops,
) -> Progress:
    """The inner loop: steps until one passes `stop`; none but the last is cut, at `t_end`."""

    def goes(now: Progress) -> Condition:
        more = _running(now, stop, t_end, attempts)
        return more if now.record is None else more & jnp.logical_not(now.record.block_is_full())

    def go(now: Progress) -> Progress:
        records = {"last": now.last, "record": now.record}
        records |= {"sections": now.sections, "reductions": now.reductions}
        records = {name: record for name, record in records.items() if record is not None}
        step, records = advance(
            method, system, now.step, t_end, records, RECORDERS, attempt=loops.attempt
        )
        kept = records.get("last"), records.get("record")
        return Progress(step, *kept, records["sections"], records["reductions"])

    return loops.repeat(goes, go, progress)


def _with_step(record: GrowingTable, step_outcome: StepOutcome) -> GrowingTable:
    """The record with the step of the stride, if that was accepted."""
    return record.with_row(
        _row(step_outcome.system, step_outcome.tried.step), step_outcome.tried.kept
    )


def _reduced(
    records: dict[str, ReductionRecord], step_outcome: StepOutcome
) -> dict[str, ReductionRecord]:
    """The records of reductions after a stride, by name."""
    return {name: record.after(step_outcome) for name, record in records.items()}


RECORDERS: dict[str, Recorder] = {
    "last": latest_attempt,
    "record": _with_step,
    "sections": after_sections,
    "reductions": _reduced,
}


def _row(system: System, step: Step) -> TimedState:
    return TimedState(step.t, state_of(system, step.y, step.entry_speeds))


def _buffer(row: PyTree, length: int) -> PyTree:
    return jax.tree.map(lambda leaf: jnp.zeros((length, *jnp.shape(leaf))), row)
