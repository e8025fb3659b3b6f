"""One attempt of a run: try a step and pass the outcome to the recorders.

Single runs, runs with derivatives and lanes of sweeps all use `advance`, each in its own loop, so
that the same recorders work in all of them.
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
    """The outcome of a step that was tried; properties are computed only where they are used.

    `before` and `after`: the run before and after; `tried`: the attempt; `kept`: whether the step
    was accepted.
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
        """Dense output of the step, if it was kept."""
        return DenseStep.of(self.tried)

    @cached_property
    def now(self) -> Instant:
        """The system after the step."""
        after = self.after

        def inside(x: Scalar) -> Instant:
            return self.dense_step.within(self.method, x).instant(self.system)

        return Snapshot(after.t, after.y, after.entry_speeds).instant(self.system, inside)


Recorder = Callable[[PyTree, StepOutcome], PyTree]
"""Returns a record after a step was tried, from that before; unchanged unless it was kept."""


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
    """Return the run and its records after one more attempt.

    **Arguments:** `t_end`: s, no step goes past it; `records` by the names of their `recorders`;
    `goes`: whether the step is taken, for lanes that wait (default: it is); `family`: as for
    `clearjoint.simulation.step.stepping.attempt`; `attempt`: a function to use instead of that.
    """
    tried = attempt(method, system, step, t_end, *([] if family is None else [family]))
    after, kept = tried.step, tried.kept
    if goes is not None:
        after, kept = choose(goes, after, step), goes & kept
    step_outcome = StepOutcome(method, system, step, tried, after, kept)
    return after, {name: recorders[name](record, step_outcome) for name, record in records.items()}


def latest_attempt(record: Attempt, step_outcome: StepOutcome) -> Attempt:
    """Return the attempt if it was accepted, else the one on record."""
    return choose(step_outcome.kept, step_outcome.tried, record)


def latest_dense_step(record: DenseStep, step_outcome: StepOutcome) -> DenseStep:
    """Return the dense output of the step if it was kept, else that on record."""
    return choose(step_outcome.kept, step_outcome.dense_step, record)
