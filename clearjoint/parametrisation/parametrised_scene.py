"""A scene and its initial state as functions of parameters, and derivatives along them."""

import abc
from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from ..math.vectors import Structured, structured, unpack
from ..model.bodies import State
from ..model.scene import Scene
from .parameter import Parameter
from .scales import AbstractScale
from .variations import Change


class AbstractFamily(eqx.Module):
    """Scenes and initial states over parameters in scaled coordinates.

    `values`: (p,) where the family is looked at.
    """

    values: eqx.AbstractVar[Any]

    @abc.abstractmethod
    def scene(self, values: Any) -> Scene:
        """The scene, in scalar form."""

    @abc.abstractmethod
    def start(self, values: Any) -> Any:
        """The initial state, in scalar form."""

    def pushed(
        self, function: Callable[..., tuple[Any, Any]], primals: tuple[Any, ...], tangents: Any
    ) -> tuple[Any, Any, Any]:
        """A function of scene and `primals`, that returns a value and more: the value, what more,
        and the value's derivatives.

        `tangents` are the primals' derivatives, (p, ...) as those of the value.
        """

        def along(seed: Any, tangents: Any) -> Any:
            return jax.jvp(
                lambda values, *rest: function(self.scene(values), *rest),
                (self.values, *primals),
                (seed, *tangents),
                has_aux=True,
            )

        count = len(self.values)
        value, derivatives, more = jax.vmap(along, out_axes=(None, 0, None))(
            jnp.eye(count), tangents
        )
        return value, more, derivatives


class ParametrisedScene(AbstractFamily):
    """A scene and its initial state with some of their numbers free."""

    values: Any
    base: tuple[Scene, State]
    changes: tuple[Change, ...] = eqx.field(static=True)
    scales: tuple[AbstractScale, ...] = eqx.field(static=True)
    patterns: tuple[Any, ...] = eqx.field(static=True)

    def at(self, values: Any) -> "ParametrisedScene":
        """The family, looked at elsewhere."""
        return eqx.tree_at(lambda f: f.values, self, jnp.asarray(values, float))

    def made(self, values: Any) -> tuple[Scene, State]:
        """Scene and state, in packed form, at the parameters' coordinates."""
        scene, state = self.base
        for k, (change, scale) in enumerate(zip(self.changes, self.scales, strict=True)):
            scene, state = change(scene, state, scale.value(values[k]))
        return scene, state

    def varied(self) -> Any:
        """Which leaves of the scene depend on the parameters: booleans in its place."""
        found: list[bool] = []

        def made(values: Any) -> Any:
            found[:] = [isinstance(leaf, Tracer) for leaf in jax.tree.leaves(self.made(values)[0])]
            return values

        jax.eval_shape(made, np.zeros(len(self.changes)))
        return jax.tree.unflatten(jax.tree.structure(self.base[0]), found)

    def scene(self, values: Any) -> Scene:
        """The scene, in scalar form."""
        return unpack(Structured(self.made(values)[0], self.patterns))

    def start(self, values: Any) -> State:
        """The initial state, in scalar form."""
        return unpack(self.made(values)[1])


def parametrised(
    scene: Scene, state: State, parameters: Mapping[str, Parameter], values: Any
) -> ParametrisedScene:
    """The family of scenes that parameters span, looked at where their coordinates are `values`."""
    changes = tuple(p.variation.setter(scene, state, 0.0) for p in parameters.values())
    scales = tuple(p.scale for p in parameters.values())
    family = ParametrisedScene(values, (scene, state), changes, scales, ())
    patterns = structured(scene, family.varied()).patterns
    return ParametrisedScene(values, (scene, state), changes, scales, patterns)
