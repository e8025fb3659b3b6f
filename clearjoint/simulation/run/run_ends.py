"""How a run begins and how it ends: the same for single runs, sensitivities and lanes of sweeps."""

from ...dynamics.contact_forces import EntrySpeeds
from ...dynamics.system import System
from ...math.groups import by_group, by_name
from ...math.vectors import Scalar, unpack
from ...model.bodies import State
from ...result_codes import RESULTS
from ..step.step_state import Method, Step, Variables
from ..step.stepping import start


def begin_run(
    method: Method, system: System, state: State, t0: Scalar, t_end: Scalar, first_step: Scalar
) -> Step:
    """The run before its first step, from a state in packed form whose memory, ledger and bristles
    it goes on with."""
    motion = system.encode(unpack(state.bodies))
    bristles = by_group(unpack(state.bristles), system.scene.joints)
    y = Variables(motion, state.work if system.formulation.ledger else {}, bristles)
    entry_speeds = by_group(state.entry_speeds, system.scene.joints)
    return start(method, system, t0, t_end, first_step, y, entry_speeds)


def state_of(system: System, y: Variables, entry_speeds: EntrySpeeds) -> State:
    """The state in scalar form, as the system names its elements."""
    return State(system.decode(y.motion), entry_speeds, y.work, y.bristles)


def named(state: State) -> State:
    """A state of a system by the elements' own names."""
    return State(
        by_name(state.bodies), by_name(state.entry_speeds), state.work, by_name(state.bristles)
    )


def final_state(system: System, step: Step) -> State:
    """The state that a run ended in, by the elements' own names, in scalar form."""
    return named(state_of(system, step.y, step.entry_speeds))


def final_result(step: Step, t_end: Scalar) -> RESULTS:
    """The result after the last step: a run that neither failed nor came to `t_end` has used up its
    steps."""
    unfinished = (step.t < t_end) & (step.result == RESULTS.successful)
    return RESULTS.where(unfinished, RESULTS.max_steps_reached, step.result)
