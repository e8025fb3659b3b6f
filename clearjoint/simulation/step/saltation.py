"""Saltation correction for a step that ends at a force discontinuity.

A step lands on the onset or end of a contact, and its end time is not differentiated. The time of
the event is a function of the parameters. A contact that began a time tau before the end of the
step transmitted its force for tau: the landing makes tau zero to rounding, but not its derivative.
With the rates f- before the event and f+ after it, the state is y + (f+ - f-) tau. Its derivative
is that of the motion across the event (the saltation matrix: R. I. Leine, H. Nijmeijer 2004,
section 7.3), in forward and in reverse mode.

The forces are means over tau. If the force is continuous and only its slope K jumps, as for a
spring, the mean is K delta/2 for the penetration delta at the end of the step. Without this term
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
    keep: Condition,
) -> Variables:
    """Return the variables at the end of a step, corrected for contacts that begin or end in it.

    **Arguments:** `before`: the contact gaps, and `entry_speeds` the entry speeds, at the start of
    the step; `y`: the variables at its end; `t`: s, its end; `keep`: whether it is accepted.
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
    """Return the labels of contacts whose force or its slope may jump, by joint."""
    labels_by_joint = {
        name: [label for label, law in family.items() if law.force_jumps or law.slope_jumps()]
        for name, family in scene.laws().items()
    }
    return {name: labels for name, labels in labels_by_joint.items() if labels}


def _changes(before: ContactGap, after: ContactGap) -> Condition:
    return (before.depth > 0.0) != (after.depth > 0.0)


def any_changes(scene: Scene, before: ContactGaps, after: ContactGaps) -> Condition:
    """Whether a contact whose force or slope may jump begins or ends between two instants."""
    return any_of(
        _changes(before[name][label], after[name][label])
        for name, labels in _jumping_contacts(scene).items()
        for label in labels
    )


def _contact_times(scene: Scene, before: ContactGaps, after: ContactGaps) -> ByLabel[Scalar]:
    """Return by how much longer each contact transmitted its force than the solver assumed, s.

    Positive after an onset, negative after an end, zero without either. A step computes with the
    contacts closed at its start, so it omits the force after an onset and has too much of it after
    an end. Penetration over rate is the time since the event to first order, which is exact for the
    derivative as the penetration is zero to rounding.
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
    """Return the forces of closed contacts, averaged between the wall and the end of the step."""
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
    """Return the mean force of one contact, as in `_mean_forces`."""
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
    friction = None if force.friction is None else force.friction * factor
    normal, elastic = force.normal_force * factor, force.elastic_force * factor
    return replace(force, normal_force=normal, elastic_force=elastic, friction=friction)


def _changed_by(y: Variables, change: Variables) -> Variables:
    """Add changes of motion and ledger; bristles are set in `updated_bristles`."""
    motion = jax.tree.map(lambda value, by: value + by, y.motion, change.motion)
    work = {name: e + change.work.get(name, 0.0) for name, e in y.work.items()}
    return replace(y, motion=motion, work=work)
