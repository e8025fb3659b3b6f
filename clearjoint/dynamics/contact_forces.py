"""Forces of contacts at an instant: normal force, its elastic part, and friction.

Without friction in a joint no slip is computed.
"""

from dataclasses import dataclass
from typing import TypeAlias

import jax
import jax.numpy as jnp

from ..math.vectors import Condition, Scalar, Vector
from ..model.contact.laws import AbstractContactLaw, contact_normal_force
from ..model.joints.base import AbstractContactJoint, ByLabel, Contact, Motions
from ..model.scene import Scene

Memory: TypeAlias = ByLabel[Scalar]
"""Entry speed of each contact whose law remembers it, m/s; zero in flight."""
Closed: TypeAlias = ByLabel[Condition]
"""Whether each contact is closed."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True, slots=True)
class LoadedContact:
    """A contact with the forces that it transmits: normal force N, friction vector or ``None``."""

    contact: Contact
    normal_force: Scalar
    elastic_force: Scalar
    friction: Vector | None


def contact_forces(
    scene: Scene, motions: Motions, memory: Memory, closed: Closed | None = None
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
                joint, label, laws[label], contact, entry_speed, pushes
            )
    return forces


def contact_force(
    joint: AbstractContactJoint,
    label: str,
    law: AbstractContactLaw,
    contact: Contact,
    entry_speed: Scalar | None,
    closed: Condition | None = None,
) -> LoadedContact:
    """The forces of one contact; none if it is said not to be `closed`."""
    normal = contact_normal_force(law, contact.gap, entry_speed)
    if closed is not None:
        normal = jnp.where(closed, normal, 0.0)
    friction = joint.friction_force(label, contact, normal)
    elastic = law.elastic_force(contact.gap)
    if closed is not None:
        elastic = jnp.where(closed, elastic, 0.0)
    return LoadedContact(contact, normal, elastic, friction)
