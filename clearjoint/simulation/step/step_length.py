"""How long steps are: up to the next event, on from there, and what errors are judged against."""

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
"""A step shorter than this share of its full length was cut short."""


def end_of_step(method: Method, system: System, step: Step, t_end: Scalar) -> Scalar:
    """Where the step ends: where it is proposed to, or at the next breakpoint or event."""
    t1 = jnp.minimum(step.proposal.t_next, t_end)
    breakpoint = next_breakpoint(system, step.t)
    if breakpoint is not None:
        t1 = jnp.minimum(t1, breakpoint)
    if method.landing is None or not step.contact_gaps:
        return t1
    resolution = 4.0 * jnp.finfo(t1.dtype).eps * jnp.maximum(jnp.abs(step.t), 1e-300)
    due = method.landing.time_to_next_event(step.contact_gaps, step.second_rates)
    return jnp.minimum(t1, step.t + jnp.maximum(due, resolution))


def lengths_after_contacts(
    step: Step, after: ContactGaps, t1: Scalar, keep: Condition, lands: Condition, proposed: Scalar
) -> tuple[Scalar, Condition, Scalar]:
    """`full_length`, `begins_contact` and `entry_length` of the next `Proposal`.

    A step that an event cut short says nothing about the length of the next one. That is then the
    full length of the one that was cut or, where a contact begins, at most twice the length that
    held when one last began.

    **Arguments:** `after`: the contacts at t1; `keep`: whether the step up to there is accepted;
    `lands`: whether it is tried again up to an event instead; `proposed`: the controller's length
    for the next one, s.
    """
    last = step.proposal
    length_tried = t1 - step.t
    is_cut = length_tried < CUT * last.full_length
    begins_contact = begins(step.contact_gaps, after)
    entry_length = jnp.where(keep & last.begins_contact & ~is_cut, length_tried, last.entry_length)
    length = _uncut(last, is_cut, proposed)
    length = jnp.where(begins_contact, jnp.minimum(length, 2.0 * entry_length), length)
    full_length = jnp.where(lands, last.full_length, jnp.where(keep, length, proposed))
    return full_length, jnp.where(keep, begins_contact, last.begins_contact), entry_length


def length_after_breakpoints(step: Step, t1: Scalar, keep: Condition, proposed: Scalar) -> Scalar:
    """`full_length` of the next `Proposal` where there are breakpoints, but no contacts."""
    is_cut = t1 - step.t < CUT * step.proposal.full_length
    return jnp.where(keep, _uncut(step.proposal, is_cut, proposed), proposed)


def _uncut(last: Proposal, is_cut: Condition, proposed: Scalar) -> Scalar:
    return jnp.where(is_cut, jnp.maximum(proposed, last.full_length), proposed)


def magnitudes(y: Variables) -> Variables:
    """What errors are compared with: each component, but of positions and velocities the largest.

    A journal that rolls along the wall hardly moves along one axis. Judged against that, its
    velocity would take a third more steps, for nothing, and their number would depend on the axes.
    Deflections of bristles, as parts of a full one, count as such ones at least: friction is wrong
    by the same where they pass through zero.
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
    """The variables, or their errors, with deflections of bristles as parts of a full one."""
    full = full_deflections(scene)
    return replace(y, bristles=jax.tree.map(lambda z, one: z / one, y.bristles, full))
