"""Derivatives beside the state: where they start, and what they are inside a step.

Runge-Kutta methods commute with differentiation: the derivative of a step along a parameter is the
same step of the variational equations, error estimate included. So `attempt` differentiates the
solver's step, for all parameters at once, and judges its error over state and derivatives.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from ..dynamics.contact_forces import Memory
from ..dynamics.system import System
from ..math.vectors import Scalar
from .dense_output import dense_time
from .step_state import Attempt, Method, Step, Tangents, Variables, choose
from .stepping import start
from .systems import SystemFamily
from .trial_step import term_of


def start_with_tangents(
    method: Method, family: SystemFamily, t0: Scalar, t_end: Scalar, first_step: Scalar
) -> Step:
    """`start` for a family of systems, with the derivatives of the initial state."""

    def begun(system: System, values: Any) -> tuple[tuple[Variables, Memory], None]:
        state = family.start(values)
        motion = system.encode(state.bodies)
        return (Variables(motion, {}), jax.tree.map(jnp.asarray, state.memory)), None

    count = len(family.values)
    (y, memory), _, (y_along, memory_along) = family.pushed(
        begun, (family.values,), (jnp.eye(count),)
    )
    system = family.system()
    step = start(method, system, t0, t_end, first_step, y, memory, derivatives=True)

    def rates(system: System, y: Variables, memory: Memory) -> tuple[Any, None]:
        return method.solver.init(term_of(method), t0, t_end, y, (system, memory)), None

    nothing = jnp.zeros(count)
    y_along = Variables(y_along.motion, dict.fromkeys(step.y.work, nothing))
    memory_along = memory_along or jax.tree.map(lambda _: nothing, step.memory)
    _, _, rates_along = family.pushed(rates, (step.y, step.memory), (y_along, memory_along))
    tangents = Tangents(y_along, memory_along, rates_along)
    return eqx.tree_at(lambda s: s.tangents, step, tangents, is_leaf=lambda leaf: leaf is None)


def look_at_tangents(method: Method, tried: Attempt, t: Scalar) -> tuple[Any, Any]:
    """Derivatives of what `look_inside` gives, before it is projected."""
    end, inside, ahead = tried.step.t, tried.tangents, tried.step.tangents
    assert inside is not None and ahead is not None
    dense = method.solver.interpolation_cls(t0=tried.t_start, t1=end, **inside.information)
    y = choose(t >= end, ahead.y, dense.evaluate(dense_time(tried, t)))
    return y, choose(t >= end, ahead.memory, inside.memory_start)
