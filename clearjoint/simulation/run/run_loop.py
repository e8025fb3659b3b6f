"""The loop of a run: try a step, update the recorders, and repeat.

Single runs, runs with derivatives and lanes of sweeps all use `RunLoop`. They differ in the
recorders that they pass, and in what repeats the loop's body: JAX's loops, or the scheduler of
lanes.
"""

import abc
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, TypeAlias, TypeVar

import equinox as eqx
import jax
from jaxtyping import PyTree

from ...dynamics.system import System
from ...math.vectors import Condition, Scalar
from ...quantities.instant import Instant
from ..step.dense_output import DenseStep, Snapshot
from ..step.loops import PLAIN, AbstractLoops
from ..step.step_state import Attempt, Method, Step, choose
from ..step.stepping import attempt, blank_attempt, running
from ..step.systems import SystemFamily

R = TypeVar("R", bound=PyTree)


@dataclass(frozen=True, eq=False)
class RunStart:
    """A run before its first step, which recorders receive.

    Properties are computed only where a recorder uses them.

    - `loop`: the loop of the run.
    - `step`: complete state of the run.
    """

    loop: "RunLoop"
    step: Step

    @cached_property
    def now(self) -> Instant:
        """The instant of the start, from which quantities are evaluated."""
        return Snapshot(self.step.t, self.step.y, self.step.entry_speeds).instant(self.loop.system)

    @cached_property
    def blank_attempt(self) -> Attempt:
        """An attempt of zeros that contains the state at the start."""
        loop = self.loop
        return blank_attempt(
            loop.method, loop.system, self.step, loop.t_end, loop.family, loop.attempt
        )


@dataclass(frozen=True, eq=False)
class StepOutcome:
    """The outcome of a step that was tried, which recorders receive.

    Properties are computed only where a recorder uses them.

    - `method`, `system`: solver and step control; the system that is integrated.
    - `before`, `after`: state of the run before and after the attempt.
    - `tried`: the attempt.
    - `kept`: whether the step was taken and accepted.
    """

    method: Method
    system: System
    before: Step
    tried: Attempt
    after: Step
    kept: Condition

    @cached_property
    def dense_step(self) -> DenseStep:
        """Dense output of the step; valid only if the step was kept."""
        return DenseStep.of(self.tried)

    @cached_property
    def now(self) -> Instant:
        """The instant at the end of the attempt, from which quantities are evaluated."""
        after = self.after

        def inside(x: Scalar) -> Instant:
            return self.dense_step.within(self.method, x).instant(self.system)

        return Snapshot(after.t, after.y, after.entry_speeds).instant(self.system, inside)


class AbstractRecorder(eqx.Module, Generic[R]):
    """Base class of recorders, which collect data of type R, the record, during a run."""

    @abc.abstractmethod
    def start(self, start: RunStart) -> R:
        """Return the record before the first step."""

    @abc.abstractmethod
    def after(self, record: R, step_outcome: StepOutcome) -> R:
        """Return the record after a step was tried; it is unchanged if the step was not kept."""


Recorders: TypeAlias = PyTree[AbstractRecorder]
"""Nested dictionaries of recorders."""
Records: TypeAlias = dict[str, PyTree]
"""Records, in dictionaries with the keys of the dictionaries of recorders."""


class Progress(eqx.Module):
    """A run between two attempts: `step`, its complete state, and the records so far."""

    step: Step
    records: Records


@dataclass(frozen=True, eq=False)
class RunLoop:
    """The loop of a run.

    - `method`: solver and step control; `system`: the system to integrate.
    - `t_end`: s, end of the run; no step goes past it.
    - `recorders`: nested dictionaries of recorders; records have the same keys.
    - `family`: the system as a function of the parameters, if the run carries derivatives with
      respect to them.
    - `loops`: kind of loops, which depends on how the run is differentiated.
    - `attempt`: the function that tries a step.
    """

    method: Method
    system: System
    t_end: Scalar
    recorders: Recorders
    family: SystemFamily | None = None
    loops: AbstractLoops = PLAIN
    attempt: Callable[..., Attempt] = attempt

    def start(self, step: Step) -> Progress:
        """Return the run before its first step."""
        start = RunStart(self, step)
        return Progress(step, _map_recorders(lambda r: r.start(start), self.recorders))

    def advance(self, now: Progress, goes: Condition | None = None) -> Progress:
        """Return the run after an attempt of a step.

        If the step is rejected, time and variables are those of `now`, and the next length to try
        is shorter.

        **Arguments:** `goes`: whether to take the step; where it is false, as in a lane that waits,
        the run stays unchanged. By default the step is taken.
        """
        family_if_any = () if self.family is None else (self.family,)
        tried = self.attempt(self.method, self.system, now.step, self.t_end, *family_if_any)
        after, kept = tried.step, tried.kept
        if goes is not None:
            # In compiled code all lanes compute the attempt; a lane that waits discards its own.
            after, kept = choose(goes, after, now.step), goes & kept
        outcome = StepOutcome(self.method, self.system, now.step, tried, after, kept)
        records = _map_recorders(
            lambda recorder, record: recorder.after(record, outcome), self.recorders, now.records
        )
        return Progress(after, records)

    def until(
        self,
        stop: Scalar,
        now: Progress,
        attempts: Scalar,
        goes: Callable[[Progress], Condition] | None = None,
    ) -> Progress:
        """Return the run after steps up to the first that ends at or after `stop`, s.

        The steps end earlier at a failure, after `attempts` attempts since the start of the run,
        and where the function `goes` returns false.
        """

        def continues(now: Progress) -> Condition:
            more = (now.step.t < stop) & running(now.step, self.t_end, attempts)
            return more if goes is None else more & goes(now)

        return self.loops.repeat(continues, self.advance, now)


def _map_recorders(
    function: Callable[..., PyTree], recorders: Recorders, *records: Records
) -> Records:
    """Apply a function to each recorder and its record, and return the results in dictionaries."""
    return jax.tree.map(
        function, recorders, *records, is_leaf=lambda tree: isinstance(tree, AbstractRecorder)
    )
