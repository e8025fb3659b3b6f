"""How long steps are: up to the next event, on from there, and what errors are judged against."""

from typing import Any

import jax
import jax.numpy as jnp

from ..dynamics.breakpoints import next_breakpoint
from ..dynamics.contact_events import Reaches, begins
from ..dynamics.system import System
from ..math.vectors import Scalar, Vector
from ..model.bodies import BodyState
from .step_state import Method, Step, Variables


def end_of_step(method: Method, system: System, step: Step, t_end: Scalar) -> Scalar:
    """Where the step ends: where it is proposed to, or at the next breakpoint or event."""
    t1 = jnp.minimum(step.t_next, t_end)
    breakpoint = next_breakpoint(system.scene, step.t)
    if breakpoint is not None:
        t1 = jnp.minimum(t1, breakpoint)
    if method.landing is None or not step.reaches:
        return t1
    resolution = 4.0 * jnp.finfo(t1.dtype).eps * jnp.maximum(jnp.abs(step.t), 1e-300)
    due = method.landing.due(step.reaches, step.second_rates)
    return jnp.minimum(t1, step.t + jnp.maximum(due, resolution))


def resumed(
    step: Step, after: Reaches, t1: Scalar, keep: Scalar, lands: Scalar, proposed: Scalar
) -> tuple[Scalar, Scalar, Scalar]:
    """`intended`, `enters` and `entering` of the next step.

    What an event cut short tells nothing of the step to take next: that is the one intended
    before, or where a contact begins about as long as the last time.
    """
    h = t1 - step.t
    cut = h < 0.99 * step.intended
    begun = begins(step.reaches, after)
    entering = jnp.where(keep & step.enters & ~cut, h, step.entering)
    length = _uncut(step, cut, proposed)
    length = jnp.where(begun, jnp.minimum(length, 2.0 * entering), length)
    intended = jnp.where(lands, step.intended, jnp.where(keep, length, proposed))
    return intended, jnp.where(keep, begun, step.enters), entering


def resumed_in_time(step: Step, t1: Scalar, keep: Scalar, proposed: Scalar) -> Scalar:
    """`intended` of the next step where there are breakpoints, but no contacts."""
    cut = t1 - step.t < 0.99 * step.intended
    return jnp.where(keep, _uncut(step, cut, proposed), proposed)


def _uncut(step: Step, cut: Scalar, proposed: Scalar) -> Scalar:
    return jnp.where(cut, jnp.maximum(proposed, step.intended), proposed)


def magnitudes(y: Variables) -> Variables:
    """What errors are compared with: each component, but of positions and velocities the largest.

    A journal that rolls along the wall hardly moves along one axis. Judged against that, its
    velocity would take a third more steps, for nothing, and their number would depend on the axes.
    """

    def largest(vector: Vector) -> Vector:
        size = jnp.maximum(jnp.maximum(jnp.abs(vector.x), jnp.abs(vector.y)), jnp.abs(vector.z))
        return Vector(size, size, size)

    def of(node: Any) -> Any:
        if not isinstance(node, BodyState):
            return node
        return BodyState(
            largest(node.position), node.orientation, largest(node.velocity), node.spin
        )

    return jax.tree.map(of, y, is_leaf=lambda node: isinstance(node, BodyState))
