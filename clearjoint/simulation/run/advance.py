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
    """The outcome of a step that was tried, which recorders receive.

    Properties are computed only where a recorder uses them.

    - `before`, `after`: state of the run before and after the attempt.
    - `tried`: the attempt.
    - `kept`: whether the step was taken and accepted.
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
        """Dense output of the step; valid only if the step was kept."""
        return DenseStep.of(self.tried)

    @cached_property
    def now(self) -> Instant:
        """The instant at the end of the attempt, from which quantities are evaluated."""
        after = self.after

        def inside(x: Scalar) -> Instant:
            return self.dense_step.within(self.method, x).instant(self.system)

        return Snapshot(after.t, after.y, after.entry_speeds).instant(self.system, inside)


Recorder = Callable[[PyTree, StepOutcome], PyTree]
"""Function of a record and of the outcome of an attempt. It returns the updated record, which is
unchanged if the step was not kept."""


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
    """Try one time step, and update the run and its records.

    **Arguments:**

    - `method`: solver and step control; `system`: the system to integrate.
    - `step`: complete state of the run after the latest accepted step.
    - `t_end`: s, end of the run; no step goes past it.
    - `records`: data collected during the run, by name; `recorders`: for each name, the function
      that updates the record.
    - `goes`: whether to take the step; where it is false, as in a lane that waits, the run and its
      records stay unchanged. By default the step is taken.
    - `family`: the system as a function of the parameters, if the run carries derivatives with
      respect to them.
    - `attempt`: the function that tries a step, to replace the default by a compiled one.

    **Returns:** the state of the run after the attempt, and the records. If the step is rejected,
    time and variables are those of `step`, and the next length to try is shorter.
    """
    family_if_any = () if family is None else (family,)
    tried = attempt(method, system, step, t_end, *family_if_any)
    after, accepted = tried.step, tried.kept
    if goes is not None:
        # In compiled code all lanes compute the attempt; a lane that waits discards its own.
        after, accepted = choose(goes, after, step), goes & accepted
    step_outcome = StepOutcome(method, system, step, tried, after, accepted)
    return after, {name: recorders[name](record, step_outcome) for name, record in records.items()}


def latest_attempt(record: Attempt, step_outcome: StepOutcome) -> Attempt:
    """Return the attempt if it was accepted, otherwise the recorded attempt."""
    return choose(step_outcome.kept, step_outcome.tried, record)


def latest_dense_step(record: DenseStep, step_outcome: StepOutcome) -> DenseStep:
    """Return the dense output of the step if it was accepted, otherwise the recorded one."""
    return choose(step_outcome.kept, step_outcome.dense_step, record)
