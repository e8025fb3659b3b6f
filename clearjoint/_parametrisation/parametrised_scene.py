"""A scene and its initial state as functions of parameters, and derivatives by the parameters."""

import abc
from collections.abc import Callable, Mapping
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import PyTree
from typing_extensions import override

from .._compilation.xla import tell_tangents
from .._fields.objects import with_arrays
from .._fields.types import ArrayLike
from .._math.vectors import ConstantFolded, Scalar, fold_constants, unpack
from .._model.bodies import State
from .._model.scene import Scene
from .parameter import AbstractScale, Parameter
from .variations import Change, NumberSetter, changed, changed_in_steps, require_apart

Coordinates = jax.Array | np.ndarray
Trees = tuple[PyTree, ...]
SceneFunction = Callable[..., tuple[PyTree, PyTree]]
"""Function of a scene and of further arguments that returns a value, which is differentiated, and
an auxiliary result, which is not."""


class AbstractSceneFamily(eqx.Module):
    """Base class of a scene and its initial state as functions of parameters, with the derivatives,
    called tangents, of what a run computes along one or more directions of the parameters.

    - `values`: the parameters at which derivatives are computed, a PyTree of arrays.
    - `base`: scene and initial state before any change.
    - `patterns`: folded constants of the scene, see `ConstantFolded`.
    """

    values: eqx.AbstractVar[PyTree]
    base: eqx.AbstractVar[tuple[Scene, State]]
    patterns: eqx.AbstractVar[tuple[PyTree, ...]]

    @property
    @abc.abstractmethod
    def seeds(self) -> PyTree:
        """The directions: a PyTree like `values`, whose arrays have a first axis for directions."""

    @property
    def tangents(self) -> int:
        return len(jax.tree.leaves(self.seeds)[0])

    @abc.abstractmethod
    def pairs(self, values: PyTree) -> list[tuple[Change, PyTree]]:
        """Return the functions that change `base`, each with its argument at `values`."""

    def scene_and_state(self, values: PyTree) -> tuple[Scene, State]:
        """Return scene and initial state at parameters, with vectors as arrays (3,)."""
        return changed(*self.base, self.pairs(values))

    @abc.abstractmethod
    def with_derivatives(
        self, function: SceneFunction, primals: Trees, tangents: Trees
    ) -> tuple[PyTree, PyTree, PyTree]:
        """Compute ``function(scene, *primals)`` and its derivatives along the directions.

        The scene is that of the method `scene` at `values`. `primals` are earlier results of a run,
        `tangents` their derivatives. In derivatives, arrays have a first axis for directions.

        **Returns:** the value, the auxiliary result, and the value's derivatives.
        """

    def scene(self, values: PyTree) -> Scene:
        """Return the scene at parameters, in scalars, with folded constants as Python numbers."""
        return unpack(ConstantFolded(self.scene_and_state(values)[0], self.patterns))

    def start(self, values: PyTree) -> State:
        """Return the initial state at parameters, with vectors as separate scalars."""
        return unpack(self.scene_and_state(values)[1])

    def varied(self) -> PyTree[bool]:
        """Return, in the structure of the scene, whether a parameter may change each leaf."""
        return self.effects()[0]

    def effects(self) -> tuple[PyTree[bool], int | None]:
        """Return, in the structure of the scene, whether a parameter may change each leaf; and the
        number of changes in `pairs`, counted from the first, that the scene needs. The others
        change only the initial state. A subclass may return ``None`` for all changes."""
        # A user's function may change any leaf. JAX traces the functions here without computing
        # numbers, and each leaf that depends on a parameter becomes a tracer.
        effects: list[tuple[PyTree[bool], int]] = []

        def trace(values: PyTree) -> PyTree:
            (leaves, structure), last = jax.tree.flatten(self.base[0]), 0
            for count, (scene, _) in changed_in_steps(*self.base, self.pairs(values)):
                old_leaves, old_structure = leaves, structure
                leaves, structure = jax.tree.flatten(scene)
                is_same = structure == old_structure
                # A change that leaves the scene alone passes on the same arrays.
                if not is_same or any(a is not b for a, b in zip(leaves, old_leaves, strict=True)):
                    last = count
            traced = [isinstance(leaf, Tracer) for leaf in leaves]
            effects.append((jax.tree.unflatten(structure, traced), last))
            return values

        jax.eval_shape(trace, self.values)
        return effects[0]


class ParametrisedScene(AbstractSceneFamily):
    """A scene and its initial state, in which p parameters set or change some of the numbers, with
    derivatives by each of them.

    - `values`: (p,) coordinates of the parameters. `base`, `patterns`: see `AbstractSceneFamily`.
    - `changes`, `scales`: function that sets the value of each parameter, and its scale. Arrays of
      a function that is a PyTree are arguments of compiled programs.
    - `directions`: (n, p), coordinates of n directions of derivatives; ``None``: each parameter's.
    - `in_scene`: number of leading `changes` that the scene needs, because the others change only
      the initial state; ``None`` for all.
    """

    values: Coordinates
    base: tuple[Scene, State]
    changes: tuple[Change, ...]
    scales: tuple[AbstractScale, ...] = eqx.field(static=True)
    patterns: tuple[PyTree, ...] = eqx.field(static=True)
    directions: Coordinates | None = None
    in_scene: int | None = eqx.field(static=True, default=None)

    def in_groups(self, largest: int) -> "list[ParametrisedScene]":
        """Return copies that share the derivatives among them: each copy computes derivatives by
        the same number of parameters, at most `largest`. The last copy repeats the last parameter
        if the division leaves a remainder."""
        count = len(self.values)
        if count <= largest:
            return [self]
        # Quotients rounded up: the number of copies, then the number of parameters of each.
        groups = -(-count // largest)
        size = -(-count // groups)
        # Indices of each copy's parameters; beyond the last parameter, the last is repeated.
        numbers = np.minimum(np.arange(groups * size), count - 1).reshape(groups, size)
        return [replace(self, directions=np.eye(count)[row]) for row in numbers]

    def at(self, values: ArrayLike) -> "ParametrisedScene":
        return eqx.tree_at(lambda f: f.values, self, jnp.asarray(values, float))

    @property
    @override
    def seeds(self) -> Coordinates:
        return jnp.eye(len(self.values)) if self.directions is None else self.directions

    @override
    def pairs(self, values: Coordinates) -> list[tuple[Change, Scalar]]:
        numbers = [scale.value(values[k]) for k, scale in enumerate(self.scales)]
        return [*zip(self.changes, numbers, strict=True)]

    @override
    def scene(self, values: Coordinates) -> Scene:
        # Without the last changes, if they change only the state: less to trace.
        scene, _ = changed(*self.base, self.pairs(values)[: self.in_scene])
        return unpack(ConstantFolded(scene, self.patterns))

    @override
    def effects(self) -> tuple[PyTree[bool], int | None]:
        setters = [change for change in self.changes if isinstance(change, NumberSetter)]
        if len(setters) < len(self.changes):
            return super().effects()
        # If all parameters are numbers, their locations tell which leaves change: each
        # `NumberSetter` has the indices of the leaves that it sets.
        structure, in_scene = jax.tree.structure(self.base[0]), [s for s in setters if s.in_scene]
        leaves = {number.leaf for setter in in_scene for number in setter.numbers}
        varied = [k in leaves for k in range(structure.num_leaves)]
        # None: all changes, since `make_all` makes them in one call.
        return jax.tree.unflatten(structure, varied), None

    @override
    def with_derivatives(
        self, function: SceneFunction, primals: Trees, tangents: Trees
    ) -> tuple[PyTree, PyTree, PyTree]:
        def at(values: Coordinates, *rest: PyTree) -> tuple[PyTree, PyTree]:
            return function(self.scene(values), *rest)

        def along(seed: Coordinates, tangents: Trees) -> PyTree:
            return jax.jvp(at, (self.values, *primals), (seed, *tangents), has_aux=True)

        tell_tangents(self.tangents)
        # The value is computed once for all derivatives.
        along_all = jax.vmap(along, out_axes=(None, 0, None))
        value, derivatives, auxiliary = along_all(self.seeds, tangents)
        return value, auxiliary, derivatives


def parametrised(
    scene: Scene, state: State, parameters: Mapping[str, Parameter], values: Coordinates
) -> ParametrisedScene:
    """Return a scene and its initial state as functions of p parameters, whose coordinates are
    `values`, (p,). Parameters that are errors of sensors, such as a bias, are refused: replace them
    by `readings.in_scene` first."""
    # A Python number would be a constant of the program, which would be compiled anew for each
    # value of the number.
    scene, state = with_arrays((scene, state))
    # The example 0.0 says that all values are single numbers.
    changes = {name: p.variation.setter(scene, state, 0.0) for name, p in parameters.items()}
    require_apart("parameters", changes, scene, state)
    scales = tuple(p.scale for p in parameters.values())
    # Constants are folded only in leaves that no parameter changes. A first object without folded
    # constants finds these leaves, and `in_scene`: the changes after the first `in_scene` ones
    # change only the initial state, so the scene is made without them.
    unfolded = ParametrisedScene(
        values=values,
        base=(scene, state),
        changes=tuple(changes.values()),
        scales=scales,
        patterns=(),
    )
    varied, in_scene = unfolded.effects()
    patterns = fold_constants(scene, varied).patterns
    return replace(unfolded, patterns=patterns, in_scene=in_scene)


class DirectedScene(AbstractSceneFamily):
    """A scene and its initial state as functions of any number of parameters, with derivatives
    along a single direction. `base` and `patterns`: as in `AbstractSceneFamily`.

    - `values`, `direction`: SI numbers of each parameter by name: an array, or a PyTree of arrays.
    - `changes`: pairs of the name of a parameter and the function that sets it.
    """

    values: dict[str, PyTree]
    direction: dict[str, PyTree]
    base: tuple[Scene, State]
    changes: tuple[tuple[str, Change], ...] = eqx.field(static=True)
    patterns: tuple[PyTree, ...] = eqx.field(static=True)

    @property
    @override
    def seeds(self) -> PyTree:
        return _with_axis(self.direction)

    @override
    def pairs(self, values: dict[str, PyTree]) -> list[tuple[Change, PyTree]]:
        return [(change, values[name]) for name, change in self.changes]

    @override
    def with_derivatives(
        self, function: SceneFunction, primals: Trees, tangents: Trees
    ) -> tuple[PyTree, PyTree, PyTree]:
        def at(values: PyTree, *rest: PyTree) -> tuple[PyTree, PyTree]:
            return function(self.scene(values), *rest)

        arguments = self.values, *primals
        directions = self.direction, *jax.tree.map(_without_axis, tangents)
        # `jax.linear_transpose` can transpose this with respect to direction and tangents.
        value, derivatives, auxiliary = jax.jvp(at, arguments, directions, has_aux=True)
        return value, auxiliary, _with_axis(derivatives)


def _with_axis(tree: PyTree) -> PyTree:
    """Add a first axis of directions, of length 1 since there is only one, to each array."""
    # JAX traces an index in several times the time of its primitive.
    return jax.tree.map(lambda leaf: jax.lax.expand_dims(jnp.asarray(leaf), (0,)), tree)


def _without_axis(leaf: jax.Array) -> jax.Array:
    return jax.lax.squeeze(jnp.asarray(leaf), (0,))
