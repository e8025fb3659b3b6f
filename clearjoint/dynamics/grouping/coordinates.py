"""Coordinates of a condensed scene: its groups of bodies in absolute ones, the rest in any.

A body that moves freely has the same variables in all coordinates, and Newton and Euler take least
arithmetic for it in absolute ones.
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
"""Those of the rest of the scene, and the bodies of each group."""


class GroupedCoordinates(AbstractCoordinates):
    """Groups of free bodies beside the other coordinates' part of the scene.

    States come by the bodies' own names and go by those of a condensed scene.
    """

    rest: AbstractCoordinates

    def eliminated(self, scene: Scene) -> frozenset[str]:
        """The joints that the coordinates of the rest eliminate."""
        return self.rest.eliminated(_rest(scene))

    def encode(self, scene: Scene, bodies: dict[str, BodyState]) -> GroupedVariables:
        """The rest's variables, and the states of the groups."""
        rest = {name: bodies[name] for name in _rest(scene).bodies}
        return self.rest.encode(_rest(scene), rest), by_group(bodies, _groups(scene).bodies)

    def decode(self, scene: Scene, variables: GroupedVariables) -> dict[str, BodyState]:
        """The states of the rest, and those of the groups."""
        return self.rest.decode(_rest(scene), variables[0]) | variables[1]

    def motions(self, scene: Scene, variables: GroupedVariables) -> Motions:
        """Motions that answer the bodies' own names too."""
        rest = self.rest.motions(_rest(scene), variables[0])
        groups = AbsoluteCoordinates().motions(_groups(scene), variables[1])
        return Views({**rest, **groups})

    def mechanics(self, scene: Scene, variables: GroupedVariables) -> "GroupedMechanics":
        """The equations of motion of both parts."""
        return GroupedMechanics(self.rest, scene, variables)

    def without_drift(self, scene: Scene, variables: GroupedVariables) -> GroupedVariables:
        """The variables of both parts, in numbers that don't drift."""
        groups = AbsoluteCoordinates().without_drift(_groups(scene), variables[1])
        return self.rest.without_drift(_rest(scene), variables[0]), groups

    def with_speeds(
        self, scene: Scene, variables: GroupedVariables, others: GroupedVariables
    ) -> GroupedVariables:
        """The rest and the groups with the speeds of the others."""
        groups = AbsoluteCoordinates().with_speeds(_groups(scene), variables[1], others[1])
        return self.rest.with_speeds(_rest(scene), variables[0], others[0]), groups


class GroupedMechanics(AbstractMechanics):
    """The rest and the groups side by side; the speeds of the rest come first."""

    def __init__(self, rest: AbstractCoordinates, scene: Scene, variables: GroupedVariables):
        groups = _groups(scene)
        self._rest = rest.mechanics(_rest(scene), variables[0])
        free = AbsoluteCoordinates().mechanics(groups, variables[1])
        self._groups: AbsoluteMechanics = free
        self._bodies, self._variables = scene.bodies, variables
        self._sizes = [len(name.members) for name in _several(groups.bodies) for _ in range(6)]
        self.motions = Views({**self._rest.motions, **free.motions})

    def free_rates(self, wrenches: Wrenches) -> Speeds:
        """Rates of both parts."""
        wrenches = folded(wrenches, self._bodies)
        return [
            *self._rest.free_rates(wrenches),
            *self._filled(self._groups.free_rates(wrenches)),
        ]

    def _filled(self, rates: Speeds) -> Speeds:
        """The groups' rates, one for each element even where they are all the same."""
        return [
            jnp.broadcast_to(rate, (size,)) for rate, size in zip(rates, self._sizes, strict=True)
        ]

    def _parted(self, numbers: Speeds) -> tuple[Speeds, Speeds]:
        size = len(numbers) - len(self._sizes)
        return numbers[:size], numbers[size:]

    def projected(self, wrenches: Wrenches) -> Speeds:
        """Forces on the speeds of both parts."""
        wrenches = folded(wrenches, self._bodies)
        return [*self._rest.projected(wrenches), *self._groups.projected(wrenches)]

    def solved(self, forces: Speeds) -> Speeds:
        """By the masses of both parts."""
        rest, groups = self._parted(forces)
        return [*self._rest.solved(rest), *self._groups.solved(groups)]

    def bias(self, row: Row) -> Scalar:
        """Of the rest: no constraint concerns a group."""
        return self._rest.bias(row)

    def accelerations(self, rates: Speeds) -> dict[str, BodyAcceleration]:
        """Accelerations of the bodies, by their own names."""
        rest, groups = self._parted(rates)
        return self._rest.accelerations(rest) | by_name(self._groups.accelerations(groups))

    def variable_rates(self, rates: Speeds) -> GroupedVariables:
        """Rates of the variables of both parts."""
        rest, groups = self._parted(rates)
        return self._rest.variable_rates(rest), self._groups.variable_rates(groups)

    def after_displacement(self, changes: Speeds) -> GroupedVariables:
        """The rest with its positions changed: no constraint concerns a group."""
        return self._rest.after_displacement(self._parted(changes)[0]), self._variables[1]

    def after_speed_change(self, changes: Speeds) -> GroupedVariables:
        """The rest with its speeds changed: no constraint concerns a group."""
        return self._rest.after_speed_change(self._parted(changes)[0]), self._variables[1]


class Views(dict[str, Motion]):
    """Motions of single bodies and groups, which also answers the name of a body in a group, and a
    `GroupName` of bodies in one group or of one and the same body."""

    def __init__(self, motions: Motions):
        super().__init__(motions)
        self._known: dict[str, Motion] = {}

    def __missing__(self, name: str) -> Motion:
        if name not in self._known:
            self._known[name] = self._motion_of(name)
        return self._known[name]

    def _motion_of(self, name: str) -> Motion:
        if isinstance(name, GroupName) and name.members[0] in self:
            return self[name.members[0]]
        group = group_with(self, name)
        if isinstance(name, GroupName):
            places = [group.members.index(member) for member in name.members]
            return _map_arrays(lambda leaf: _taken(leaf, places), self[group])
        return element(self[group], group.members.index(name))


def folded(wrenches: Wrenches, bodies: Iterable[str]) -> Wrenches:
    """Wrenches by the bodies' own names and by any `GroupName` as wrenches on single bodies and
    groups, of which there is one for each key of `bodies`."""
    sums = dict.fromkeys(bodies, NO_WRENCH)
    for name, wrench in wrenches.items():
        key, here = _placed(name, wrench, bodies)
        sums[key] = sums[key] + here
    return sums


def _placed(name: str, wrench: Wrench, bodies: Iterable[str]) -> tuple[str, Wrench]:
    """Where the wrench on a name is summed up, a single body or the group that holds it, and the
    wrench in the form of that."""
    if name in bodies:
        return name, wrench
    if isinstance(name, GroupName) and name.members[0] in bodies:
        return name.members[0], _map_arrays(sum_, wrench)
    group = group_with(bodies, name)
    members = name.members if isinstance(name, GroupName) else (name,)
    places = [group.members.index(member) for member in members]
    return group, _map_arrays(lambda leaf: _spread(leaf, places, len(group.members)), wrench)


def group_with(names: Iterable[str], name: str) -> GroupName:
    """The group that a body, or the first of several, is in. **Raises:** `KeyError` if none."""
    member = name.members[0] if isinstance(name, GroupName) else name
    for group in _several(names):
        if member in group.members:
            return group
    raise KeyError(name)


def _map_arrays(function: Callable[[jax.Array], Scalar], tree: T) -> T:
    return jax.tree.map(lambda leaf: leaf if is_structural(leaf) else function(leaf), tree)


def _taken(values: jax.Array, places: list[int]) -> jax.Array:
    """The values (n,) at some places: a slice, where these follow each other."""
    first, last = places[0], places[-1] + 1
    if places == list(range(first, last)):
        return values[first:last]
    return values.at[np.array(places)].get(mode="promise_in_bounds")


def _spread(values: jax.Array, places: list[int], size: int) -> Scalar:
    """The sums (n,) of the values that go to each of n places; by_group, since a scatter would keep
    the stepping loop from becoming one native function."""
    values = jnp.broadcast_to(values, (len(places),))
    first, last = places[0], places[-1] + 1
    if places == list(range(first, last)):
        return jnp.pad(values, (first, size - last))
    padded = jnp.pad(values, (0, 1))
    sources = [[k for k, place in enumerate(places) if place == here] for here in range(size)]
    most = max(len(source) for source in sources)
    columns = np.array([source + [len(places)] * (most - len(source)) for source in sources]).T
    return sum(padded.at[column].get(mode="promise_in_bounds") for column in columns)


def _several(names: Iterable[str]) -> list[GroupName]:
    return [name for name in names if isinstance(name, GroupName)]


def _rest(scene: Scene) -> Scene:
    """The scene without its groups of bodies."""
    single = {name: body for name, body in scene.bodies.items() if not isinstance(name, GroupName)}
    return eqx.tree_at(lambda s: s.bodies, scene, single)


def _groups(scene: Scene) -> Scene:
    """The scene with nothing but its groups of bodies."""
    bodies = {name: scene.bodies[name] for name in _several(scene.bodies)}
    return eqx.tree_at(lambda s: (s.bodies, s.joints), scene, (bodies, {}))


def grouped(scene: Scene, formulation: Formulation) -> tuple[Scene, Formulation]:
    """The scene (in scalar form) condensed, and its formulation; both as they are if no elements
    are alike."""
    together = condensed(scene)
    if not groups(together):
        return scene, formulation
    coordinates = GroupedCoordinates(formulation.coordinates)
    return together, eqx.tree_at(lambda f: f.coordinates, formulation, coordinates)
