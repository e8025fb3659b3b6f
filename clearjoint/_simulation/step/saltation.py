"""Correction of the variables, and mainly of their derivatives with respect to parameters, at the
end of a step at which a contact force, or its slope over the penetration, is discontinuous.

The time of the event, the onset or end of a contact, depends on the parameters, but the step ends
at a time t1 that is not differentiated. Let tau be the time from the event to t1, s. Landing makes
tau zero except for rounding, but not its derivative. The step was computed with the rates f- before
the event; those after it are f+. The corrected state y + (f+ - f-) tau has the derivatives of the
motion across the event (the saltation matrix: R. I. Leine, H. Nijmeijer 2004, section 7.3).

The contact force in f+ is a mean over the time tau. If the force is continuous and only its slope
K, N/m, jumps, as for a spring, this mean is K delta/2 for the penetration delta, m, at t1. With the
force at the event, which is zero, derivatives would have an error proportional to tau, which is
visible if two contacts of a stiff spring begin a millionth of the contact time apart.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeVar

import jax
import jax.numpy as jnp

from ..._compilation.xla import shared_by_many
from ..._dynamics.contact_events import ContactGap, ContactGaps, any_of, contact_gaps
from ..._dynamics.contact_forces import EntrySpeeds, LoadedContact, contact_force, depth_at_wall
from ..._dynamics.kinds import Kinds
from ..._dynamics.sampled_forces import holding
from ..._dynamics.system import System
from ..._math.vectors import Condition, Scalar, Vector
from ..._model.joints.base import AbstractContactJoint, ByLabel, Contact, Motions, each_label
from ..._model.scene import Scene
from .step_state import Variables

T = TypeVar("T")


def contacts_jump(scene: Scene) -> bool:
    """Return whether a contact force may jump where its contact begins or ends."""
    return any(law.force_jumps for family in scene.laws().values() for law in family.values())


def slopes_jump(scene: Scene) -> bool:
    """Return whether a contact force's slope over the penetration may jump at a contact event."""
    return any(law.slope_jumps() for family in scene.laws().values() for law in family.values())


def across_contacts(
    system: System,
    before: ContactGaps,
    y: Variables,
    entry_speeds: EntrySpeeds,
    t: Scalar,
    differentiated: bool,
) -> Variables:
    """Return the variables at the end of a step, corrected for contacts that begin or end there.

    The correction changes the variables themselves by rounding errors only, but it adds the
    saltation to their derivatives.

    **Arguments:** `before`, `entry_speeds`: contact gaps and entry speeds, m/s, at the start of the
    step; `y`, `t`: variables, and time, s, at its end; `differentiated`: whether the caller
    differentiates the result.
    """
    motions, joints = system.motions(y.motion), system.scene.contact_joints()
    times = _contact_times(system.scene, before, contact_gaps(system.scene, motions))
    kinds = Kinds(system.scene)

    def mean_forces(name: str) -> dict[str, LoadedContact]:
        speeds, bristles = entry_speeds.get(name, {}), y.bristles.get(name, {})
        labels = tuple(times[name])
        forces = kinds.evaluate(_mean_forces, joints[name], motions, labels, speeds, bristles)
        return dict(zip(labels, forces, strict=True))

    # Forces of contacts without an event in this step are computed too. They have no effect,
    # because their times are zero.
    forces = {name: mean_forces(name) for name in times}
    # The derivative of the product of a rate and a time has two terms. Derivatives of the masses
    # are left out: they are multiplied by the times, which are rounding errors, so that they are a
    # rounding error of the other term. With 30 joints, they were 8 % of the program of a run with
    # tangents.
    # `holding` gives sampled forces, such as servos, their memories in `y`.
    fixed, motion = holding(system, y.memory), y.motion
    if differentiated:
        fixed, motion = constant((fixed, motion))
    mechanics = fixed.mechanics(motion)

    def rates(times: ByLabel[Scalar]) -> Variables:
        # Each force times the time for which the step lacks it.
        impulses = each_label(
            lambda name, label: _multiplied(forces[name][label], times[name][label]), times
        )
        dynamics = fixed.dynamics_under(mechanics, impulses, t)
        powers = fixed.powers(dynamics, t)
        return jax.tree.map(jnp.asarray, Variables(dynamics.variable_rates, powers))

    # The rates are a linear function of the contact forces plus terms that do not depend on them
    # (gravity, springs, gyroscopic terms). Their derivative in the direction `times`, at contact
    # forces of zero, is the linear part alone: (f+ - f-) tau, including the reactions of the
    # constraints.
    none = jax.tree.map(jnp.zeros_like, times)
    change = jax.jvp(rates, (none,), (times,))[1]
    motion = jax.tree.map(lambda value, by: value + by, y.motion, change.motion)
    work = {name: e + change.work.get(name, 0.0) for name, e in y.work.items()}
    # Bristle deflections stay, because `updated_bristles` sets them afterwards.
    return replace(y, motion=motion, work=work)


def constant(tree: T) -> T:
    """Return a PyTree with the same numbers, whose derivatives are zero."""
    # Python numbers, which are folded into formulas, have no derivatives, and would become arrays.
    return jax.tree.map(lambda x: jax.lax.stop_gradient(x) if isinstance(x, jax.Array) else x, tree)


def _jumping_contacts(scene: Scene) -> dict[str, list[str]]:
    labels_by_joint = {
        name: [label for label, law in family.items() if law.force_jumps or law.slope_jumps()]
        for name, family in scene.laws().items()
    }
    return {name: labels for name, labels in labels_by_joint.items() if labels}


def _changes(before: ContactGap, after: ContactGap) -> Condition:
    return (before.depth > 0.0) != (after.depth > 0.0)


def any_changes(scene: Scene, before: ContactGaps, after: ContactGaps) -> Condition:
    """Return whether a contact begins or ends between two instants, with the gaps `before` and
    `after`. Only contacts whose force, or its slope over the penetration, may jump are checked."""
    jumping = _jumping_contacts(scene)
    count = sum(map(len, jumping.values()))
    return any_of(
        shared_by_many(count, _changes, before[name][label], after[name][label])
        for name, labels in jumping.items()
        for label in labels
    )


def _contact_times(scene: Scene, before: ContactGaps, after: ContactGaps) -> ByLabel[Scalar]:
    """Return by how much longer, s, each contact transmitted its force than the solver assumed in a
    step: positive after an onset, negative after an end, zero without an event.

    The solver computes a step with the contacts that exist at its start. Penetration over its rate,
    at the end, is the time since the event to first order; the derivative of this quotient is
    exact, because the penetration is zero except for rounding. At a rate of zero the result is
    zero. Contacts whose force has no jump and no kink at the event are left out.
    """

    jumping = _jumping_contacts(scene)
    count = sum(map(len, jumping.values()))

    def time(name: str, label: str) -> Scalar:
        return shared_by_many(count, _contact_time, before[name][label], after[name][label])

    return each_label(time, jumping)


def _contact_time(start: ContactGap, end: ContactGap) -> Scalar:
    _, since = time_since_event(start, end)
    # After an end, the solver has assumed the force for too long, by the time since the end.
    return jnp.where(end.depth > 0.0, since, -since)


def time_since_event(start: ContactGap, end: ContactGap) -> tuple[Condition, Scalar]:
    """Return whether a contact begins or ends in a step, from its gaps at the step's `start` and
    `end`; and the time from this event to the step's end, s, zero without an event."""
    # At a rate of zero the quotient is undefined; the divisor 1 keeps its derivatives finite.
    moves = _changes(start, end) & (end.rate != 0.0)
    return moves, jnp.where(moves, end.depth / jnp.where(moves, end.rate, 1.0), 0.0)


def _mean_forces(
    joint: AbstractContactJoint,
    motions: Motions,
    labels: tuple[str, ...],
    speeds: Mapping[str, Scalar],
    bristles: Mapping[str, Vector],
) -> list[LoadedContact]:
    contacts = joint.contacts(motions)
    return [
        _mean_force(joint, label, contacts[label], speeds.get(label), motions, bristles)
        for label in labels
    ]


def _mean_force(
    joint: AbstractContactJoint,
    label: str,
    contact: Contact,
    speed: Scalar | None,
    motions: Motions,
    bristles: Mapping[str, Vector],
) -> LoadedContact:
    """Return the mean force of one contact over the time from the event to the end of the step.

    **Arguments:** `contact`, `motions`: at the end of the step; `speed`: entry speed of the
    contact, m/s, zero in flight, ``None`` if its law uses none; `bristles`: deflections of the
    joint's contacts, m, by label.
    """
    # The contact counts as closed, so that it has a force also if the step ends just outside.
    law, closed = joint.laws()[label], jnp.asarray(True)
    if speed is not None:
        # A contact that begins at this event has no entry speed yet. It will get its present rate.
        speed = jnp.where(speed > 0.0, speed, contact.gap.rate)

    def force(contact: Contact) -> LoadedContact:
        return contact_force(joint, label, law, contact, speed, closed, motions, bristles)

    def at_depth(depth: Scalar) -> LoadedContact:
        return force(replace(contact, gap=replace(contact.gap, depth=depth)))

    # The force begins where the depth is minus the law's `onset_offset`, the distance of the
    # surfaces at the onset. This place is here called the wall.
    # If only the force jumps, the mean is its value at the end of the step, or at the wall if the
    # step ends outside of it.
    if not law.slope_jumps():
        return at_depth(jnp.maximum(contact.gap.depth, depth_at_wall(law)))
    # If only the slope jumps, the force is zero at the wall, and the mean is half of the force at
    # the end of the step.
    if not law.force_jumps:
        return _multiplied(force(contact), 0.5)
    # Otherwise the mean is that of the forces at the wall and at the end of the step.
    at_wall = at_depth(depth_at_wall(law))
    return jax.tree.map(lambda a, b: 0.5 * (a + b), force(contact), at_wall)


def _multiplied(force: LoadedContact, factor: Scalar) -> LoadedContact:
    """Return the contact with its forces and moment times `factor`, without bristle rates."""
    forces = force.normal_force, force.elastic_force, force.friction, force.friction_moment
    # Friction and its moment may be ``None``, which has no leaves.
    normal, elastic, friction, moment = jax.tree.map(lambda number: number * factor, forces)
    return LoadedContact(force.contact, normal, elastic, friction, friction_moment=moment)
