"""Runs of many steps: the native inner loop, and round it the loops that save and record.

A segment ends at the end time, after a number of attempts, at a failure, or when its record of
accepted steps is full. The host then takes what was recorded, shows progress and goes on.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from .bodies import State
from .scene import Scene
from .stepping import (
    Attempt,
    Method,
    Step,
    Variables,
    attempt,
    look_inside,
    running,
    start,
)
from .vectors import Scalar, unpack

BLOCK_ROWS = 64


class Rows(eqx.Module):
    """A table that grows by rows.

    A loop copies the buffers it writes into at every turn, so rows go into a small `block` first,
    and full blocks into the large `table`.
    """

    table: Any
    count: Any
    block: Any
    block_count: Any

    @staticmethod
    def like(row: Any, length: int) -> "Rows":
        """An empty table with room for `length` rows like the given one."""
        none = jnp.zeros((), int)
        return Rows(_buffer(row, length + BLOCK_ROWS), none, _buffer(row, BLOCK_ROWS), none)

    def with_row(self, row: Any, kept: Any) -> "Rows":
        """The row written behind the last one, and counted if it is to be kept."""
        block = jax.tree.map(
            lambda b, leaf: jax.lax.dynamic_update_index_in_dim(b, leaf, self.block_count, 0),
            self.block,
            row,
        )
        return Rows(self.table, self.count, block, self.block_count + kept)

    def flushed(self) -> "Rows":
        """The block moved into the table; what of it is not filled is overwritten later."""
        table = jax.tree.map(
            lambda b, block: jax.lax.dynamic_update_slice_in_dim(b, block, self.count, 0),
            self.table,
            self.block,
        )
        return Rows(table, self.count + self.block_count, self.block, jnp.zeros((), int))

    def total(self) -> Any:
        """Rows in table and block."""
        return self.count + self.block_count

    def block_is_full(self) -> Any:
        """Whether the block must be moved before another row is written."""
        return self.block_count >= BLOCK_ROWS


class Row(eqx.Module):
    """A time and the state there."""

    t: Any
    state: State


class Saved(eqx.Module):
    """The requested times, and the states saved at the first of them."""

    times: Any
    rows: Rows


class Progress(eqx.Module):
    """A run between two segments.

    `last` is the latest accepted step, kept while states are still to be saved. `saved` and
    `record` (of accepted steps) are ``None`` where nothing was asked for.
    """

    step: Step
    last: Attempt | None
    saved: Saved | None
    record: Rows | None


def begin(
    method: Method,
    scene: Scene,
    state: State,
    t0: Any,
    t_end: Any,
    first_step: Any,
    save_times: Any | None,
    record_rows: int | None,
) -> Progress:
    """The run before its first step. Numbers are arrays, the scene and state in packed form."""
    scene = unpack(scene)
    bodies = method.formulation.coordinates.encode(scene, unpack(state.bodies))
    y = Variables(bodies, state.work if method.formulation.ledger else {})
    step = start(method, scene, t0, t_end, first_step, y, state.memory)
    row = _row(method, scene, step)
    last = saved = record = None
    if save_times is not None:
        shapes = jax.eval_shape(lambda: attempt(method, scene, step, t_end))
        last = eqx.tree_at(lambda a: a.step, _zeros(shapes), step)
        saved = Saved(save_times, Rows.like(row.state, save_times.shape[0]))
    if record_rows is not None:
        record = Rows.like(row, record_rows).with_row(row, 1)
    return _strongly_typed(Progress(step, last, saved, record))


def segment(
    method: Method, scene: Scene, progress: Progress, t_end: Any, attempts: Any
) -> Progress:
    """Go on until the end time, a failure, `attempts` in all, or a full record."""
    scene = unpack(scene)
    if progress.saved is None and progress.record is None:
        return _run(method, scene, progress, t_end, t_end, attempts)

    def goes(now: Progress) -> Scalar:
        return (_due(now) | running(now.step, t_end, attempts)) & _has_room(now.record)

    def goes_without_flush(now: Progress) -> Scalar:
        return goes(now) & ~_must_flush(now)

    def go(now: Progress) -> Progress:
        now = _run(method, scene, now, _next_save(now, t_end), t_end, attempts)
        return now if now.saved is None else _save(method, scene, now)

    def go_and_flush(now: Progress) -> Progress:
        return _flushed(jax.lax.while_loop(goes_without_flush, go, now))

    return jax.lax.while_loop(goes, go_and_flush, progress)


def rewound(progress: Progress) -> Progress:
    """The run with an empty record, after the host has taken the rows."""
    assert progress.record is not None
    return eqx.tree_at(lambda p: p.record.count, progress, jnp.zeros((), int))


def _must_flush(now: Progress) -> Any:
    tables = [now.record, now.saved and now.saved.rows]
    full = [table.block_is_full() for table in tables if table is not None]
    return jnp.any(jnp.stack(full))


def _flushed(now: Progress) -> Progress:
    saved = now.saved and Saved(now.saved.times, now.saved.rows.flushed())
    return Progress(now.step, now.last, saved, now.record and now.record.flushed())


def _has_room(record: Rows | None) -> Any:
    return True if record is None else record.count + BLOCK_ROWS <= _length(record.table.t)


def _length(buffer: Any) -> int:
    return buffer.shape[0] - BLOCK_ROWS


def _next_time(saved: Saved) -> tuple[Any, Any]:
    """Whether a time is left to save at, and which."""
    index = jnp.minimum(saved.rows.total(), saved.times.shape[0] - 1)
    return saved.rows.total() < saved.times.shape[0], saved.times[index]


def _next_save(now: Progress, t_end: Any) -> Any:
    if now.saved is None:
        return t_end
    left, time = _next_time(now.saved)
    return jnp.where(left, time, t_end)


def _due(now: Progress) -> Scalar:
    """Whether the next time to save is already behind."""
    if now.saved is None:
        return jnp.asarray(False)
    left, time = _next_time(now.saved)
    return left & (time <= now.step.t)


def _run(
    method: Method, scene: Scene, progress: Progress, stop: Any, t_end: Any, attempts: Any
) -> Progress:
    """The inner loop: steps until one passes `stop`; none but the last is cut at `t_end`."""

    def goes(now: Progress) -> Scalar:
        more = (now.step.t < stop) & running(now.step, t_end, attempts)
        return more if now.record is None else more & ~now.record.block_is_full()

    def go(now: Progress) -> Progress:
        tried = attempt(method, scene, now.step, t_end)
        last = now.last
        if last is not None:
            last = jax.tree.map(lambda a, b: jnp.where(tried.kept, a, b), tried, last)
        record = now.record
        if record is not None:
            record = record.with_row(_row(method, scene, tried.step), tried.kept)
        return Progress(tried.step, last, now.saved, record)

    return jax.lax.while_loop(goes, go, progress)


def _save(method: Method, scene: Scene, now: Progress) -> Progress:
    """Write the state at the next requested time, if it has been reached."""
    assert now.saved is not None and now.last is not None
    _, time = _next_time(now.saved)
    y, memory = look_inside(method, scene, now.last, time)
    state = _state(method, scene, y, memory)
    saved = Saved(now.saved.times, now.saved.rows.with_row(state, _due(now)))
    return Progress(now.step, now.last, saved, now.record)


def _row(method: Method, scene: Scene, step: Step) -> Row:
    return Row(step.t, _state(method, scene, step.y, step.memory))


def _state(method: Method, scene: Scene, y: Variables, memory: Any) -> State:
    return State(method.formulation.coordinates.decode(scene, y.motion), memory, y.work)


def _zeros(shapes: Any) -> Any:
    return jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes)


def _buffer(row: Any, length: int) -> Any:
    return jax.tree.map(lambda leaf: jnp.zeros((length, *jnp.shape(leaf))), row)


def _strongly_typed(tree: Any) -> Any:
    """No weak types, which a loop's result does not have: the next segment would compile anew."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=jnp.result_type(leaf)), tree)
