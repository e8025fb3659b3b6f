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

    The run continues from the entry speeds, the ledger and the bristles of the state.

    **Arguments:** `t0`, `t_end`: s, start and end; `first_step`: s, length of the first step.
    """
    motion = system.encode(unpack(state.bodies))
    bristles = by_group(unpack(state.bristles), system.scene.joints)
    y = Variables(motion, state.work if system.formulation.ledger else {}, bristles)
    entry_speeds = by_group(state.entry_speeds, system.scene.joints)
    return start(method, system, t0, t_end, first_step, y, entry_speeds)


def state_of(system: System, y: Variables, entry_speeds: EntrySpeeds) -> State:
    """Return variables y and entry speeds as a `State` in scalar form.

    Its mappings have the keys of the system, in which alike elements are in groups.
    """
    return State(system.decode(y.motion), entry_speeds, y.work, y.bristles)


def named(state: State) -> State:
    """Return a state from `state_of` with the elements' own names as keys, instead of groups."""
    return State(
        by_name(state.bodies), by_name(state.entry_speeds), state.work, by_name(state.bristles)
    )


def final_state(system: System, step: Step) -> State:
    """Return the state after a step in scalar form, with the elements' own names as keys."""
    return named(state_of(system, step.y, step.entry_speeds))


def final_result(step: Step, t_end: Scalar) -> RESULTS:
    """Return the result code of a run that has stopped after `step`.

    The code is `max_steps_reached` if the run neither failed nor reached `t_end`, s.
    """
    unfinished = (step.t < t_end) & (step.result == RESULTS.successful)
    return RESULTS.where(unfinished, RESULTS.max_steps_reached, step.result)
