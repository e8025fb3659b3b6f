"""Tables with room for so many rows, that a run fills on its way."""

from typing import Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ...math.vectors import Condition, Scalar

R = TypeVar("R", bound=PyTree[Scalar])


class Table(eqx.Module, Generic[R]):
    """A table of so many rows at most; `count` goes on where it is full."""

    rows: R
    count: jax.Array

    @staticmethod
    def like(row: R, capacity: int) -> "Table[R]":
        """An empty table. It has one row more than it holds, into which goes what is
        not wanted."""
        rows = jax.tree.map(lambda leaf: jnp.zeros((capacity + 1, *jnp.shape(leaf))), row)
        return Table(rows, jnp.zeros((), int))

    def with_row(self, row: R, wanted: Condition) -> "Table[R]":
        """The row written behind the last one, and counted if it is wanted."""
        rows = jax.tree.map(
            lambda rows, leaf: jax.lax.dynamic_update_index_in_dim(rows, leaf, self.count, 0),
            self.rows,
            row,
        )
        return Table(rows, self.count + wanted)
