"""First step and final state of a run, for single runs, sensitivities and lanes of sweeps."""

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
    """Return the run before its first step, from a state in packed form.

    Entry speeds, ledger and bristles of the state are continued.
    """
    motion = system.encode(unpack(state.bodies))
    bristles = by_group(unpack(state.bristles), system.scene.joints)
    y = Variables(motion, state.work if system.formulation.ledger else {}, bristles)
    entry_speeds = by_group(state.entry_speeds, system.scene.joints)
    return start(method, system, t0, t_end, first_step, y, entry_speeds)


def state_of(system: System, y: Variables, entry_speeds: EntrySpeeds) -> State:
    """Return the state in scalar form, with alike elements in groups as the system has them."""
    return State(system.decode(y.motion), entry_speeds, y.work, y.bristles)


def named(state: State) -> State:
    """Return a state of a system by the elements' own names."""
    return State(
        by_name(state.bodies), by_name(state.entry_speeds), state.work, by_name(state.bristles)
    )


def final_state(system: System, step: Step) -> State:
    """Return the final state of a run, by the elements' own names, in scalar form."""
    return named(state_of(system, step.y, step.entry_speeds))


def final_result(step: Step, t_end: Scalar) -> RESULTS:
    """Return the result of a run; one that neither failed nor reached `t_end` ran out of steps."""
    unfinished = (step.t < t_end) & (step.result == RESULTS.successful)
    return RESULTS.where(unfinished, RESULTS.max_steps_reached, step.result)
