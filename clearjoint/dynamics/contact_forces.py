"""Forces of contacts at an instant: normal force, its elastic part, and friction.

Without friction in a joint no slip is computed. Where friction comes from bristles, their
deflections are needed beside the motion, and their rates are found with the force: both follow from
the same slip. So deflections are variables of a run, as the motion is, and come here by joint and
contact; whoever has no such laws passes none.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import jax
import jax.numpy as jnp

from ..math.vectors import ZERO, Condition, Scalar, Vector
from ..model.bodies import GROUND, Wrench
from ..model.contact.bristles import AbstractBristleFriction
from ..model.contact.laws import AbstractContactLaw, contact_normal_force
from ..model.joints.base import AbstractContactJoint, ByLabel, Contact, Motions
from ..model.scene import Scene

Memory: TypeAlias = ByLabel[Scalar]
"""Entry speed of each contact whose law remembers it, m/s; zero in flight."""
Closed: TypeAlias = ByLabel[Condition]
"""Whether each contact is closed."""
Bristles: TypeAlias = ByLabel[Vector]
"""Deflection of each contact's bristles, m, in the axes of its first body; zero in flight. Their
rates, m/s, have the same form."""
NO_BRISTLES: Bristles = {}


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
    memory: Memory,
    closed: Closed | None = None,
    bristles: Bristles = NO_BRISTLES,
) -> ByLabel[LoadedContact]:
    """Forces of all contacts, by joint and contact; only `closed` ones push, if these are given."""
    forces: ByLabel[LoadedContact] = {}
    for name, joint in scene.contact_joints().items():
        laws, contacts = joint.laws(), joint.contacts(motions)
        forces[name] = {}
        for label, contact in contacts.items():
            entry_speed = memory[name][label] if laws[label].has_memory else None
            pushes = None if closed is None else closed[name][label]
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
    """The forces of one contact of a joint with such `bristles`; none if it is said not to be
    `closed`."""
    normal = contact_normal_force(law, contact.gap, entry_speed)
    if closed is not None:
        normal = jnp.where(closed, normal, 0.0)
    elastic = law.elastic_force(contact.gap)
    if closed is not None:
        elastic = jnp.where(closed, elastic, 0.0)
    if bristle_law := joint.bristle_laws().get(label):
        exists = contact.gap.depth + law.reach() > 0.0 if closed is None else closed
        to_first = motions[joint.pair()[0]]
        deflection = to_first.direction(bristles[label])
        friction, rate = _bristle_friction(bristle_law, contact, deflection, normal)
        rate = _where(exists, to_first.components(rate))
        return LoadedContact(contact, normal, elastic, friction, rate)
    return LoadedContact(contact, normal, elastic, joint.friction_force(label, contact, normal))


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
