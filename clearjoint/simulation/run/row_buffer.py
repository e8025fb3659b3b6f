"""Buffers of fixed size that compiled code fills with rows, such as finished impacts."""

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
    """A buffer with room for a fixed number of rows; each row is a PyTree of numbers.

    - `rows`: a PyTree with the structure of a row, whose leaves have the rows in front.
    - `count`: number of rows written so far, including rows for which there was no room.
    """

    rows: R
    count: jax.Array

    @staticmethod
    def like(row: R, capacity: int) -> "RowBuffer[R]":
        """Return an empty buffer for `capacity` rows with the structure and shapes of `row`."""
        # One row more, which is overwritten by the rows for which there is no room.
        rows = jax.tree.map(lambda leaf: jnp.zeros((capacity + 1, *jnp.shape(leaf))), row)
        return RowBuffer(rows, jnp.zeros((), int))

    @property
    def capacity(self) -> int:
        """Number of rows for which the buffer has room in all, full or empty."""
        return jax.tree.leaves(self.rows)[0].shape[0] - 1

    def is_full(self) -> Condition:
        """Return whether there is no room for another row."""
        return self.count >= self.capacity

    def with_row(self, row: R, wanted: Condition) -> "RowBuffer[R]":
        """Return the buffer with another row behind the last one if `wanted`, else unchanged."""

        def write() -> R:
            return jax.tree.map(
                lambda rows, leaf: jax.lax.dynamic_update_index_in_dim(rows, leaf, self.count, 0),
                self.rows,
                row,
            )

        rows = jax.lax.cond(wanted, write, lambda: self.rows)
        return RowBuffer(rows, self.count + wanted)

    def filled(self) -> R:
        """Return copies of the written rows as NumPy arrays, with their number in front."""
        count = min(int(self.count), self.capacity)
        return jax.tree.map(lambda rows: np.array(rows[:count]), jax.device_get(self.rows))

    def emptied(self) -> "RowBuffer[R]":
        """Return the buffer with `count` zero, so that its rows are written anew."""
        return replace(self, count=np.zeros((), int))
