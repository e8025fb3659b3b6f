"""Coordinates of a condensed scene, in which groups replace elements that differ only in numbers.

A group of n bodies is computed as one body whose numbers are arrays (n,); see `.condensing`. Groups
have absolute coordinates, and single bodies any other ones. A grouped body moves freely. A free
body has the same variables in all coordinates, and its equations take the least arithmetic in
absolute coordinates. Arguments and results of the type `Speeds` are lists with one entry for each
speed of the single bodies, then six arrays (n,) for each group of n bodies. Rates are time
derivatives.
"""

from collections.abc import Callable, Iterable
from typing import TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ...math.groups import GroupName, by_group, by_name, element, is_structural, sum_
from ...math.vectors import Scalar
from ...model.bodies import GROUND, NO_WRENCH, BodyState, Motion
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
        """Return the second time derivative that a constraint row's value has if the time
        derivatives of all speeds are zero, without the row's own `bias`, the part at constant
        velocities and spins of the bodies. Only single bodies have constraints."""
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
        """Return the variables after a small displacement of the single bodies.

        Grouped bodies stay where they are: only constraints displace bodies, and grouped bodies
        have none.
        """
        return self._rest.after_displacement(self._split(changes)[0]), self._variables[1]

    def after_speed_change(self, changes: Speeds) -> GroupedVariables:
        """Return the variables after changes of the single bodies' speeds.

        Grouped bodies keep their speeds: only constraints change them, and grouped bodies have
        none.
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
        if name == GROUND:  # the ground doesn't move, and constraint rows have it all the same
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
    compiled program of a scene with many equal elements shorter; see `.condensing`.

    **Arguments:** `scene`: a scene with each vector as three separate scalars.
    """
    with_groups = condensed(scene)
    if not groups(with_groups):
        return scene, formulation
    coordinates = GroupedCoordinates(formulation.coordinates)
    return with_groups, eqx.tree_at(lambda f: f.coordinates, formulation, coordinates)
