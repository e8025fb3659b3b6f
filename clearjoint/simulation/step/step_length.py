"""Length of steps between events, and the magnitudes that errors are compared with."""

from dataclasses import replace

import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ...dynamics.breakpoints import next_breakpoint
from ...dynamics.bristles import full_deflections
from ...dynamics.contact_events import ContactGaps, begins
from ...dynamics.system import System
from ...math.vectors import Condition, Scalar, Vector
from ...model.bodies import BodyState
from ...model.scene import Scene
from .step_state import Method, Proposal, Step, Variables

CUT = 0.99
"""A step shorter than this part of its full length counts as cut short by an event."""


def end_of_step(method: Method, system: System, step: Step, t_end: Scalar) -> Scalar:
    """Return the end of the next trial, s: its proposed end, or the next breakpoint, event or end
    of the run if that is earlier."""
    t1 = jnp.minimum(step.proposal.t_next, t_end)
    breakpoint = next_breakpoint(system, step.t)
    if breakpoint is not None:
        t1 = jnp.minimum(t1, breakpoint)
    if method.landing is None or not step.contact_gaps:
        return t1
    # An event closer than the spacing of times cannot be landed on; the step must still advance.
    resolution = 4.0 * jnp.finfo(t1.dtype).eps * jnp.maximum(jnp.abs(step.t), 1e-300)
    time_to_event = method.landing.time_to_next_event(step.contact_gaps, step.second_rates)
    return jnp.minimum(t1, step.t + jnp.maximum(time_to_event, resolution))


def lengths_after_contacts(
    step: Step, after: ContactGaps, t1: Scalar, keep: Condition, lands: Condition, proposed: Scalar
) -> tuple[Scalar, Condition, Scalar]:
    """Return `full_length`, `begins_contact` and `entry_length` of the next `Proposal`.

    **Arguments:** `after`: the contact gaps at t1; `keep`: whether the step up to t1 is accepted;
    `lands`: whether it is repeated up to an event instead; `proposed`: s, the controller's length
    for the next step.
    """
    last = step.proposal
    length_tried = t1 - step.t
    # The small error of a step that an event cut short is no measure for the next step. The next
    # step continues with the full length of the one that was cut.
    is_cut = length_tried < CUT * last.full_length
    begins_contact = begins(step.contact_gaps, after)
    # Contact needs much shorter steps than flight. The length that was accepted after the last
    # onset is remembered, and after the next onset at most twice of it is tried.
    entry_length = jnp.where(keep & last.begins_contact & ~is_cut, length_tried, last.entry_length)
    length = _uncut(last, is_cut, proposed)
    length = jnp.where(begins_contact, jnp.minimum(length, 2.0 * entry_length), length)
    full_length = jnp.where(lands, last.full_length, jnp.where(keep, length, proposed))
    return full_length, jnp.where(keep, begins_contact, last.begins_contact), entry_length


def length_after_breakpoints(step: Step, t1: Scalar, keep: Condition, proposed: Scalar) -> Scalar:
    """Return `full_length` of the next `Proposal` in a scene with breakpoints but no contacts."""
    is_cut = t1 - step.t < CUT * step.proposal.full_length
    return jnp.where(keep, _uncut(step.proposal, is_cut, proposed), proposed)


def _uncut(last: Proposal, is_cut: Condition, proposed: Scalar) -> Scalar:
    return jnp.where(is_cut, jnp.maximum(proposed, last.full_length), proposed)


def magnitudes(y: Variables) -> Variables:
    """Return the magnitudes that errors are compared with: of each component, but of positions and
    velocities the largest component.

    A journal that rolls along the wall hardly moves along one axis. If its error were relative to
    that component, runs would take a third more steps without being more accurate, and their number
    would depend on the axes. Bristle deflections, relative to a full one, count as at least 1:
    where they pass through zero, the error of friction is the same.
    """

    def largest(vector: Vector) -> Vector:
        size = jnp.maximum(jnp.maximum(jnp.abs(vector.x), jnp.abs(vector.y)), jnp.abs(vector.z))
        return Vector(size, size, size)

    def magnitude(node: PyTree) -> PyTree:
        if not isinstance(node, BodyState):
            return node
        return BodyState(
            largest(node.position), node.orientation, largest(node.velocity), node.spin
        )

    sizes = jax.tree.map(magnitude, y, is_leaf=lambda node: isinstance(node, BodyState))
    return replace(sizes, bristles=jax.tree.map(lambda z: jnp.maximum(jnp.abs(z), 1.0), y.bristles))


def with_relative_bristles(y: Variables, scene: Scene) -> Variables:
    """Return the variables, or their errors, with bristle deflections relative to a full one."""
    full = full_deflections(scene)
    return replace(y, bristles=jax.tree.map(lambda z, one: z / one, y.bristles, full))
