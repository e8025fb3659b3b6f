"""Saltation correction for a step that ends at a force discontinuity.

The time of an onset, or of the end of a contact, depends on the parameters. The step that lands
there ends at a time t1 that is not differentiated. Let tau be the time from the event to t1, s. The
landing makes tau zero to rounding, but not its derivative. The step was computed with the rates f-
before the event; the rates after the event are f+. The corrected state y + (f+ - f-) tau has the
derivative of the motion across the event (the saltation matrix: R. I. Leine, H. Nijmeijer 2004,
section 7.3), in forward and in reverse mode.

The contact force in f+ is a mean over tau. If the force is continuous and only its slope K, N/m,
jumps, as for a spring, the mean is K delta/2 for the penetration delta, m, at t1. Without this term
derivatives have an error proportional to tau, which is visible if two contacts of a stiff spring
begin a millionth of the contact time apart.
"""

from collections.abc import Mapping
from dataclasses import replace

import jax
import jax.numpy as jnp

from ...dynamics.contact_events import ContactGap, ContactGaps, any_of
from ...dynamics.contact_forces import INSIDE, EntrySpeeds, LoadedContact, contact_force
from ...dynamics.system import System
from ...math.vectors import Condition, Scalar, Vector
from ...model.joints.base import AbstractContactJoint, ByLabel, Contact, Motions
from ...model.scene import Scene
from .step_state import Variables


def contacts_jump(scene: Scene) -> bool:
    """Return whether the force of any contact may jump where the contact begins or ends."""
    return any(law.force_jumps for family in scene.laws().values() for law in family.values())


def slopes_jump(scene: Scene) -> bool:
    """Return whether the slope of any contact's force, N/m, may jump where the contact begins or
    ends."""
    return any(law.slope_jumps() for family in scene.laws().values() for law in family.values())


def across_contacts(
    system: System,
    before: ContactGaps,
    y: Variables,
    entry_speeds: EntrySpeeds,
    t: Scalar,
    keep: Condition,
) -> Variables:
    """Return the variables at the end of a step, corrected for contacts that begin or end there.

    **Arguments:**

    - `before`, `entry_speeds`: contact gaps and entry speeds, m/s, at the start of the step.
    - `y`: variables at the end of the step; `t`: the time there, s.
    - `keep`: whether the step is accepted; otherwise `y` is returned.
    """

    def corrected(y: Variables) -> Variables:
        times = _contact_times(system.scene, before, system.contact_gaps(y.motion))
        forces = _mean_forces(system, y, entry_speeds)

        def rates(times: ByLabel[Scalar]) -> Variables:
            impulses = {
                name: {
                    label: _multiplied(forces[name][label], time) for label, time in family.items()
                }
                for name, family in times.items()
            }
            dynamics = system.dynamics_under(y.motion, impulses, t)
            powers = system.powers(dynamics, t)
            return jax.tree.map(jnp.asarray, Variables(dynamics.variable_rates, powers))

        # Rates are linear in the contact forces, except for terms that do not depend on them
        # (gravity, springs, gyroscopic terms). The derivative along `times` at zero removes these
        # terms, and yields f+ - f- times tau including the reactions of the constraints.
        none = jax.tree.map(jnp.zeros_like, times)
        return _changed_by(y, jax.jvp(rates, (none,), (times,))[1])

    changes = any_changes(system.scene, before, system.contact_gaps(y.motion))
    return jax.lax.cond(keep & changes, corrected, lambda y: y, y)


def _jumping_contacts(scene: Scene) -> dict[str, list[str]]:
    """Return the labels of contacts whose force, or the slope of the force, may jump, by joint
    name."""
    labels_by_joint = {
        name: [label for label, law in family.items() if law.force_jumps or law.slope_jumps()]
        for name, family in scene.laws().items()
    }
    return {name: labels for name, labels in labels_by_joint.items() if labels}


def _changes(before: ContactGap, after: ContactGap) -> Condition:
    return (before.depth > 0.0) != (after.depth > 0.0)


def any_changes(scene: Scene, before: ContactGaps, after: ContactGaps) -> Condition:
    """Return whether, between two instants, a contact begins or ends whose force or slope may
    jump."""
    return any_of(
        _changes(before[name][label], after[name][label])
        for name, labels in _jumping_contacts(scene).items()
        for label in labels
    )


def _contact_times(scene: Scene, before: ContactGaps, after: ContactGaps) -> ByLabel[Scalar]:
    """Return by how much longer each contact transmitted its force than the solver assumed, s, by
    joint and contact.

    The time is positive after an onset, negative after an end, and zero if there was no event. The
    solver computes a step with the contacts that are closed at its start: it omits the force after
    an onset and includes too much force after an end. Penetration over rate is the time since the
    event to first order; the derivative of this quotient is exact because the penetration is zero
    to rounding.
    """

    def time(start: ContactGap, end: ContactGap) -> Scalar:
        moves = _changes(start, end) & (end.rate != 0.0)
        since = end.depth / jnp.where(moves, end.rate, 1.0)
        return jnp.where(moves, jnp.where(end.depth > 0.0, since, -since), 0.0)

    return {
        name: {label: time(before[name][label], after[name][label]) for label in labels}
        for name, labels in _jumping_contacts(scene).items()
    }


def _mean_forces(system: System, y: Variables, entry_speeds: EntrySpeeds) -> ByLabel[LoadedContact]:
    """Return the mean force of each contact that may jump, by joint and contact.

    The mean is over the time from the event to the end of the step. It is found for each contact,
    whether or not the contact has an event in this step.
    """
    motions, joints = system.motions(y.motion), system.scene.contact_joints()
    forces: ByLabel[LoadedContact] = {}
    for name, labels in _jumping_contacts(system.scene).items():
        joint, bristles = joints[name], y.bristles.get(name, {})
        contacts, speeds = joint.contacts(motions), entry_speeds.get(name, {})
        forces[name] = {
            label: _mean_force(joint, label, contacts[label], speeds.get(label), motions, bristles)
            for label in labels
        }
    return forces


def _mean_force(
    joint: AbstractContactJoint,
    label: str,
    contact: Contact,
    entry_speed: Scalar | None,
    motions: Motions,
    bristles: Mapping[str, Vector],
) -> LoadedContact:
    """Return the mean of the force of one contact between the event and the end of the step.

    **Arguments:** `entry_speed`: m/s, zero in flight, ``None`` if the law does not use it;
    `bristles`: deflections of the joint's contacts, m.
    """
    law, closed = joint.laws()[label], jnp.asarray(True)
    if entry_speed is not None:
        # A contact that begins at this event has no entry speed yet: its rate will be recorded.
        entry_speed = jnp.where(entry_speed > 0.0, entry_speed, contact.gap.rate)

    def force(contact: Contact) -> LoadedContact:
        return contact_force(joint, label, law, contact, entry_speed, closed, motions, bristles)

    def at_depth(depth: Scalar) -> LoadedContact:
        return force(replace(contact, gap=replace(contact.gap, depth=depth)))

    # Only the force jumps: its value at the wall, or at the end of the step if that is inside.
    if not law.slope_jumps():
        return at_depth(jnp.maximum(contact.gap.depth, INSIDE - law.onset_offset()))
    # Only the slope jumps: the force is zero at the wall, so the mean is half of that at the end.
    if not law.force_jumps:
        return _multiplied(force(contact), 0.5)
    at_wall = at_depth(INSIDE - law.onset_offset())
    return jax.tree.map(lambda a, b: 0.5 * (a + b), force(contact), at_wall)


def _multiplied(force: LoadedContact, factor: Scalar) -> LoadedContact:
    """Return the contact with its normal force, elastic force and friction times `factor`."""
    friction = None if force.friction is None else force.friction * factor
    normal, elastic = force.normal_force * factor, force.elastic_force * factor
    return replace(force, normal_force=normal, elastic_force=elastic, friction=friction)


def _changed_by(y: Variables, change: Variables) -> Variables:
    """Return the variables with changes of the motion and of the ledger added. Bristles stay:
    `updated_bristles` sets them."""
    motion = jax.tree.map(lambda value, by: value + by, y.motion, change.motion)
    work = {name: e + change.work.get(name, 0.0) for name, e in y.work.items()}
    return replace(y, motion=motion, work=work)
