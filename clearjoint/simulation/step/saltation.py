"""What is left of a jump of the forces in a step that ends at it.

Where a step ends is no function of the parameters; where the force jumps is one. A contact that
began a time tau before the end of the step pushed for that long: tau is zero to rounding, but its
derivative isn't. With rates f- before the jump and f+ after it the state is y + (f+ - f-) tau, and
that has the derivative of the motion across the jump (the saltation matrix: R. I. Leine,
H. Nijmeijer 2004, section 7.3), whoever differentiates it.

The forces are means over tau. So of a force whose slope alone jumps, as that of a spring, what is
left is K delta tau/2: without it derivatives miss by tau, which is much where two contacts of a
stiff spring begin a millionth of a contact's time apart.
"""

from collections.abc import Mapping
from dataclasses import replace

import jax
import jax.numpy as jnp

from ...dynamics.contact_events import ContactGap, ContactGaps
from ...dynamics.contact_forces import INSIDE, EntrySpeeds, LoadedContact, contact_force
from ...dynamics.system import System
from ...math.groups import any_
from ...math.vectors import Condition, Scalar, Vector
from ...model.joints.base import AbstractContactJoint, Contact, Motions
from ...model.scene import Scene
from .step_state import Variables

Times = dict[str, dict[str, Scalar]]
"""Times in s for which contacts pushed, by joint and contact."""


def contacts_jump(scene: Scene) -> bool:
    """Whether the force of any contact may jump where it begins or ends."""
    return any(law.force_jumps for family in scene.laws().values() for law in family.values())


def slopes_jump(scene: Scene) -> bool:
    """Whether the slope of any contact's force may jump where it begins or ends."""
    return any(law.slope_jumps() for family in scene.laws().values() for law in family.values())


def across_contacts(
    system: System,
    before: ContactGaps,
    y: Variables,
    entry_speeds: EntrySpeeds,
    t: Scalar,
    lands: Condition,
) -> Variables:
    """The variables at the end of a step, where it `lands` on the begin or end of contacts.

    `before` are the reaches, and `entry_speeds` the entry speeds, at its start.
    """

    def cross(y: Variables) -> Variables:
        times = _times(system.scene, before, system.contact_gaps(y.motion))
        forces = _mean_forces(system, y, entry_speeds)

        def rates(times: Times) -> Variables:
            impulses = {
                name: {
                    label: _multiplied(forces[name][label], time) for label, time in family.items()
                }
                for name, family in times.items()
            }
            dynamics = system.dynamics_under(y.motion, impulses, t)
            powers = system.powers(dynamics, t)
            return jax.tree.map(jnp.asarray, Variables(dynamics.variable_rates, powers))

        none = jax.tree.map(jnp.zeros_like, times)
        return _changed_by(y, jax.jvp(rates, (none,), (times,))[1])

    changes = any_changes(system.scene, before, system.contact_gaps(y.motion))
    return jax.lax.cond(lands & changes, cross, lambda y: y, y)


def _jumping_contacts(scene: Scene) -> dict[str, list[str]]:
    """The contacts whose force, or its slope, may jump, by joint."""
    labels_by_joint = {
        name: [label for label, law in family.items() if law.force_jumps or law.slope_jumps()]
        for name, family in scene.laws().items()
    }
    return {name: labels for name, labels in labels_by_joint.items() if labels}


def _changes(before: ContactGap, after: ContactGap) -> Condition:
    return (before.depth > 0.0) != (after.depth > 0.0)


def any_changes(scene: Scene, before: ContactGaps, after: ContactGaps) -> Condition:
    """Whether a contact whose force or slope may jump then begins or ends between two instants."""
    any_change: Condition = jnp.asarray(False)
    for name, labels in _jumping_contacts(scene).items():
        for label in labels:
            any_change |= any_(_changes(before[name][label], after[name][label]))
    return any_change


def _times(scene: Scene, before: ContactGaps, after: ContactGaps) -> Times:
    """How much longer each contact pushed than the step says; negative where it ended."""

    def time(start: ContactGap, end: ContactGap) -> Scalar:
        moves = _changes(start, end) & (end.rate != 0.0)
        since = end.depth / jnp.where(moves, end.rate, 1.0)
        return jnp.where(moves, jnp.where(end.depth > 0.0, since, -since), 0.0)

    return {
        name: {label: time(before[name][label], after[name][label]) for label in labels}
        for name, labels in _jumping_contacts(scene).items()
    }


def _mean_forces(
    system: System, y: Variables, entry_speeds: EntrySpeeds
) -> dict[str, dict[str, LoadedContact]]:
    """The forces of closed contacts, means of those at the wall and where the step ends."""
    motions, joints = system.motions(y.motion), system.scene.contact_joints()
    forces: dict[str, dict[str, LoadedContact]] = {}
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
    """The mean force of one contact, as those of `_mean_forces`."""
    law, closed = joint.laws()[label], jnp.asarray(True)
    if entry_speed is not None:
        entry_speed = jnp.where(entry_speed > 0.0, entry_speed, contact.gap.rate)

    def force(contact: Contact) -> LoadedContact:
        return contact_force(joint, label, law, contact, entry_speed, closed, motions, bristles)

    def at_depth(depth: Scalar) -> LoadedContact:
        return force(replace(contact, gap=replace(contact.gap, depth=depth)))

    if not law.slope_jumps():
        return at_depth(jnp.maximum(contact.gap.depth, INSIDE - law.onset_offset()))
    if not law.force_jumps:
        return _multiplied(force(contact), 0.5)
    at_wall = at_depth(INSIDE - law.onset_offset())
    return jax.tree.map(lambda a, b: 0.5 * (a + b), force(contact), at_wall)


def _multiplied(force: LoadedContact, factor: Scalar) -> LoadedContact:
    friction = None if force.friction is None else force.friction * factor
    normal, elastic = force.normal_force * factor, force.elastic_force * factor
    return replace(force, normal_force=normal, elastic_force=elastic, friction=friction)


def _changed_by(y: Variables, change: Variables) -> Variables:
    motion = jax.tree.map(lambda value, by: value + by, y.motion, change.motion)
    work = {name: e + change.work.get(name, 0.0) for name, e in y.work.items()}
    return replace(y, motion=motion, work=work)
