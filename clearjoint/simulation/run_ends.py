"""How a run begins and how it ends: the same for single runs, sensitivities and lanes of sweeps."""

from typing import Any

from ..dynamics.system import System
from ..math.groups import by_group, by_name
from ..math.vectors import Scalar, unpack
from ..model.bodies import State
from ..results import RESULTS
from .step_state import Method, Step, Variables
from .stepping import start

FIRST_SHARE = 1e-6
"""Length of the first step, unless it is given, in durations of the run."""


def default_first_step(start_time: Any, end_time: Any) -> Any:
    """Length of the first step between two times, s."""
    return FIRST_SHARE * (end_time - start_time)


def begun(
    method: Method, system: System, state: State, t0: Scalar, t_end: Scalar, first_step: Scalar
) -> Step:
    """What there is before the first step from a state in packed form, whose memory and ledger are
    continued."""
    motion = system.encode(unpack(state.bodies))
    y = Variables(motion, state.work if system.formulation.ledger else {})
    memory = by_group(state.memory, system.scene.joints)
    return start(method, system, t0, t_end, first_step, y, memory)


def state_of(system: System, y: Variables, memory: Any) -> State:
    """The state in scalar form, as the system names its elements."""
    return State(system.decode(y.motion), memory, y.work)


def named(state: State) -> State:
    """A state of a system by the elements' own names."""
    return State(by_name(state.bodies), by_name(state.memory), state.work)


def final_state(system: System, step: Step) -> State:
    """The state that a run ended in, by the elements' own names, in scalar form."""
    return named(state_of(system, step.y, step.memory))


def final_result(step: Step, t_end: Scalar) -> RESULTS:
    """How a run ended after its last step: without a failure before `t_end`, it had no more."""
    unfinished = (step.t < t_end) & (step.result == RESULTS.successful)
    return RESULTS.where(unfinished, RESULTS.max_steps_reached, step.result)
