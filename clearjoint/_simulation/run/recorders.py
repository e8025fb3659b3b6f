"""Buffers of rows, and the recorders of attempts, of states after each step, and of reductions."""

from dataclasses import replace
from typing import Generic, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree
from typing_extensions import override

from ..._dynamics.system import System
from ..._math.vectors import Condition, Scalar
from ..._model.bodies import State
from ...quantities.base import Instant
from ..reductions.base import AbstractReduction
from ..step.dense_output import DenseStep, Snapshot
from ..step.step_length import largest
from ..step.step_state import Attempt, Step, choose
from ..step.types import Numbers
from .run_loop import AbstractRecorder, RunStart, StepOutcome

R = TypeVar("R", bound=PyTree[Scalar])

ROWS = 64
"""Usual number of rows of a `RowBuffer`; small, since each run of a sweep has its own buffers."""


class RowBuffer(eqx.Module, Generic[R]):
    """A buffer of fixed size for rows, PyTrees of numbers such as finished impacts. Rows without
    room overwrite the last of the `rows`, which is never read; `count` includes them."""

    rows: R
    count: jax.Array

    @staticmethod
    def like(row: R, capacity: int) -> "RowBuffer[R]":
        # Rows for which there is no room are written to one further row: JAX moves an index that
        # is too large to the last one.
        rows = jax.tree.map(lambda leaf: jnp.zeros((capacity + 1, *jnp.shape(leaf))), row)
        return RowBuffer(rows, jnp.zeros((), int))

    @property
    def capacity(self) -> int:
        return jax.tree.leaves(self.rows)[0].shape[0] - 1

    def is_full(self) -> Condition:
        return self.count >= self.capacity

    def with_row(self, row: R, wanted: Condition) -> "RowBuffer[R]":
        """Return the buffer with `row` appended if `wanted`. If there is no room, the row is lost,
        but `count` increases."""

        def with_leaf(rows: jax.Array, leaf: Scalar) -> jax.Array:
            return jax.lax.dynamic_update_index_in_dim(rows, leaf, self.count, 0)

        def write() -> R:
            return jax.tree.map(with_leaf, self.rows, row)

        rows = jax.lax.cond(wanted, write, lambda: self.rows)
        return RowBuffer(rows, self.count + wanted)

    def filled(self) -> R:
        """Return copies of the rows written so far as NumPy arrays."""
        count = min(int(self.count), self.capacity)
        return jax.tree.map(lambda rows: np.array(rows[:count]), jax.device_get(self.rows))

    def emptied(self) -> "RowBuffer[R]":
        return replace(self, count=np.zeros((), int))


class LatestAttempt(AbstractRecorder[Attempt]):
    """Recorder of the latest accepted attempt."""

    @override
    def start(self, start: RunStart) -> Attempt:
        return start.blank_attempt

    @override
    def after(self, record: Attempt, step_outcome: StepOutcome) -> Attempt:
        return choose(step_outcome.accepted, replace(step_outcome.tried, rejected=None), record)


class TangentPeak(NamedTuple):
    """For each of p parameters: `size`, (p,), the largest derivative of any speed at the ends of
    the steps so far; `time`, (p,) s since the start of the run, when it was reached; and
    `positions`, (p,), the largest derivative of any position since then."""

    size: jax.Array
    time: jax.Array
    positions: jax.Array


class TangentPeakRecorder(AbstractRecorder[TangentPeak]):
    """Recorder of the largest derivatives of speeds, which determine `Sampled.amplification`."""

    @override
    def start(self, start: RunStart) -> TangentPeak:
        return self._now(start.loop.system, start.step)

    @override
    def after(self, record: TangentPeak, step_outcome: StepOutcome) -> TangentPeak:
        now = self._now(step_outcome.system, step_outcome.after)
        # A step that was not accepted leaves the state, and thus the record, as it was.
        continued = record._replace(positions=jnp.maximum(record.positions, now.positions))
        # For each parameter, a higher peak replaces all three numbers.
        rises = now.size > record.size
        pairs = zip(now, continued, strict=True)
        return TangentPeak(*(jnp.where(rises, new, old) for new, old in pairs))

    def _now(self, system: System, step: Step) -> TangentPeak:
        assert step.tangents is not None
        motion = step.tangents.y.motion
        # The tangents of speeds alone, with zeros as those of positions, and the other way round.
        zeros = jax.tree.map(jnp.zeros_like, motion)
        size = jnp.asarray(largest(system.with_speeds(zeros, motion)))
        positions = jnp.asarray(largest(system.with_speeds(motion, zeros)))
        return TangentPeak(size, jnp.broadcast_to(step.t, size.shape), positions)


class LatestDenseStep(AbstractRecorder[DenseStep]):
    """Recorder of the latest accepted step of an `UnrolledExplicit` solver, with dense output."""

    @override
    def start(self, start: RunStart) -> DenseStep:
        return DenseStep.of(start.blank_attempt)

    @override
    def after(self, record: DenseStep, step_outcome: StepOutcome) -> DenseStep:
        return choose(step_outcome.accepted, step_outcome.dense_step, record)


class TimedState(eqx.Module):
    """A time `t`, s since `System.origin`, and the `state` then; vectors are separate scalars."""

    t: Numbers
    state: State


class StepRecorder(AbstractRecorder[RowBuffer[TimedState]]):
    """Recorder of the states at the start of a run and after each accepted step. The caller must
    empty the buffer of `capacity` rows when it is full, or further rows are lost."""

    capacity: int = eqx.field(static=True)

    @override
    def start(self, start: RunStart) -> RowBuffer[TimedState]:
        row = _row(start.loop.system, start.step)
        return RowBuffer.like(row, self.capacity).with_row(row, True)

    @override
    def after(
        self, record: RowBuffer[TimedState], step_outcome: StepOutcome
    ) -> RowBuffer[TimedState]:
        return record.with_row(_row(step_outcome.system, step_outcome.after), step_outcome.accepted)


class ReductionRecorder(AbstractRecorder[PyTree]):
    """Recorder of a reduction; its record is the reduction's tally."""

    reduction: AbstractReduction

    @override
    def start(self, start: RunStart) -> PyTree:
        return self.reduction.start(start.now)

    @override
    def after(self, record: PyTree, step_outcome: StepOutcome) -> PyTree:
        tally = self.reduction.update(record, step_outcome.now)
        return choose(step_outcome.accepted, tally, record)

    @override
    def searched(self, now: Instant) -> PyTree[Scalar]:
        return self.reduction.update(self.reduction.start(now), now)


def _row(system: System, step: Step) -> TimedState:
    return TimedState(step.t, Snapshot.of(step).state(system))
