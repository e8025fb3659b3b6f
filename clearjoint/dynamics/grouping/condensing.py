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
from collections.abc import Callable, Hashable, Iterable, Mapping
from typing import TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ...math.groups import GroupName, by_group, by_name, element, is_structural, stack, sum_
from ...math.vectors import Matrix, Scalar, Vector
from ...model.bodies import GROUND, GROUND_MOTION, NO_WRENCH, BodyState, Motion
from ...model.clearance_joints.grouped_contacts import GroupedContactJoint
from ...model.joints.base import AbstractContactJoint, Motions, Row
from ...model.scene import Scene
from ..absolute_coordinates import AbsoluteCoordinates, AbsoluteMechanics
from ..coordinates import (
    AbstractCoordinates,
    AbstractMechanics,
    BodyAcceleration,
    MotionVariables,
    Speeds,
    Wrenches,
)
from ..formulation import Formulation

T = TypeVar("T")
SMALLEST = 4
"""Smallest number of elements that form a group. Fewer elements are written out, since their code
stays small."""

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
        """Return the indices in `order` of the two bodies of the joint with the given name, the
        larger one first; -1 for the ground."""
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

    Each of its two bodies is the ground, or a `GroupName` of the joints' bodies, which repeats one
    name if all joints are attached to one single body.
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
    # the same arrays, or they are one body; likewise the second bodies.
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


GroupedVariables: TypeAlias = tuple[MotionVariables, dict[str, BodyState]]
"""A pair: the variables of the single bodies, and for each group of bodies, by its name, a
`BodyState` of arrays."""


class GroupedCoordinates(AbstractCoordinates):
    """Coordinates of a condensed scene.

    **Arguments:** `rest`: the coordinates of the single bodies.

    The states that are given to `encode` are by names of single bodies. Those from `decode` are by
    the names of the condensed scene, which include those of groups.
    """

    rest: AbstractCoordinates

    def eliminated(self, scene: Scene) -> frozenset[str]:
        """Return the names of the ideal joints that `rest` eliminates."""
        return self.rest.eliminated(_rest(scene))

    def encode(self, scene: Scene, bodies: dict[str, BodyState]) -> GroupedVariables:
        """Return the variables of the single bodies and of the groups, for given states of all
        bodies by name."""
        rest = {name: bodies[name] for name in _rest(scene).bodies}
        return self.rest.encode(_rest(scene), rest), by_group(bodies, _groups(scene).bodies)

    def decode(self, scene: Scene, variables: GroupedVariables) -> dict[str, BodyState]:
        """Return the states of single bodies and of groups, by name."""
        return self.rest.decode(_rest(scene), variables[0]) | variables[1]

    def motions(self, scene: Scene, variables: GroupedVariables) -> Motions:
        """Return pose and velocities by the names of single bodies, groups, members of groups, and
        "ground"."""
        rest = self.rest.motions(_rest(scene), variables[0])
        groups = AbsoluteCoordinates().motions(_groups(scene), variables[1])
        return GroupedMotions({**rest, **groups})

    def mechanics(self, scene: Scene, variables: GroupedVariables) -> "GroupedMechanics":
        """Return the equations of motion of the single bodies and the groups."""
        return GroupedMechanics(self.rest, scene, variables)

    def without_drift(self, scene: Scene, variables: GroupedVariables) -> GroupedVariables:
        """Return normalised variables of the same motion, for example with unit Euler
        parameters."""
        groups = AbsoluteCoordinates().without_drift(_groups(scene), variables[1])
        return self.rest.without_drift(_rest(scene), variables[0]), groups

    def with_speeds(
        self, scene: Scene, variables: GroupedVariables, others: GroupedVariables
    ) -> GroupedVariables:
        """Return variables with the positions of `variables` and the speeds of `others`."""
        groups = AbsoluteCoordinates().with_speeds(_groups(scene), variables[1], others[1])
        return self.rest.with_speeds(_rest(scene), variables[0], others[0]), groups


class GroupedMechanics(AbstractMechanics):
    """Equations of motion of a condensed scene.

    **Arguments:** `rest`: the coordinates of the single bodies; `variables`: those of single bodies
    and groups.
    """

    def __init__(self, rest: AbstractCoordinates, scene: Scene, variables: GroupedVariables):
        groups = _groups(scene)
        self._rest = rest.mechanics(_rest(scene), variables[0])
        free = AbsoluteCoordinates().mechanics(groups, variables[1])
        self._groups: AbsoluteMechanics = free
        self._bodies, self._variables = scene.bodies, variables
        # Length of each of the six arrays of each group.
        self._sizes = [len(name.members) for name in _group_names(groups.bodies) for _ in range(6)]
        self.motions = GroupedMotions({**self._rest.motions, **free.motions})

    def free_rates(self, wrenches: Wrenches) -> Speeds:
        """Return the rates of the speeds under wrenches, by name of body, and gravity, without
        constraints."""
        wrenches = summed_wrenches(wrenches, self._bodies)
        # A rate that is the same for all bodies of a group may be a single number.
        rates = zip(self._groups.free_rates(wrenches), self._sizes, strict=True)
        groups = [jnp.broadcast_to(rate, (size,)) for rate, size in rates]
        return [*self._rest.free_rates(wrenches), *groups]

    def _split(self, numbers: Speeds) -> tuple[Speeds, Speeds]:
        """Return the entries of a list for the single bodies, and those for the groups."""
        size = len(numbers) - len(self._sizes)
        return numbers[:size], numbers[size:]

    def projected(self, wrenches: Wrenches) -> Speeds:
        """Return the generalised forces of wrenches, by name of body, one for each speed."""
        wrenches = summed_wrenches(wrenches, self._bodies)
        return [*self._rest.projected(wrenches), *self._groups.projected(wrenches)]

    def solved(self, forces: Speeds) -> Speeds:
        """Return the rates of the speeds that generalised forces, one for each speed, cause."""
        rest, groups = self._split(forces)
        return [*self._rest.solved(rest), *self._groups.solved(groups)]

    def bias(self, row: Row) -> Scalar:
        """Return the part of the second time derivative of a constraint row's value that the
        accelerations of the bodies cause if the time derivatives of all speeds are zero.

        The row's own `bias`, the part without accelerations of the bodies, is not included. Only
        single bodies have constraints.
        """
        return self._rest.bias(row)

    def accelerations(self, rates: Speeds) -> dict[str, BodyAcceleration]:
        """Return the acceleration of each body, by the name of the single body, also for members of
        groups."""
        rest, groups = self._split(rates)
        return self._rest.accelerations(rest) | by_name(self._groups.accelerations(groups))

    def variable_rates(self, rates: Speeds) -> GroupedVariables:
        """Return the time derivatives of the variables, a pair as in `GroupedVariables`, for given
        rates of the speeds."""
        rest, groups = self._split(rates)
        return self._rest.variable_rates(rest), self._groups.variable_rates(groups)

    def after_displacement(self, changes: Speeds) -> GroupedVariables:
        """Return the variables after small displacements of the single bodies.

        `changes` has one displacement, m or rad, for each speed of single bodies and groups.
        Grouped bodies stay where they are: only constraints displace bodies in this way, and
        grouped bodies have none.
        """
        return self._rest.after_displacement(self._split(changes)[0]), self._variables[1]

    def after_speed_change(self, changes: Speeds) -> GroupedVariables:
        """Return the variables after `changes` of the single bodies' speeds, m/s or rad/s.

        Grouped bodies keep their speeds: in runs with groups only constraints change speeds in this
        way, and grouped bodies have none.
        """
        return self._rest.after_speed_change(self._split(changes)[0]), self._variables[1]


class GroupedMotions(dict[str, Motion]):
    """Dictionary of motions by the names of single bodies and groups, which computes further
    motions on demand.

    A `GroupName` is a string with the names of several members. Further keys are

    - the name of one body in a group;
    - a `GroupName` of several bodies of one group, as of the first bodies of a group of joints;
    - a `GroupName` that repeats the name of one single body, to which all joints of a group are
      attached.
    """

    def __init__(self, motions: Motions):
        super().__init__(motions)
        self._derived: dict[str, Motion] = {}

    def __missing__(self, name: str) -> Motion:
        if name not in self._derived:
            self._derived[name] = self._motion_of(name)
        return self._derived[name]

    def _motion_of(self, name: str) -> Motion:
        """Return the motion for one of the further keys that the class describes."""
        if isinstance(name, GroupName) and name.members[0] in self:
            # One single body, repeated: its motion is the same for all joints.
            return self[name.members[0]]
        group = group_with(self, name)
        if isinstance(name, GroupName):
            indices = [group.members.index(member) for member in name.members]
            return _map_arrays(lambda leaf: _taken(leaf, indices), self[group])
        return element(self[group], group.members.index(name))


def summed_wrenches(wrenches: Wrenches, bodies: Iterable[str]) -> Wrenches:
    """Return the sum of the wrenches on each single body and on each group of a condensed scene,
    without those on the ground.

    **Arguments:** `wrenches`: by the name of a body, or by a `GroupName` of several bodies, with
    arrays of one element for each of them; `bodies`: the names in the condensed scene, which are
    the keys of the result.
    """
    sums = dict.fromkeys(bodies, NO_WRENCH)
    for name, wrench in wrenches.items():
        # The ground does not move, but constraint rows also give the wrench on it.
        if name == GROUND:
            continue
        members = name.members if isinstance(name, GroupName) else (name,)
        key = name
        if name not in sums and members[0] in sums:
            # Several wrenches on one single body are added up.
            key, wrench = members[0], _map_arrays(sum_, wrench)
        elif name not in sums:
            # Wrenches on some bodies of a group become arrays over the whole group.
            key = group_with(sums, name)
            indices, size = [key.members.index(member) for member in members], len(key.members)
            wrench = _map_arrays(lambda leaf, k=indices, n=size: _scattered(leaf, k, n), wrench)
        sums[key] = sums[key] + wrench
    return sums


def group_with(names: Iterable[str], name: str) -> GroupName:
    """Return the name of the group among `names` that contains a body, or the first of several
    bodies.

    **Raises:** `KeyError` if no group contains the body.
    """
    member = name.members[0] if isinstance(name, GroupName) else name
    for group in _group_names(names):
        if member in group.members:
            return group
    raise KeyError(name)


def _map_arrays(function: Callable[[jax.Array], Scalar], tree: T) -> T:
    """Apply a function to all leaves of a PyTree except exact zeros and ones."""
    return jax.tree.map(lambda leaf: leaf if is_structural(leaf) else function(leaf), tree)


def _taken(values: jax.Array, indices: list[int]) -> jax.Array:
    """Return the elements of an array (n,) at the given indices, by a slice if the indices are
    consecutive."""
    first, last = indices[0], indices[-1] + 1
    if indices == list(range(first, last)):
        return values[first:last]
    return values.at[np.array(indices)].get(mode="promise_in_bounds")


def _scattered(values: jax.Array, indices: list[int], size: int) -> Scalar:
    """Return an array (size,) in which entry k is the sum of those values whose index is k.

    It is computed by gathers: with a scatter, the stepping loop could not become one native
    function.
    """
    values = jnp.broadcast_to(values, (len(indices),))
    first, last = indices[0], indices[-1] + 1
    if indices == list(range(first, last)):
        return jnp.pad(values, (first, size - last))
    # For each element of the result, the positions of its terms in `values`. All lists are filled
    # up to the longest with the position of an appended zero; each column is one gather.
    padded = jnp.pad(values, (0, 1))
    sources = [[k for k, i in enumerate(indices) if i == element] for element in range(size)]
    most = max(len(source) for source in sources)
    columns = np.array([source + [len(indices)] * (most - len(source)) for source in sources]).T
    return sum(padded.at[column].get(mode="promise_in_bounds") for column in columns)


def _group_names(names: Iterable[str]) -> list[GroupName]:
    return [name for name in names if isinstance(name, GroupName)]


def _rest(scene: Scene) -> Scene:
    """Return the scene without its groups of bodies."""
    single = {name: body for name, body in scene.bodies.items() if not isinstance(name, GroupName)}
    return eqx.tree_at(lambda s: s.bodies, scene, single)


def _groups(scene: Scene) -> Scene:
    """Return the scene with its groups of bodies only, and without joints."""
    bodies = {name: scene.bodies[name] for name in _group_names(scene.bodies)}
    return eqx.tree_at(lambda s: (s.bodies, s.joints), scene, (bodies, {}))


def grouped(scene: Scene, formulation: Formulation) -> tuple[Scene, Formulation]:
    """Return a scene in which elements that differ only in numbers are replaced by groups, and the
    formulation for this scene.

    The returned formulation has `GroupedCoordinates`, which treat groups of bodies and single
    bodies separately. Without groups, scene and formulation are returned unchanged. Groups make the
    compiled program of a scene with many such elements shorter.

    **Arguments:** `scene`: a scene with each vector as three separate scalars.
    """
    with_groups = condensed(scene)
    if not groups(with_groups):
        return scene, formulation
    coordinates = GroupedCoordinates(formulation.coordinates)
    return with_groups, eqx.tree_at(lambda f: f.coordinates, formulation, coordinates)
