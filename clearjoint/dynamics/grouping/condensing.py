"""Grouping of bodies and clearance joints that differ only in their numbers, so that cost grows
slowly with their count.

If each element were written out in the compiled program, each would cost machine code: the stepping
loop of a chain of 16 rods exceeds the processor's caches and takes minutes to compile. The elements
of a group share code, and are computed as arrays by the processor's vector units.

Bodies form a group if they move freely (no ideal joint, and no `Anchor`, a fixed point near the
body from which its position is measured) and their numbers have the same pattern of exact zeros and
ones. Clearance joints form a group under two conditions: they differ only in numbers and in names
of bodies; and the first bodies of all of them are the same body or are in the same group, as are
the second bodies. A run keeps the state of a group as arrays, which are made at its start and split
by names at its end. Groups are found while JAX traces, from names and structure alone. A scene in
which groups replace the single elements is called condensed.
"""

import copy
import dataclasses
from collections.abc import Hashable, Mapping
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ...math.groups import GroupName, by_name, is_structural, stack
from ...math.vectors import Matrix, Vector
from ...model.bodies import GROUND, GROUND_MOTION, Motion
from ...model.clearance_joints.grouped_contacts import GroupedContactJoint
from ...model.joints.base import AbstractContactJoint
from ...model.scene import Scene

SMALLEST = 4
"""Smallest number of elements that form a group. Fewer elements are written out, since their code
stays small."""
T = TypeVar("T")

ROLES = ("the first body", "the second body")
"""Names that replace those of a joint's first and second body when joints are compared with each
other."""


def condensed(scene: Scene) -> Scene:
    """Return a scene in which groups replace elements that differ only in their numbers.

    The keys of the groups in ``bodies`` and ``joints`` are `GroupName`s: strings with the names of
    the members.

    **Arguments:** `scene`: a scene with each vector as three separate scalars. In a group of n
    elements, each of the returned scene's scalars is an array (n,), except exact zeros and ones,
    which are the same in all elements.
    """
    order, constrained, contacts = _order(scene), _constrained_bodies(scene), scene.contact_joints()
    free = {name: _structure(scene.bodies[name]) for name in order if name not in constrained}
    bodies = {
        GroupName(names): stack([scene.bodies[name] for name in names])
        for names in _groups_of(free)
    }
    # Bodies are grouped first, since joints can share a group only if their bodies do.
    group_of = {member: group for group in bodies for member in group.members}

    def bodies_of(name: str) -> list[int]:
        """Return the places of a joint's two bodies, the later one first; -1 for the ground."""
        return sorted((order.get(body, -1) for body in contacts[name].pair()), reverse=True)

    # Joints are sorted by their bodies' places in the chain, so that neighbouring joints of a group
    # have neighbouring bodies (see `_order`).
    in_order = sorted(contacts, key=bodies_of)
    structures = {name: _joint_structure(contacts[name], group_of) for name in in_order}
    joints = {
        GroupName(names): _joint_group([contacts[name] for name in names])
        for names in _groups_of(structures)
    }
    parts = _with_groups(scene.bodies, bodies), _with_groups(scene.joints, joints)
    return eqx.tree_at(lambda s: (s.bodies, s.joints), scene, parts)


def whole(scene: Scene) -> Scene:
    """Return the scene with single elements from which `condensed` made the given scene."""
    joints = {}
    for name, joint in scene.joints.items():
        if isinstance(joint, GroupedContactJoint):
            assert isinstance(name, GroupName)
            joints |= dict(zip(name.members, joint.members, strict=True))
        else:
            joints[name] = joint
    return eqx.tree_at(lambda s: (s.bodies, s.joints), scene, (by_name(scene.bodies), joints))


def groups(scene: Scene) -> list[GroupName]:
    """Return the names of the groups in a condensed scene: first the groups of bodies, then those
    of joints."""
    return [name for name in (*scene.bodies, *scene.joints) if isinstance(name, GroupName)]


def _with_groups(family: Mapping[str, T], groups: Mapping[GroupName, T]) -> dict[str, T]:
    """Return bodies or joints by name, in which `groups` replace their members."""
    grouped = {member for group in groups for member in group.members}
    return {name: one for name, one in family.items() if name not in grouped} | dict(groups)


def _joint_group(joints: list[AbstractContactJoint]) -> GroupedContactJoint:
    """Return one joint for a group of n joints, whose numbers are arrays (n,).

    Each of its two bodies is a group of bodies, or the ground.
    """
    first, second = zip(*(joint.pair() for joint in joints), strict=True)
    return GroupedContactJoint(
        stack([_renamed(joint, joints[0].pair()) for joint in joints]),
        tuple(joints),
        *(GROUND if GROUND in names else GroupName(names) for names in (first, second)),
    )


def _groups_of(keys: Mapping[str, Hashable | None]) -> list[list[str]]:
    """Sort names into groups with equal keys.

    Groups of fewer than `SMALLEST` names are left out, and so are names whose key is ``None``.

    **Arguments:** `keys`: the key of each name.

    **Returns:** the names in each group.
    """
    families: dict[Hashable, list[str]] = {}
    for name, key in keys.items():
        if key is not None:
            families.setdefault(key, []).append(name)
    return [names for names in families.values() if len(names) >= SMALLEST]


def _structure(tree: PyTree) -> Hashable | None:
    """Return a hashable key that is equal for PyTrees whose scalars can be stacked to arrays, or
    ``None`` if a leaf is no scalar.

    Such PyTrees have the same structure, and the same exact zeros and ones.
    """
    leaves, structure = jax.tree.flatten(tree)
    parts = []
    for leaf in leaves:
        if is_structural(leaf):
            parts.append(leaf)
        elif eqx.is_array_like(leaf) and jnp.ndim(leaf) == 0:
            parts.append(None)
        else:
            return None
    return structure, tuple(parts)


def _joint_structure(joint: AbstractContactJoint, group_of: Mapping[str, GroupName]) -> Hashable:
    """Return a hashable key that is equal for joints that can form a group, or ``None`` if the
    joint cannot be grouped.

    **Arguments:** `group_of`: the group of each grouped body, by the body's name.
    """
    pair = joint.pair()
    # A group of joints has only forces on two groups of bodies. So a joint that acts on further
    # bodies, has an anchor or has constraints is not grouped.
    if set(joint.body_names()) != set(pair) or joint.anchor() is not None or _has_rows(joint):
        return None
    anonymous = _renamed(joint, ROLES)
    structure = _structure(anonymous)
    # Renaming works only if the joint takes the names of its bodies from its fields.
    if structure is None or anonymous.pair() != _roles(joint, ROLES):
        return None
    # The first bodies of a group of joints are in one group, so that their motions are elements of
    # the same arrays; so are the second bodies.
    return structure, tuple(joint.laws()), tuple(group_of.get(name, name) for name in pair)


def _roles(joint: AbstractContactJoint, names: tuple[str, str]) -> tuple[str, ...]:
    """Return `names` as names of the joint's two bodies, except that the ground keeps its own
    name."""
    return tuple(
        GROUND if name == GROUND else role for name, role in zip(joint.pair(), names, strict=True)
    )


def _renamed(joint: AbstractContactJoint, names: tuple[str, str]) -> AbstractContactJoint:
    """Return a copy of a joint in which `names` replace the names of its two bodies, except the
    ground's.

    The checks at construction do not run, since they do not accept vectors as separate scalars.
    """
    new_names = dict(zip(joint.pair(), _roles(joint, names), strict=True))
    renamed = copy.copy(joint)
    # Names are static fields. A field with another string, such as a label, is kept.
    for field in dataclasses.fields(joint):
        name = getattr(joint, field.name)
        if field.metadata.get("static", False) and isinstance(name, str):
            object.__setattr__(renamed, field.name, new_names.get(name, name))
    return renamed


def _has_rows(joint: AbstractContactJoint) -> bool:
    """Return whether a joint has constraint equations besides its contacts."""
    number = jnp.ones(())
    vector = Vector(number, number, number)
    motion = Motion(vector, Matrix(vector, vector, vector), vector, vector)
    motions = {**dict.fromkeys(joint.body_names(), motion), GROUND: GROUND_MOTION}
    # Only the number of the rows matters, so they are evaluated for their shapes alone.
    return bool(jax.eval_shape(lambda: joint.rows(motions, number)))


def _constrained_bodies(scene: Scene) -> set[str]:
    """Return the names of bodies that have constraint equations or an anchor, and so cannot be
    grouped."""
    contacts = scene.contact_joints()
    return {
        body
        for name, joint in scene.joints.items()
        if name not in contacts or contacts[name].anchor() is not None or _has_rows(contacts[name])
        for body in joint.body_names()
    }


def _order(scene: Scene) -> dict[str, int]:
    """Return the index of each body, by name, in an order in which neighbours in a chain are
    consecutive.

    In this order, the first bodies of a group of joints, and their second bodies, are slices of a
    group of bodies. Slices are cheaper than gathers.
    """
    neighbours: dict[str, list[str]] = {name: [] for name in (GROUND, *scene.bodies)}
    for joint in scene.contact_joints().values():
        first, second = joint.pair()
        neighbours[first].append(second)
        neighbours[second].append(first)
    # A depth-first walk along the clearance joints, from the ground on, numbers a chain from one
    # end to the other. Bodies that it does not reach are numbered last, by further walks.
    indices: dict[str, int] = {}
    waiting = [*reversed(scene.bodies), GROUND]
    while waiting:
        name = waiting.pop()
        if name not in indices:
            indices[name] = len(indices)
            waiting += reversed(neighbours[name])
    return {name: index for name, index in indices.items() if name != GROUND}
