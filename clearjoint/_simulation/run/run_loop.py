"""The loop of a run: begin, try a step, update the recorders, repeat, and return the final state.

Single runs, runs with derivatives and lanes of sweeps all use `RunLoop` and differ in their
recorders. In sweeps the scheduler repeats the loop's body; in other runs JAX does.
"""

import abc
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Generic, TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ..._dynamics.breakpoints import since_breakpoints
from ..._dynamics.contact_events import any_of, changes
from ..._dynamics.coordinates import MotionVariables
from ..._dynamics.system import System
from ..._math.vectors import Condition, Scalar, unpack
from ..._model.bodies import State
from ..._result_codes import RESULTS
from ...quantities.base import Instant
from ..step.dense_output import DenseStep, Snapshot
from ..step.method import SystemFamily
from ..step.rotation_limit import rotating_bodies
from ..step.saltation import contacts_jump
from ..step.solvers import UnrolledExplicit
from ..step.step_state import Attempt, Method, Step, TangentsInside, Variables, choose
from ..step.stepping import attempt, running, start
from ..step.trial_step import term_of, time_map_of

R = TypeVar("R", bound=PyTree)


@dataclass(frozen=True, eq=False)
class RunStart:
    """A run before its first `step`, as recorders receive it."""

    loop: "RunLoop"
    step: Step

    @cached_property
    def now(self) -> Instant:
        return Snapshot.of(self.step).instant(self.loop.system)

    @cached_property
    def blank_attempt(self) -> Attempt:
        """The initial value of a loop over accepted attempts: an `Attempt` that ends at the start
        with the initial state, ``rejected=None``, and otherwise zeros."""
        loop, step, solver = self.loop, self.step, self.loop.method.solver
        if isinstance(solver, UnrolledExplicit):
            # The structure is known. To trace an attempt only for its shapes would take as long as
            # tracing the whole loop.
            like, inside = solver.information_like, None
            if step.tangents is not None:
                inside = TangentsInside(step.tangents.entry_speeds, like(step.tangents.y))
            example = Attempt(
                step=step,
                accepted=False,
                t_start=step.t,
                entry_speeds_start=step.entry_speeds,
                information=like(step.y),
                time_map=time_map_of(loop.method, step, step.t),
                tangents=inside,
            )
        else:
            arguments = loop.method, loop.system, step, loop.t_end, loop.family
            example = jax.eval_shape(lambda: loop.attempt(*arguments))
        example = replace(example, rejected=None)
        zeros = jax.tree.map(lambda s: jnp.zeros(jnp.shape(s), jnp.result_type(s)), example)
        return replace(zeros, step=step)


@dataclass(frozen=True, eq=False)
class StepOutcome:
    """The outcome of an attempt to take a step, as recorders receive it. If the step was not
    accepted, or a lane waits for Python, time and variables are the same `before` and `after`."""

    method: Method
    system: System
    before: Step
    tried: Attempt
    after: Step
    accepted: Condition

    @cached_property
    def dense_step(self) -> DenseStep:
        """The tried step with its dense output; valid only if the step was accepted."""
        return DenseStep.of(self.tried)

    @cached_property
    def now(self) -> Instant:
        """The instant of `after`. Its method `inside` is valid only if the step was accepted."""

        def inside(x: Scalar) -> Instant:
            return self.dense_step.within(self.method, x).instant(self.system)

        return Snapshot.of(self.after).instant(self.system, inside, self._jumps)

    @property
    def _jumps(self) -> Condition | None:
        """Whether the step ends at an event at which quantities may jump; ``None`` if none can."""
        scene, before, after = self.system.scene, self.before, self.after
        events = [lands for lands, _ in since_breakpoints(self.system, before.t, after.t).values()]
        if contacts_jump(scene):
            events.append(changes(before.contact_gaps, after.contact_gaps))
        return any_of(events) if events else None


class AbstractRecorder(eqx.Module, Generic[R]):
    """Base class of recorders, which collect data of type R, the record, during a run. `RunLoop`
    calls `start` once before the first step, and `after` after each attempt."""

    @abc.abstractmethod
    def start(self, start: RunStart) -> R:
        """Return the record before the first step."""

    @abc.abstractmethod
    def after(self, record: R, step_outcome: StepOutcome) -> R:
        """Return the record after an attempt. It must be unchanged if the step was not accepted,
        except in records of rejected steps."""

    def searched(self, now: Instant) -> PyTree[Scalar]:
        """Return the numbers at `now` that the recorder evaluates at few instants of each step; by
        default none. So that few suffice, `RunLoop` limits rotations in a step that affect them."""
        del now
        return ()


_map_recorders = partial(jax.tree.map, is_leaf=lambda tree: isinstance(tree, AbstractRecorder))
Recorders: TypeAlias = PyTree[AbstractRecorder]
"""The recorders of a run, in nested dictionaries."""
Records: TypeAlias = dict[str, PyTree]
"""The records of a run, in nested dictionaries with the same keys as those of the recorders."""


class Progress(eqx.Module):
    """A run between two attempts: its complete state, `step`, and the `records` so far."""

    step: Step
    records: Records


@dataclass(frozen=True, eq=False)
class RunLoop:
    """The loop of a run.

    - `t_end`: s, end of the run; no step goes past it.
    - `family`: the system as a function of parameters, in runs with derivatives, or ``None``.
    - `attempt`: the function that tries a step.
    """

    method: Method
    system: System
    t_end: Scalar
    recorders: Recorders
    family: SystemFamily | None = None
    attempt: Callable[..., Attempt] = attempt

    def start(self, step: Step) -> Progress:
        start = RunStart(self, step)
        return Progress(step, _map_recorders(lambda r: r.start(start), self.recorders))

    def advance(self, now: Progress, goes: Condition | None = None) -> Progress:
        """Return the run after one attempt; unchanged if `goes` is false, as for a waiting lane."""
        family_if_any = () if self.family is None else (self.family,)
        method = self._method(now.step)
        tried = self.attempt(method, self.system, now.step, self.t_end, *family_if_any)
        after, accepted = tried.step, tried.accepted
        if goes is not None:
            # In compiled code all lanes compute the attempt; a lane that waits discards its own.
            after, accepted = choose(goes, after, now.step), goes & accepted
        outcome = StepOutcome(self.method, self.system, now.step, tried, after, accepted)
        records = _map_recorders(
            lambda recorder, record: recorder.after(record, outcome), self.recorders, now.records
        )
        return Progress(after, records)

    def _method(self, step: Step) -> Method:
        # A step limits the rotations of the bodies on which the `searched` numbers of recorders
        # depend. To find these bodies, the numbers are traced, but not computed. So the instant at
        # the start of the step serves, also in place of all instants `inside` of the step.
        def searched(motion: MotionVariables) -> PyTree:
            snapshot = Snapshot(step.t, replace(step.y, motion=motion), step.entry_speeds)

            def inside(_: Scalar) -> Instant:
                return snapshot.instant(self.system, inside)

            return _map_recorders(lambda recorder: recorder.searched(inside(0.0)), self.recorders)

        rotating = rotating_bodies(self.system, step.y.motion, searched)
        return replace(self.method, rotating=rotating)

    def until(
        self,
        stop: Scalar,
        now: Progress,
        attempts: Scalar,
        goes: Callable[[Progress], Condition] | None = None,
    ) -> Progress:
        """Return the run `now` after further steps, up to the first that ends at time `stop`, s, or
        later. It may stop earlier: at a failure, at the run's end, after `attempts` attempts since
        the run's start, or when `goes`, called with the run before each attempt, returns false."""

        def continues(now: Progress) -> Condition:
            more = (now.step.t < stop) & running(now.step, self.t_end, attempts)
            return more if goes is None else more & goes(now)

        return jax.lax.while_loop(continues, self.advance, now)


def begin_run(
    method: Method, system: System, state: State, t0: Scalar, t_end: Scalar, first_step: Scalar
) -> Step:
    """Return the complete state of a run before its first step, which has the length `first_step`,
    s. What `state` lacks is initialised: entry speeds, bristles, memories and, with an energy
    ledger, `work`."""
    motion = system.encode(unpack(state.bodies))
    work = state.work if system.formulation.ledger else {}
    y = Variables(motion, work, unpack(state.bristles), state.memory)
    return start(method, term_of(method), system, t0, t_end, first_step, y, state.entry_speeds)


def final_result(step: Step, t_end: Scalar) -> RESULTS:
    """Return `step.result`, or `max_steps_reached` if a run neither failed nor reached `t_end`."""
    unfinished = (step.t < t_end) & (step.result == RESULTS.successful)
    return RESULTS.where(unfinished, RESULTS.max_steps_reached, step.result)
