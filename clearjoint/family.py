"""A scene and its initial state as functions of parameters, and derivatives along them."""

import abc
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from .scene import Scene


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
