"""Buffers of rows that a run fills as it goes on."""

from dataclasses import replace
from typing import Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ...math.vectors import Condition, Scalar

R = TypeVar("R", bound=PyTree[Scalar])


class RowBuffer(eqx.Module, Generic[R]):
    """A buffer with a fixed number of rows, and the number of rows that were written.

    Each leaf of `rows` has the rows in front. In a full buffer `count` goes on: it is then the
    number of rows that would have been needed.
    """

    rows: R
    count: jax.Array

    @staticmethod
    def like(row: R, capacity: int) -> "RowBuffer[R]":
        """An empty buffer with room for `capacity` rows like the given one."""
        # One row more, which is overwritten by the rows for which there is no room.
        rows = jax.tree.map(lambda leaf: jnp.zeros((capacity + 1, *jnp.shape(leaf))), row)
        return RowBuffer(rows, jnp.zeros((), int))

    @property
    def capacity(self) -> int:
        """The number of rows for which there is room."""
        return jax.tree.leaves(self.rows)[0].shape[0] - 1

    def is_full(self) -> Condition:
        """Whether there is no room for another row."""
        return self.count >= self.capacity

    def with_row(self, row: R, wanted: Condition) -> "RowBuffer[R]":
        """The buffer with another row behind the last one, if the row is wanted."""

        def write() -> R:
            return jax.tree.map(
                lambda rows, leaf: jax.lax.dynamic_update_index_in_dim(rows, leaf, self.count, 0),
                self.rows,
                row,
            )

        rows = jax.lax.cond(wanted, write, lambda: self.rows)
        return RowBuffer(rows, self.count + wanted)

    def filled(self) -> R:
        """Copies of the rows that were written (host arrays)."""
        count = min(int(self.count), self.capacity)
        return jax.tree.map(lambda rows: np.array(rows[:count]), jax.device_get(self.rows))

    def emptied(self) -> "RowBuffer[R]":
        """The buffer without rows, to be filled again."""
        return replace(self, count=np.zeros((), int))
