"""Coordinates of a condensed scene: absolute ones for groups of bodies, any others for the rest.

A free body has the same variables in all coordinates, and its equations take the least arithmetic
in absolute ones.
"""

from collections.abc import Callable, Iterable
from typing import TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ...math.groups import GroupName, by_group, by_name, element, is_structural, sum_
from ...math.vectors import Scalar
from ...model.bodies import NO_WRENCH, BodyState, Motion, Wrench
from ...model.joints.base import Motions, Row
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
from .condensing import condensed, groups

T = TypeVar("T")

GroupedVariables: TypeAlias = tuple[MotionVariables, dict[str, BodyState]]
"""Variables of the rest of the scene, and states of each group of bodies."""


class GroupedCoordinates(AbstractCoordinates):
    """Coordinates of a condensed scene; `rest` are those of its single bodies.

    `encode` takes states by names of bodies; `decode` returns them by names of a condensed scene.
    """

    rest: AbstractCoordinates

    def eliminated(self, scene: Scene) -> frozenset[str]:
        """Return the joints that the coordinates of the rest eliminate."""
        return self.rest.eliminated(_rest(scene))

    def encode(self, scene: Scene, bodies: dict[str, BodyState]) -> GroupedVariables:
        """Return the variables of the rest, and the states of the groups."""
        rest = {name: bodies[name] for name in _rest(scene).bodies}
        return self.rest.encode(_rest(scene), rest), by_group(bodies, _groups(scene).bodies)

    def decode(self, scene: Scene, variables: GroupedVariables) -> dict[str, BodyState]:
        """Return the states of the rest and of the groups."""
        return self.rest.decode(_rest(scene), variables[0]) | variables[1]

    def motions(self, scene: Scene, variables: GroupedVariables) -> Motions:
        """Return the motions, also by the names of grouped bodies."""
        rest = self.rest.motions(_rest(scene), variables[0])
        groups = AbsoluteCoordinates().motions(_groups(scene), variables[1])
        return GroupedMotions({**rest, **groups})

    def mechanics(self, scene: Scene, variables: GroupedVariables) -> "GroupedMechanics":
        """Return the equations of motion of both parts."""
        return GroupedMechanics(self.rest, scene, variables)

    def without_drift(self, scene: Scene, variables: GroupedVariables) -> GroupedVariables:
        """Return the variables of both parts, normalised."""
        groups = AbsoluteCoordinates().without_drift(_groups(scene), variables[1])
        return self.rest.without_drift(_rest(scene), variables[0]), groups

    def with_speeds(
        self, scene: Scene, variables: GroupedVariables, others: GroupedVariables
    ) -> GroupedVariables:
        """Return the variables with the speeds of `others`."""
        groups = AbsoluteCoordinates().with_speeds(_groups(scene), variables[1], others[1])
        return self.rest.with_speeds(_rest(scene), variables[0], others[0]), groups


class GroupedMechanics(AbstractMechanics):
    """Mechanics of the rest and of the groups; the speeds of the rest come first."""

    def __init__(self, rest: AbstractCoordinates, scene: Scene, variables: GroupedVariables):
        groups = _groups(scene)
        self._rest = rest.mechanics(_rest(scene), variables[0])
        free = AbsoluteCoordinates().mechanics(groups, variables[1])
        self._groups: AbsoluteMechanics = free
        self._bodies, self._variables = scene.bodies, variables
        self._sizes = [len(name.members) for name in _group_names(groups.bodies) for _ in range(6)]
        self.motions = GroupedMotions({**self._rest.motions, **free.motions})

    def free_rates(self, wrenches: Wrenches) -> Speeds:
        """Return the rates of both parts."""
        wrenches = summed_wrenches(wrenches, self._bodies)
        return [
            *self._rest.free_rates(wrenches),
            *self._broadcast(self._groups.free_rates(wrenches)),
        ]

    def _broadcast(self, rates: Speeds) -> Speeds:
        """Return the rates of groups as arrays with one element for each body.

        Rates that are the same for all bodies are single numbers before.
        """
        return [
            jnp.broadcast_to(rate, (size,)) for rate, size in zip(rates, self._sizes, strict=True)
        ]

    def _split(self, numbers: Speeds) -> tuple[Speeds, Speeds]:
        size = len(numbers) - len(self._sizes)
        return numbers[:size], numbers[size:]

    def projected(self, wrenches: Wrenches) -> Speeds:
        """Return the generalised forces on the speeds of both parts."""
        wrenches = summed_wrenches(wrenches, self._bodies)
        return [*self._rest.projected(wrenches), *self._groups.projected(wrenches)]

    def solved(self, forces: Speeds) -> Speeds:
        """Solve with the mass matrices of both parts."""
        rest, groups = self._split(forces)
        return [*self._rest.solved(rest), *self._groups.solved(groups)]

    def bias(self, row: Row) -> Scalar:
        """Return the bias of the rest: grouped bodies have no constraints."""
        return self._rest.bias(row)

    def accelerations(self, rates: Speeds) -> dict[str, BodyAcceleration]:
        """Return the accelerations of the bodies by the names of single bodies."""
        rest, groups = self._split(rates)
        return self._rest.accelerations(rest) | by_name(self._groups.accelerations(groups))

    def variable_rates(self, rates: Speeds) -> GroupedVariables:
        """Return the rates of the variables of both parts."""
        rest, groups = self._split(rates)
        return self._rest.variable_rates(rest), self._groups.variable_rates(groups)

    def after_displacement(self, changes: Speeds) -> GroupedVariables:
        """Change the positions of the rest only: grouped bodies have no constraints."""
        return self._rest.after_displacement(self._split(changes)[0]), self._variables[1]

    def after_speed_change(self, changes: Speeds) -> GroupedVariables:
        """Change the speeds of the rest only: grouped bodies have no constraints."""
        return self._rest.after_speed_change(self._split(changes)[0]), self._variables[1]


class GroupedMotions(dict[str, Motion]):
    """Motions by the names of single bodies and groups, with further names on demand: of a body in
    a group, and a `GroupName` of several bodies of one group or of one body repeated."""

    def __init__(self, motions: Motions):
        super().__init__(motions)
        self._derived: dict[str, Motion] = {}

    def __missing__(self, name: str) -> Motion:
        if name not in self._derived:
            self._derived[name] = self._motion_of(name)
        return self._derived[name]

    def _motion_of(self, name: str) -> Motion:
        if isinstance(name, GroupName) and name.members[0] in self:
            return self[name.members[0]]
        group = group_with(self, name)
        if isinstance(name, GroupName):
            indices = [group.members.index(member) for member in name.members]
            return _map_arrays(lambda leaf: _taken(leaf, indices), self[group])
        return element(self[group], group.members.index(name))


def summed_wrenches(wrenches: Wrenches, bodies: Iterable[str]) -> Wrenches:
    """Sum wrenches, given by names of bodies and by any `GroupName`, into one wrench for each key
    of `bodies`, the single bodies and groups of a condensed scene."""
    sums = dict.fromkeys(bodies, NO_WRENCH)
    for name, wrench in wrenches.items():
        key, converted = _assigned(name, wrench, bodies)
        sums[key] = sums[key] + converted
    return sums


def _assigned(name: str, wrench: Wrench, bodies: Iterable[str]) -> tuple[str, Wrench]:
    """Return the single body or group to which the wrench on a name is added, and the wrench with
    its shape."""
    if name in bodies:
        return name, wrench
    if isinstance(name, GroupName) and name.members[0] in bodies:
        return name.members[0], _map_arrays(sum_, wrench)
    group = group_with(bodies, name)
    members = name.members if isinstance(name, GroupName) else (name,)
    indices = [group.members.index(member) for member in members]
    return group, _map_arrays(lambda leaf: _scattered(leaf, indices, len(group.members)), wrench)


def group_with(names: Iterable[str], name: str) -> GroupName:
    """Return the group of a body, or of the first of several.

    **Raises:** `KeyError` if it is in no group.
    """
    member = name.members[0] if isinstance(name, GroupName) else name
    for group in _group_names(names):
        if member in group.members:
            return group
    raise KeyError(name)


def _map_arrays(function: Callable[[jax.Array], Scalar], tree: T) -> T:
    return jax.tree.map(lambda leaf: leaf if is_structural(leaf) else function(leaf), tree)


def _taken(values: jax.Array, indices: list[int]) -> jax.Array:
    """Return the values (n,) at some indices, by a slice if these are consecutive."""
    first, last = indices[0], indices[-1] + 1
    if indices == list(range(first, last)):
        return values[first:last]
    return values.at[np.array(indices)].get(mode="promise_in_bounds")


def _scattered(values: jax.Array, indices: list[int], size: int) -> Scalar:
    """Return the sums (size,) of the values with each index.

    It consists of gathers: a scatter would keep the stepping loop from becoming one native
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
    """Return the scene with its groups of bodies only."""
    bodies = {name: scene.bodies[name] for name in _group_names(scene.bodies)}
    return eqx.tree_at(lambda s: (s.bodies, s.joints), scene, (bodies, {}))


def grouped(scene: Scene, formulation: Formulation) -> tuple[Scene, Formulation]:
    """Return the scene, in scalar form, with groups, and the formulation for it; both unchanged if
    there are no groups."""
    with_groups = condensed(scene)
    if not groups(with_groups):
        return scene, formulation
    coordinates = GroupedCoordinates(formulation.coordinates)
    return with_groups, eqx.tree_at(lambda f: f.coordinates, formulation, coordinates)
