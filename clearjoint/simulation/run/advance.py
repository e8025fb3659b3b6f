"""One advance of a run: a step is tried, and what records the run is told what came of it.

Single runs, runs with derivatives and lanes of sweeps advance by this function alone, each with its
own loop around it, so that whatever one of them can record, all can. What is not recorded is not
computed.
"""

from collections.abc import Callable, Mapping
from functools import cached_property

from jaxtyping import PyTree

from ...dynamics.system import System
from ...math.vectors import Condition, Scalar
from ...quantities.instant import Instant
from ..step.dense_output import DenseStep, Snapshot
from ..step.step_state import Attempt, Method, Step, choose
from ..step.stepping import attempt
from ..step.systems import SystemFamily


class StepOutcome:
    """What is told of a step that was tried.

    `before` and `after`: where the run was and is; `tried`: the attempt; `kept`: whether the run
    went on by it.
    """

    def __init__(
        self,
        method: Method,
        system: System,
        before: Step,
        tried: Attempt,
        after: Step,
        kept: Condition,
    ):
        self.method, self.system = method, system
        self.before, self.tried, self.after, self.kept = before, tried, after, kept

    @cached_property
    def dense_step(self) -> DenseStep:
        """The step as it is looked into, if it was kept."""
        return DenseStep.of(self.tried)

    @cached_property
    def now(self) -> Instant:
        """The system at the end of the stride, where the run is."""
        here = self.after

        def inside(x: Scalar) -> Instant:
            return self.dense_step.within(self.method, x).instant(self.system)

        return Snapshot(here.t, here.y, here.entry_speeds).instant(self.system, inside)


Recorder = Callable[[PyTree, StepOutcome], PyTree]
"""A record after a stride, from that before it; unchanged unless the stride was kept."""


def advance(
    method: Method,
    system: System,
    step: Step,
    t_end: Scalar,
    records: Mapping[str, PyTree],
    recorders: Mapping[str, Recorder],
    *,
    goes: Condition | None = None,
    family: SystemFamily | None = None,
    attempt: Callable[..., Attempt] = attempt,
) -> tuple[Step, dict[str, PyTree]]:
    """The run and its records after one more attempt.

    **Arguments:** `t_end`: s, where no step goes past; `records` by the names of their `recorders`;
    `goes`: whether the run moves at all, which it does unless told otherwise; `family` as for
    `clearjoint.simulation.step.stepping.attempt`, and `attempt`: another function in its place.
    """
    tried = attempt(method, system, step, t_end, *([] if family is None else [family]))
    after, kept = tried.step, tried.kept
    if goes is not None:
        after, kept = choose(goes, after, step), goes & kept
    step_outcome = StepOutcome(method, system, step, tried, after, kept)
    return after, {name: recorders[name](record, step_outcome) for name, record in records.items()}


def latest_attempt(record: Attempt, step_outcome: StepOutcome) -> Attempt:
    """The attempt of the stride if it was accepted, else the one on record."""
    return choose(step_outcome.kept, step_outcome.tried, record)


def latest_dense_step(record: DenseStep, step_outcome: StepOutcome) -> DenseStep:
    """What is needed to look into a lane's latest accepted step: the stride's if that was kept,
    else the one on record."""
    return choose(step_outcome.kept, step_outcome.dense_step, record)
