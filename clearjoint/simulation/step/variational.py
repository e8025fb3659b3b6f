"""Derivatives of a run with respect to parameters: initial values, and values inside a step.

Runge-Kutta methods commute with differentiation: the derivative of a step with respect to a
parameter is the same step of the variational equations, error estimate included. Hence an attempt
of a step (`attempt` in `.stepping`) differentiates the solver's step for all parameters at once,
and controls the errors of variables and derivatives together.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp

from ...dynamics.bristles import initial_bristles
from ...dynamics.contact_forces import EntrySpeeds
from ...dynamics.system import System
from ...math.vectors import Scalar
from ...parametrisation.parametrised_scene import Coordinates
from .dense_output import dense_time
from .step_state import Attempt, Method, SolverState, Step, Tangents, Variables, choose
from .stepping import start
from .systems import SystemFamily
from .trial_step import term_of


def start_with_tangents(
    method: Method, family: SystemFamily, t0: Scalar, t_end: Scalar, first_step: Scalar
) -> Step:
    """Return the `Step` from which a run with derivatives begins at `t0`, s.

    **Arguments:** `family`: the systems as functions of p parameters; `t_end`: end of the run, s;
    `first_step`: length of the first step, s.
    """

    def initial(system: System, values: Coordinates) -> tuple[tuple[Variables, EntrySpeeds], None]:
        state = family.start(values)
        motion = system.encode(state.bodies)
        y = Variables(motion, {}, initial_bristles(system.scene, state.bristles))
        return jax.tree.map(jnp.asarray, (y, state.entry_speeds)), None

    count = len(family.values)
    (y, entry_speeds), _, (y_along, entry_speeds_along) = family.pushed(
        initial, (family.values,), (jnp.eye(count),)
    )
    system = family.system()
    step = start(method, system, t0, t_end, first_step, y, entry_speeds, derivatives=True)

    # Explicit methods keep the rates at the start, which depend on the parameters too. Their `init`
    # ignores the end of the first step, for which `t_end` stands here.
    def solver_state(
        system: System, y: Variables, entry_speeds: EntrySpeeds
    ) -> tuple[SolverState, None]:
        return method.solver.init(term_of(method), t0, t_end, y, (system, entry_speeds)), None

    # The ledger, and entry speeds that the state does not contain, start without dependence on the
    # parameters.
    none = jnp.zeros(count)
    y_along = replace(y_along, work=dict.fromkeys(step.y.work, none))
    entry_speeds_along = entry_speeds_along or jax.tree.map(lambda _: none, step.entry_speeds)
    _, _, state_along = family.pushed(
        solver_state, (step.y, step.entry_speeds), (y_along, entry_speeds_along)
    )
    return replace(step, tangents=Tangents(y_along, entry_speeds_along, state_along))


def look_at_tangents(method: Method, attempt: Attempt, t: Scalar) -> tuple[Variables, EntrySpeeds]:
    """Return the derivatives of variables and entry speeds with respect to p parameters, (p, ...)
    each, at a time t, s, of an accepted step.

    They are the derivatives of the results of `look_inside` before the correction onto the
    constraints.
    """
    end, inside, last = attempt.step.t, attempt.tangents, attempt.step.tangents
    assert inside is not None and last is not None
    dense = method.solver.interpolation_cls(t0=attempt.t_start, t1=end, **inside.information)
    y = choose(t >= end, last.y, dense.evaluate(dense_time(attempt, t)))
    return y, choose(t >= end, last.entry_speeds, inside.entry_speeds_start)
