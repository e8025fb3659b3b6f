"""Forces of contacts at an instant: normal force, its elastic part, and friction.

Without friction in a joint no slip is computed. Where friction comes from bristles, their
deflections are needed beside the motion, and their rates are found with the force: both follow from
the same slip. So deflections are variables of a run, as the motion is, and come here by joint and
contact; whoever has no such laws passes none.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import jax
import jax.numpy as jnp

from ..math.vectors import ZERO, Condition, Scalar, Vector
from ..model.bodies import GROUND, Wrench
from ..model.contact.bristles import AbstractBristleFriction
from ..model.contact.gap import Gap
from ..model.contact.laws import (
    UNKNOWN_ENTRY_SPEED,
    AbstractContactLaw,
    contact_normal_force,
)
from ..model.joints.base import AbstractContactJoint, ByLabel, Contact, Motions
from ..model.scene import Scene

EntrySpeeds: TypeAlias = ByLabel[Scalar]
"""Entry speed of each contact whose law remembers it, m/s; zero in flight."""
Closed: TypeAlias = ByLabel[Condition]
"""Whether each contact is closed."""
Bristles: TypeAlias = ByLabel[Vector]
"""Deflection of each contact's bristles, m, in the axes of its first body; zero in flight. Their
rates, m/s, have the same form."""
NO_BRISTLES: Bristles = {}
INSIDE = 1e-300
"""m: a depth at which a contact exists and nothing is compressed."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True, slots=True)
class LoadedContact:
    """A contact with the forces that it transmits: normal force N, friction vector or ``None``; and
    the rate of its bristles' deflection, m/s in the axes of the first body, ``None`` without."""

    contact: Contact
    normal_force: Scalar
    elastic_force: Scalar
    friction: Vector | None
    bristle_rate: Vector | None = None


def contact_forces(
    scene: Scene,
    motions: Motions,
    entry_speeds: EntrySpeeds,
    closed: Closed | None = None,
    bristles: Bristles = NO_BRISTLES,
) -> ByLabel[LoadedContact]:
    """Forces of all contacts, by joint and contact.

    If it is given which ones are `closed`, these alone have a force, and one whose slope jumps at
    the wall goes on past it: see `contact_force`. A closed one without an entry speed on record
    counts as elastic, as one that exists before a run does.
    """
    forces: ByLabel[LoadedContact] = {}
    for name, joint in scene.contact_joints().items():
        laws, contacts = joint.laws(), joint.contacts(motions)
        forces[name] = {}
        for label, contact in contacts.items():
            entry_speed = entry_speeds[name][label] if laws[label].uses_entry_speed else None
            pushes = None if closed is None else closed[name][label]
            if pushes is not None and entry_speed is not None:
                # Unlike the present rate this is the same in all stages of a step.
                entry_speed = jnp.where(entry_speed > 0.0, entry_speed, UNKNOWN_ENTRY_SPEED)
            forces[name][label] = contact_force(
                joint,
                label,
                laws[label],
                contact,
                entry_speed,
                pushes,
                motions,
                bristles.get(name, {}),
            )
    return forces


def contact_wrenches(
    joint: AbstractContactJoint,
    contact: Contact,
    normal_force: Scalar,
    friction: Vector | None,
    motions: Motions,
) -> Iterator[tuple[str, Wrench]]:
    """What a contact of a joint with such forces, N, does to its bodies but the ground, each by
    name."""
    first, second = joint.pair()
    if contact.turning is not None:
        for name, turning in zip((first, second), contact.turning, strict=True):
            if name != GROUND:
                yield name, Wrench(ZERO, turning * -normal_force)
        return
    push = -(contact.normal * normal_force)
    if friction is not None:
        push = push + friction
    on_first, on_second = contact.points_of_force(friction is not None)
    if second != GROUND:
        yield second, motions[second].wrench(push, on_second)
    if first != GROUND:
        yield first, motions[first].wrench(-push, on_first)


def contact_force(
    joint: AbstractContactJoint,
    label: str,
    law: AbstractContactLaw,
    contact: Contact,
    entry_speed: Scalar | None,
    closed: Condition | None,
    motions: Motions,
    bristles: Mapping[str, Vector],
) -> LoadedContact:
    """The forces of one contact of a joint with such `bristles`.

    If it is said whether the contact is `closed`, an open one has none. That of a closed one whose
    slope would jump where the surfaces part goes on there: at a depth below zero it pulls by as
    much as it would push so far above. The stages of a step that ends where the contact does lie
    on either side, and no step were short enough for the error of its derivatives. Its
    `entry_speed`, if its law has memory, is positive.
    """

    def normal_force(gap: Gap) -> Scalar:
        if closed is not None:
            return law.force(gap, entry_speed)
        return contact_normal_force(law, gap, entry_speed)

    normal = _held(normal_force, law, contact.gap, closed)
    elastic = _held(law.elastic_force, law, contact.gap, closed)
    if bristle_law := joint.bristle_laws().get(label):
        exists = contact.gap.depth + law.onset_offset() > 0.0 if closed is None else closed
        to_first = motions[joint.pair()[0]]
        deflection = to_first.direction(bristles[label])
        friction, rate = _bristle_friction(bristle_law, contact, deflection, normal)
        rate = _where(exists, to_first.components(rate))
        return LoadedContact(contact, normal, elastic, friction, rate)
    if closed is None or not law.slope_jumps():
        return LoadedContact(contact, normal, elastic, joint.friction_force(label, contact, normal))
    sense = jnp.where(normal < 0.0, -1.0, 1.0)
    friction = joint.friction_force(label, contact, normal * sense)
    return LoadedContact(contact, normal, elastic, None if friction is None else friction * sense)


def _held(
    force: Callable[[Gap], Scalar], law: AbstractContactLaw, gap: Gap, closed: Condition | None
) -> Scalar:
    """A force of a law with a gap, N, of a contact that is held open or `closed`, if that is said:
    past the wall the reflection of that before it."""
    if closed is None:
        return force(gap)
    if not law.slope_jumps():
        return jnp.where(closed, force(gap), 0.0)
    past = closed & (gap.depth + law.onset_offset() < 0.0)
    pushing = force(
        replace(gap, depth=jnp.where(past, -gap.depth - 2.0 * law.onset_offset(), gap.depth))
    )
    at_wall = force(replace(gap, depth=INSIDE - law.onset_offset())) if law.force_jumps else 0.0
    return jnp.where(closed, jnp.where(past, 2.0 * at_wall - pushing, pushing), 0.0)


def _bristle_friction(
    law: AbstractBristleFriction, contact: Contact, deflection: Vector, normal_force: Scalar
) -> tuple[Vector, Vector]:
    """Friction on the second body, N, and the rate of the deflection, m/s, in global axes."""
    assert contact.slip is not None, "a contact with bristles has a slip"
    rate = law.rate(deflection, contact.slip)
    ratio = law.ratio(deflection, rate, contact.slip)
    across = ratio - contact.normal * ratio.dot(contact.normal)
    return across * -normal_force, rate


def _where(condition: Condition, vector: Vector) -> Vector:
    return Vector(*(jnp.where(condition, part, 0.0) for part in vector))
