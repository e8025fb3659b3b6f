"""Recorders of the latest step, of all accepted steps, and of reductions."""

import equinox as eqx
from jaxtyping import PyTree

from ...dynamics.system import System
from ...model.bodies import State
from ..reductions.reductions import AbstractReduction
from ..step.dense_output import DenseStep
from ..step.step_state import Attempt, Step, choose
from ..step.types import Numbers
from .row_buffer import RowBuffer
from .run_ends import state_of
from .run_loop import AbstractRecorder, RunStart, StepOutcome


class LatestAttempt(AbstractRecorder[Attempt]):
    """Records the latest accepted attempt, which gives states and tangents inside its step."""

    def start(self, start: RunStart) -> Attempt:
        """Return a blank attempt at the start."""
        return start.blank_attempt

    def after(self, record: Attempt, step_outcome: StepOutcome) -> Attempt:
        """Return the attempt if it was accepted, otherwise the recorded attempt."""
        return choose(step_outcome.kept, step_outcome.tried, record)


class LatestDenseStep(AbstractRecorder[DenseStep]):
    """Records the dense output of the latest accepted step of an explicit Runge-Kutta method."""

    def start(self, start: RunStart) -> DenseStep:
        """Return a step of length zero at the start."""
        return DenseStep.of(start.blank_attempt)

    def after(self, record: DenseStep, step_outcome: StepOutcome) -> DenseStep:
        """Return the dense output of the step if it was accepted, otherwise the recorded one."""
        return choose(step_outcome.kept, step_outcome.dense_step, record)


class TimedState(eqx.Module):
    """A time in s and the state at that time, in scalar form, with alike elements in groups."""

    t: Numbers
    state: State


class StepRecorder(AbstractRecorder[RowBuffer[TimedState]]):
    """Records the states at the start and after each accepted step.

    **Arguments:** `capacity`: number of rows of the buffer.
    """

    capacity: int = eqx.field(static=True)

    def start(self, start: RunStart) -> RowBuffer[TimedState]:
        """Return a buffer with the state at the start."""
        row = _row(start.loop.system, start.step)
        return RowBuffer.like(row, self.capacity).with_row(row, True)

    def after(
        self, record: RowBuffer[TimedState], step_outcome: StepOutcome
    ) -> RowBuffer[TimedState]:
        """Return the buffer with the state after the step, if it was accepted."""
        return record.with_row(_row(step_outcome.system, step_outcome.after), step_outcome.kept)


class ReductionRecorder(AbstractRecorder[PyTree]):
    """Records the tally of a reduction."""

    reduction: AbstractReduction

    def start(self, start: RunStart) -> PyTree:
        """Return the tally at the start."""
        return self.reduction.start(start.now)

    def after(self, record: PyTree, step_outcome: StepOutcome) -> PyTree:
        """Return the tally after the step, if it was accepted."""
        return choose(step_outcome.kept, self.reduction.update(record, step_outcome.now), record)


def _row(system: System, step: Step) -> TimedState:
    return TimedState(step.t, state_of(system, step.y, step.entry_speeds))
