"""Alike elements of a scene put together, so that cost grows slowly with their number.

Written out, each element costs machine code: the stepping loop of a chain of 16 rods outgrows the
caches and takes minutes to compile. Put together, the elements of a group share the code, and the
processor's vector units do several at a time.

Bodies form a group if they move freely (no ideal joint holds them, and no `Anchor` keeps their
digits) and their numbers have the same pattern of structural zeros and ones; clearance joints if
they are of one structure but for the names of their bodies, and each of the two bodies is in the
same group for all of them, or the same. The state of a group remains together for a whole run;
names are taken apart at its ends. Everything happens while tracing, from names and structure.
"""

import copy
import dataclasses
from collections.abc import Hashable, Iterable, Mapping
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ...math.groups import GroupName, by_name, is_structural, stack
from ...math.vectors import Matrix, Vector
from ...model.bodies import GROUND, GROUND_MOTION, Motion
from ...model.clearance_joints.alike_contacts import SeveralContactJoints
from ...model.joints.base import AbstractContactJoint
from ...model.scene import Scene

SMALLEST = 4
"""Elements from which on they are put together."""
T = TypeVar("T")

ROLES = ("the first body", "the second body")


def condensed(scene: Scene) -> Scene:
    """The scene (in scalar form) with its alike elements put together, under `GroupName` names."""
    order, held, contacts = _order(scene), _held_bodies(scene), scene.contact_joints()
    free = {name: _structure(scene.bodies[name]) for name in order if name not in held}
    bodies = {
        GroupName(names): stack([scene.bodies[name] for name in names]) for names in _alike(free)
    }
    group_of = {member: group for group in bodies for member in group.members}
    structures = {
        name: _joint_structure(contacts[name], group_of) for name in _by_bodies(contacts, order)
    }
    joints = {
        GroupName(names): _together([contacts[name] for name in names])
        for names in _alike(structures)
    }
    return eqx.tree_at(
        lambda s: (s.bodies, s.joints),
        scene,
        (_with_groups(scene.bodies, bodies), _with_groups(scene.joints, joints)),
    )


def whole(scene: Scene) -> Scene:
    """The scene that was condensed."""
    joints = {}
    for name, joint in scene.joints.items():
        if isinstance(joint, SeveralContactJoints):
            assert isinstance(name, GroupName)
            joints |= dict(zip(name.members, joint.members, strict=True))
        else:
            joints[name] = joint
    return eqx.tree_at(lambda s: (s.bodies, s.joints), scene, (by_name(scene.bodies), joints))


def groups(scene: Scene) -> list[GroupName]:
    """The names of the groups of bodies and joints of a condensed scene."""
    return [name for name in (*scene.bodies, *scene.joints) if isinstance(name, GroupName)]


def _with_groups(family: Mapping[str, T], groups: Mapping[GroupName, T]) -> dict[str, T]:
    placed = {member for group in groups for member in group.members}
    return {name: one for name, one in family.items() if name not in placed} | dict(groups)


def _together(joints: list[AbstractContactJoint]) -> SeveralContactJoints:
    first, second = zip(*(joint.pair() for joint in joints), strict=True)
    return SeveralContactJoints(
        stack([_renamed(joint, joints[0].pair()) for joint in joints]),
        tuple(joints),
        *(GROUND if GROUND in names else GroupName(names) for names in (first, second)),
    )


def _alike(keys: Mapping[str, Hashable | None]) -> list[list[str]]:
    """Names whose keys are equal and not ``None``, where they are enough to be put together."""
    families: dict[Hashable, list[str]] = {}
    for name, key in keys.items():
        if key is not None:
            families.setdefault(key, []).append(name)
    return [names for names in families.values() if len(names) >= SMALLEST]


def _structure(tree: PyTree) -> Hashable | None:
    """Equal for trees whose scalars may be stack; ``None`` if there is more than scalars."""
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
    pair = joint.pair()
    if set(joint.body_names()) != set(pair) or joint.anchor() is not None or _has_rows(joint):
        return None
    anonymous = _renamed(joint, ROLES)
    alike = _structure(anonymous)
    if alike is None or anonymous.pair() != _roles(joint, ROLES):
        return None
    return alike, tuple(joint.laws()), tuple(group_of.get(name, name) for name in pair)


def _roles(joint: AbstractContactJoint, names: tuple[str, str]) -> tuple[str, ...]:
    return tuple(
        GROUND if name == GROUND else role for name, role in zip(joint.pair(), names, strict=True)
    )


def _renamed(joint: AbstractContactJoint, names: tuple[str, str]) -> AbstractContactJoint:
    """The joint between bodies of other names, the ground's excepted. Checks of its class do not
    run: its numbers are in scalar form."""
    new_names = dict(zip(joint.pair(), _roles(joint, names), strict=True))
    renamed = copy.copy(joint)
    for field in dataclasses.fields(joint):
        name = getattr(joint, field.name)
        if field.metadata.get("static", False) and isinstance(name, str):
            object.__setattr__(renamed, field.name, new_names.get(name, name))
    return renamed


def _has_rows(joint: AbstractContactJoint) -> bool:
    """Whether the joint adds constraint equations to its contacts."""
    number = jnp.ones(())
    vector = Vector(number, number, number)
    motion = Motion(vector, Matrix(vector, vector, vector), vector, vector)
    motions = {**dict.fromkeys(joint.body_names(), motion), GROUND: GROUND_MOTION}
    return bool(jax.eval_shape(lambda: joint.rows(motions, number)))


def _held_bodies(scene: Scene) -> set[str]:
    """Bodies that constraint equations or an anchor concern."""
    contacts = scene.contact_joints()
    return {
        body
        for name, joint in scene.joints.items()
        if name not in contacts or contacts[name].anchor() is not None or _has_rows(contacts[name])
        for body in joint.body_names()
    }


def _order(scene: Scene) -> dict[str, int]:
    """Places of the bodies, such that neighbours in a chain of joints follow each other: what
    a joint's first and second bodies are is then a slice of a group."""
    neighbours: dict[str, list[str]] = {name: [] for name in (GROUND, *scene.bodies)}
    for joint in scene.contact_joints().values():
        first, second = joint.pair()
        neighbours[first].append(second)
        neighbours[second].append(first)
    places: dict[str, int] = {}
    waiting = [*reversed(scene.bodies), GROUND]
    while waiting:
        name = waiting.pop()
        if name not in places:
            places[name] = len(places)
            waiting += reversed(neighbours[name])
    return {name: place for name, place in places.items() if name != GROUND}


def _by_bodies(
    joints: Mapping[str, AbstractContactJoint], order: Mapping[str, int]
) -> Iterable[str]:
    """The joints' names in the order of their bodies."""

    def place(name: str) -> tuple[int, ...]:
        return tuple(sorted((order.get(body, -1) for body in joints[name].pair()), reverse=True))

    return sorted(joints, key=place)
