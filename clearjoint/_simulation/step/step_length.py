"""Lengths of steps before and after events, and the magnitudes with which errors are compared. A
step that an event ends earlier than the controller proposed is said to be cut short."""

from dataclasses import replace
from functools import reduce

import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ..._dynamics.breakpoints import next_breakpoint
from ..._dynamics.bristles import full_deflections
from ..._dynamics.contact_events import ContactGaps, begins
from ..._dynamics.coordinates import MotionVariables
from ..._dynamics.system import System
from ..._math.vectors import Condition, Scalar, Vector
from ..._model.bodies import BodyState
from ..._model.scene import Scene
from .rotation_limit import TARGET, fastest_rotation
from .step_state import Method, Proposal, Step, Variables

CUT = 0.99
"""A step counts as cut short if it is shorter than this part of its `full_length`. The margin
disregards cuts as small as rounding errors."""


SHARE_OF_SPEED = 0.2
"""`tangent_sizes` adds to the size of a speed's derivative this number times the speed, times the
ratio of the largest derivative of a position to the largest position. With smaller values,
derivatives of a fall from 50 m on a contact of 1e13 N/m^1.5 could not be computed."""


def end_of_step(method: Method, system: System, step: Step, t_end: Scalar) -> Scalar:
    """Return the end of the next trial, s: the earliest of the proposed end, the next breakpoint,
    the predicted next event of a contact (with `method.landing`), the end `t_end` of the run, and
    the time by which a body in `method.rotating` rotates by the angle `TARGET`."""
    t1 = jnp.minimum(step.proposal.t_next, t_end)
    breakpoint = next_breakpoint(system, step.t)
    if breakpoint is not None:
        t1 = jnp.minimum(t1, breakpoint)
    lengths = []
    if method.landing is not None and step.contact_gaps:
        lengths.append(method.landing.time_to_next_event(step.contact_gaps, step.second_rates))
    if method.rotating:
        # A uniform rotation then covers the angle `TARGET`.
        lengths.append(TARGET / fastest_rotation(method, system, step.y.motion))
    # A step cannot end at an event that is closer than a few spacings of floating-point times,
    # because it must still advance. The number 1e-300 keeps this bound positive at t = 0.
    resolution = 4.0 * jnp.finfo(t1.dtype).eps * jnp.maximum(jnp.abs(step.t), 1e-300)
    for length in lengths:
        t1 = jnp.minimum(t1, step.t + jnp.maximum(length, resolution))
    return t1


def lengths_after_contacts(
    step: Step, after: ContactGaps, t1: Scalar, keep: Condition, lands: Condition, proposed: Scalar
) -> tuple[Scalar, Condition, Scalar]:
    """Return `full_length`, `begins_contact` and `entry_length` of the next `Proposal`.

    **Arguments:** `step`: the state before the trial; `after`: the contact gaps at the end of the
    trial, at the time `t1`, s; `keep`: whether the trial is accepted; `lands`: whether the trial is
    rejected because it passes an event, and repeated up to this event; `proposed`: length of the
    next step, s, without regard to events.
    """
    last = step.proposal
    length_tried = t1 - step.t
    # The small error of a step that an event cut short is no measure for the next step. The next
    # step continues with the full length of the one that was cut.
    is_cut = length_tried < CUT * last.full_length
    begins_contact = begins(step.contact_gaps, after)
    # Contact needs much shorter steps than flight. The length that was accepted after the last
    # onset is remembered. After the next onset at most twice this length is tried, which saves
    # rejected trials but lets the length grow again.
    entry_length = jnp.where(keep & last.begins_contact & ~is_cut, length_tried, last.entry_length)
    length = _uncut(last, is_cut, proposed)
    length = jnp.where(begins_contact, jnp.minimum(length, 2.0 * entry_length), length)
    # A trial that is repeated up to an event keeps its length without events. A trial that is
    # rejected because of its error or of a driver gets the shorter length `proposed`.
    full_length = jnp.where(lands, last.full_length, jnp.where(keep, length, proposed))
    return full_length, jnp.where(keep, begins_contact, last.begins_contact), entry_length


def length_after_breakpoints(step: Step, t1: Scalar, keep: Condition, proposed: Scalar) -> Scalar:
    """Return the next step's length, s, if no event cuts it short; steps end at no contact events.
    `t1`: end of the trial, s; `keep`: it is accepted; `proposed`: length without events, s."""
    is_cut = t1 - step.t < CUT * step.proposal.full_length
    return jnp.where(keep, _uncut(step.proposal, is_cut, proposed), proposed)


def _uncut(last: Proposal, is_cut: Condition, proposed: Scalar) -> Scalar:
    """Return the length, s, that the next step has if no event cuts it short: `proposed`, but if
    the `last` step was cut short (`is_cut`), at least the `full_length` of that step."""
    return jnp.where(is_cut, jnp.maximum(proposed, last.full_length), proposed)


def magnitudes(y: Variables) -> Variables:
    """Return the numbers to which the step-size controller relates the errors of the variables y.

    - Position and velocity of a body: for each component, the largest magnitude of all three.
    - Bristle deflections, from `with_relative_bristles`: the absolute value, but at least 1.
    - All other variables: the variable itself; the controller takes absolute values.
    """

    def largest_component(vector: Vector) -> Vector:
        size = jnp.maximum(jnp.maximum(jnp.abs(vector.x), jnp.abs(vector.y)), jnp.abs(vector.z))
        return Vector(size, size, size)

    # A journal that rolls along the wall hardly moves along one axis. If its error were relative to
    # that small component, runs would take a third more steps without being more accurate, and the
    # number of steps would depend on the directions of the axes.
    def of_body(node: PyTree) -> PyTree:
        if not isinstance(node, BodyState):
            return node
        position, velocity = map(largest_component, (node.position, node.velocity))
        return replace(node, position=position, velocity=velocity)

    sizes = jax.tree.map(of_body, y, is_leaf=lambda node: isinstance(node, BodyState))

    # An error of a deflection changes the friction force equally at all deflections. Its measure is
    # therefore the deflection at full friction, which is 1 here, also where a deflection passes
    # through zero.
    bristles = jax.tree.map(lambda z: jnp.maximum(jnp.abs(z), 1.0), y.bristles)
    return replace(sizes, bristles=bristles)


def tangent_sizes(system: System, sizes: Variables, along: Variables) -> Variables:
    """Return the numbers to which the step-size controller relates the errors of tangents. `along`
    and `sizes` are the `magnitudes` of tangents and variables. The result is `along`, to which, for
    speeds, a term in proportion to `sizes` is added (`SHARE_OF_SPEED` has the formula)."""

    # The added term lets a run pass an onset. There, the derivative of a speed may rise from zero
    # to a high peak. The rate of this rise has the relative error of the tiny depth, of which few
    # digits are known far from the origin. Compared with the derivative alone, the error would stay
    # too large in steps of any length.

    # Motion with speeds of zero, so that `largest` finds the largest position.
    def positions(motion: MotionVariables) -> MotionVariables:
        return system.with_speeds(motion, jax.tree.map(jnp.zeros_like, motion))

    # One number for each tangent, and one for the variables.
    change, size = (largest(positions(y.motion)) for y in (along, sizes))
    ratio = SHARE_OF_SPEED * change / jnp.where(size > 0.0, size, jnp.inf)

    def size_of(derivative: Scalar, speed: Scalar) -> Scalar:
        return jnp.abs(derivative) + ratio * jnp.abs(speed)

    speeds = jax.tree.map(size_of, along.motion, sizes.motion)
    return replace(along, motion=system.with_speeds(along.motion, speeds))


def largest(tree: PyTree[Scalar]) -> Scalar:
    """Return, element by element, the largest magnitude among a PyTree's leaves of equal shape."""
    return reduce(jnp.maximum, [jnp.abs(leaf) for leaf in jax.tree.leaves(tree)])


def with_relative_bristles(y: Variables, scene: Scene) -> Variables:
    """Return variables, or errors of variables, with each bristle deflection, m, divided by the
    deflection of its contact at full friction."""
    full = full_deflections(scene)
    return replace(y, bristles=jax.tree.map(lambda z, limit: z / limit, y.bristles, full))
