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
from .vectors import Scalar, pack, unpack


BLOCK_ROWS = 64


class Saved(eqx.Module):
    """States at requested times; `count` of them are there."""

    times: Any
    states: Any
    count: Any


class Record(eqx.Module):
    """Accepted steps: `count` rows are filled.

    The inner loop writes into a small `block`, since a native loop copies its buffers at every
    step; the outer loop moves full blocks into the large one.
    """

    times: Any
    states: Any
    count: Any
    block_times: Any
    block_states: Any
    block_count: Any


class Progress(eqx.Module):
    """A run between two segments. `last` is the latest accepted step, kept while states are still
    to be saved; `saved` and `record` are ``None`` where nothing was asked for."""

    step: Step
    last: Attempt | None
    saved: Saved | None
    record: Record | None


def begin(
    method: Method, scene: Scene, state: State, t0: Any, t_end: Any, first_step: Any,
    save_times: Any | None, record_rows: int | None,
) -> Progress:
    """The run before its first step. Numbers are arrays, the scene and state in packed form."""
    scene = unpack(scene)
    bodies = method.formulation.coordinates.encode(scene, unpack(state.bodies))
    y = Variables(bodies, state.work if method.formulation.ledger else {})
    step = start(method, scene, t0, t_end, first_step, y, state.memory)
    row = _row(method, scene, step.y, step.memory)
    last = saved = record = None
    if save_times is not None:
        shapes = jax.eval_shape(lambda: attempt(method, scene, step, t_end))
        last = eqx.tree_at(lambda a: a.step, _zeros(shapes), step)
        saved = Saved(save_times, _buffer(row, save_times.shape[0]), jnp.zeros((), int))
    if record_rows is not None:
        record = _new_record(row, record_rows)
        record = _recorded(record, t0, row, True)
    return Progress(step, last, saved, record)


def segment(
    method: Method, scene: Scene, progress: Progress, t_end: Any, attempts: Any
) -> Progress:
    """Go on until the end time, a failure, `attempts` in all, or a full record."""
    scene = unpack(scene)
    if progress.saved is None and progress.record is None:
        return _run(method, scene, progress, t_end, t_end, attempts)

    def goes(now: Progress) -> Scalar:
        return _due(now) | (_running(now, t_end, attempts) & _has_room(now.record))

    def go(now: Progress) -> Progress:
        now = _run(method, scene, now, _next_save(now, t_end), t_end, attempts)
        if now.saved is not None:
            now = _save(method, scene, now)
        if now.record is not None:
            now = eqx.tree_at(lambda p: p.record, now, _flushed(now.record))
        return now

    return jax.lax.while_loop(goes, go, progress)


def rewound(progress: Progress) -> Progress:
    """The run with an empty record, after the host has taken the rows."""
    assert progress.record is not None
    return eqx.tree_at(lambda p: p.record.count, progress, jnp.zeros((), int))


def _running(now: Progress, t_end: Any, attempts: Any) -> Scalar:
    goes = running(now.step, t_end, attempts)
    if now.record is not None:
        goes = goes & (now.record.block_count < BLOCK_ROWS)
    return goes


def _has_room(record: Record | None) -> Any:
    return True if record is None else record.count + 2 * BLOCK_ROWS <= record.times.shape[0]


def _next_index(saved: Saved) -> Any:
    return jnp.minimum(saved.count, saved.times.shape[0] - 1)


def _next_save(now: Progress, t_end: Any) -> Any:
    if now.saved is None:
        return t_end
    left = now.saved.count < now.saved.times.shape[0]
    return jnp.where(left, now.saved.times[_next_index(now.saved)], t_end)


def _due(now: Progress) -> Scalar:
    """Whether the next time to save is already behind."""
    if now.saved is None:
        return jnp.asarray(False)
    left = now.saved.count < now.saved.times.shape[0]
    return left & (now.saved.times[_next_index(now.saved)] <= now.step.t)


def _run(
    method: Method, scene: Scene, progress: Progress, stop: Any, t_end: Any, attempts: Any
) -> Progress:
    """The inner loop: steps until one passes `stop`; none but the last is cut at `t_end`."""

    def goes(now: Progress) -> Scalar:
        return (now.step.t < stop) & _running(now, t_end, attempts)

    def go(now: Progress) -> Progress:
        tried = attempt(method, scene, now.step, t_end)
        last = now.last
        if last is not None:
            last = jax.tree.map(lambda a, b: jnp.where(tried.kept, a, b), tried, last)
        record = now.record
        if record is not None:
            row = _row(method, scene, tried.step.y, tried.step.memory)
            record = _recorded(record, tried.step.t, row, tried.kept)
        return Progress(tried.step, last, now.saved, record)

    return jax.lax.while_loop(goes, go, progress)


def _save(method: Method, scene: Scene, now: Progress) -> Progress:
    """Write the state at the next requested time, if it has been reached."""
    assert now.saved is not None and now.last is not None
    saved, due, index = now.saved, _due(now), _next_index(now.saved)
    y, memory = look_inside(method, scene, now.last, saved.times[index])
    row = _row(method, scene, y, memory)
    old = jax.tree.map(lambda buffer: buffer[index], saved.states)
    row = jax.tree.map(lambda new, was: jnp.where(due, new, was), row, old)
    states = _written(saved.states, row, index)
    return Progress(now.step, now.last, Saved(saved.times, states, saved.count + due), now.record)


def _new_record(row: Any, rows: int) -> Record:
    none = jnp.zeros((), int)
    return Record(
        jnp.zeros(rows), _buffer(row, rows), none,
        jnp.zeros(BLOCK_ROWS), _buffer(row, BLOCK_ROWS), none,
    )


def _recorded(record: Record, t: Any, row: Any, kept: Any) -> Record:
    index = record.block_count
    return Record(
        record.times, record.states, record.count,
        _written(record.block_times, t, index), _written(record.block_states, row, index),
        index + kept,
    )


def _flushed(record: Record) -> Record:
    """The block moved behind the rows that are there; what is not filled is overwritten later."""
    states = jax.tree.map(
        lambda b, block: jax.lax.dynamic_update_slice_in_dim(b, block, record.count, 0),
        record.states, record.block_states,
    )
    times = jax.lax.dynamic_update_slice_in_dim(
        record.times, record.block_times, record.count, 0
    )
    return Record(
        times, states, record.count + record.block_count,
        record.block_times, record.block_states, jnp.zeros((), int),
    )


def _row(method: Method, scene: Scene, y: Variables, memory: Any) -> State:
    bodies = method.formulation.coordinates.decode(scene, y.motion)
    return State(bodies, memory, y.work)


def _zeros(shapes: Any) -> Any:
    return jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes)


def _buffer(row: Any, length: int) -> Any:
    return jax.tree.map(lambda leaf: jnp.zeros((length, *jnp.shape(leaf))), row)


def _written(buffer: Any, row: Any, index: Any) -> Any:
    return jax.tree.map(
        lambda b, leaf: jax.lax.dynamic_update_index_in_dim(b, leaf, index, 0), buffer, row
    )
