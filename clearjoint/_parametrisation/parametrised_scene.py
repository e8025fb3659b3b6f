"""A scene and its initial state as functions of parameters, and derivatives by the parameters."""

from collections.abc import Callable, Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import PyTree

from .._compilation import tell_tangents
from .._fields.objects import with_arrays
from .._fields.types import ArrayLike
from .._math.vectors import ConstantFolded, fold_constants, unpack
from .._model.bodies import State
from .._model.scene import Scene
from .parameter import AbstractScale, Parameter
from .variations import Change, NumberSetter

Coordinates = jax.Array | np.ndarray


class ParametrisedScene(eqx.Module):
    """A scene and its initial state, in which p parameters set or change some of the numbers.

    - `values`: (p,) coordinates of the parameters on their scales, at which derivatives are
      computed.
    - `base`: scene and initial state before any change.
    - `changes`, `scales`: of each parameter.
    - `patterns`: folded constants of the scene, see `ConstantFolded`.
    """

    values: Coordinates
    base: tuple[Scene, State]
    changes: tuple[Change, ...] = eqx.field(static=True)
    scales: tuple[AbstractScale, ...] = eqx.field(static=True)
    patterns: tuple[PyTree, ...] = eqx.field(static=True)

    def at(self, values: ArrayLike) -> "ParametrisedScene":
        """Return a copy with other coordinates."""
        return eqx.tree_at(lambda f: f.values, self, jnp.asarray(values, float))

    def scene_and_state(self, values: Coordinates) -> tuple[Scene, State]:
        """Return scene and initial state at coordinates, with vectors as arrays (3,)."""
        scene, state = self.base
        for k, (change, scale) in enumerate(zip(self.changes, self.scales, strict=True)):
            scene, state = change(scene, state, scale.value(values[k]))
        return scene, state

    def varied(self) -> PyTree[bool]:
        """Return, in the structure of the scene, whether a parameter may change each leaf."""
        structure = jax.tree.structure(self.base[0])
        # If all parameters are numbers, their locations tell which leaves change: each
        # `NumberSetter` has the indices of the leaves that it sets.
        setters = [change for change in self.changes if isinstance(change, NumberSetter)]
        if len(setters) == len(self.changes):
            changed_leaves = {
                number.leaf for setter in setters if setter.in_scene for number in setter.numbers
            }
            return jax.tree.unflatten(
                structure, [k in changed_leaves for k in range(structure.num_leaves)]
            )
        # A user's function may change any leaf. JAX traces the functions here without computing
        # numbers, and each leaf that depends on a parameter becomes a tracer.
        is_traced: list[bool] = []

        def trace(values: jax.Array) -> jax.Array:
            leaves = jax.tree.leaves(self.scene_and_state(values)[0])
            is_traced[:] = [isinstance(leaf, Tracer) for leaf in leaves]
            return values

        jax.eval_shape(trace, np.zeros(len(self.changes)))
        return jax.tree.unflatten(structure, is_traced)

    def scene(self, values: Coordinates) -> Scene:
        """Return the scene at coordinates, with vectors and matrices as separate scalars and folded
        constants as Python numbers."""
        return unpack(ConstantFolded(self.scene_and_state(values)[0], self.patterns))

    def start(self, values: Coordinates) -> State:
        """Return the initial state at coordinates, with vectors as separate scalars."""
        return unpack(self.scene_and_state(values)[1])

    def with_derivatives(
        self,
        function: Callable[..., tuple[PyTree, PyTree]],
        primals: tuple[PyTree, ...],
        tangents: tuple[PyTree, ...],
    ) -> tuple[PyTree, PyTree, PyTree]:
        """Compute a function of the scene and its derivatives by the parameters, in forward mode.

        The arguments of the function are the scene, in the form of the method `scene`, and
        `primals`, earlier results of a run, whose derivatives by the parameters are `tangents`. It
        returns a value, which is differentiated, and an auxiliary result. Returned are the value,
        the auxiliary result, and the value's derivatives by the coordinates, (p, ...) for each
        array, at `self.values`.
        """

        def along(seed: jax.Array, tangents: tuple[PyTree, ...]) -> PyTree:
            return jax.jvp(
                lambda values, *rest: function(self.scene(values), *rest),
                (self.values, *primals),
                (seed, *tangents),
                has_aux=True,
            )

        count = len(self.values)
        tell_tangents(count)
        # One row of the identity for each parameter: vmap computes the value once for all
        # derivatives.
        value, derivatives, auxiliary = jax.vmap(along, out_axes=(None, 0, None))(
            jnp.eye(count), tangents
        )
        return value, auxiliary, derivatives


def parametrised(
    scene: Scene, state: State, parameters: Mapping[str, Parameter], values: Coordinates
) -> ParametrisedScene:
    """Return a scene and its initial state as functions of p parameters, in the order of `values`,
    their coordinates.

    **Raises:** `ValueError` for a parameter whose path does not lead to single numbers, and for a
    delay of a measured series, which is not part of a scene.
    """
    # A Python number would be a constant of the program, which would be compiled anew for each
    # value of the number.
    scene, state = with_arrays((scene, state))
    # The example 0.0 says that all values are single numbers.
    changes = tuple(p.variation.setter(scene, state, 0.0) for p in parameters.values())
    scales = tuple(p.scale for p in parameters.values())
    # Constants are folded only in leaves that no parameter changes. A first object without folded
    # constants finds these leaves.
    unfolded = ParametrisedScene(values, (scene, state), changes, scales, ())
    patterns = fold_constants(scene, unfolded.varied()).patterns
    return ParametrisedScene(values, (scene, state), changes, scales, patterns)
