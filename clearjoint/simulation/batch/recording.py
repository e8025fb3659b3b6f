"""Rows that lanes record: of states, of impacts and of sections.

A lane has a ring for each thing that it records. The host empties the rings between segments, and a
lane whose ring is full waits for that. In loops that XLA compiles nothing may be written at an
index that differs from lane to lane, so that a `SlotRing` has a few slots that are scalars each;
native code writes into the arrays of a `TableRing`.
"""

import abc
from dataclasses import replace
from typing import Generic, Self, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp

from ...math.vectors import Condition, Scalar
from ..advance import Stride
from ..aliases import Numbers
from ..dense_output import Snapshot
from ..sections import Crossing

SLOTS, ROWS = 8, 64
"""Rows of a `SlotRing`, and of a `TableRing`."""
Times = tuple[Scalar, ...] | Numbers
"""Times, s, one more than a ring has rows: a tuple for a `SlotRing`, an array for a `TableRing`."""
R = TypeVar("R", bound=eqx.Module)


class AbstractRing(eqx.Module, Generic[R]):
    """A few rows, and how many of them are filled."""

    count: eqx.AbstractVar[jax.Array]

    @property
    @abc.abstractmethod
    def capacity(self) -> int:
        """The number of rows that it holds."""

    @abc.abstractmethod
    def example(self) -> R:
        """A row, for its structure."""

    @abc.abstractmethod
    def with_row(self, row: R, wanted: Condition) -> Self:
        """The ring with the row behind the last one, if the row is wanted."""

    @abc.abstractmethod
    def next_of(self, window: Times) -> Scalar:
        """The first of the next times, s, that has no row yet; infinite if all have one."""

    def full(self) -> Condition:
        """Whether another row must wait for the host."""
        return self.count >= self.capacity

    def waits(self, wanted: Scalar) -> Condition:
        """Whether a lane waits for the host, of which so many more rows are wanted."""
        return self.full() & (wanted > self.count)

    def emptied(self) -> Self:
        """The ring after the host has taken its rows."""
        return replace(self, count=jnp.zeros_like(self.count))


class SlotRing(AbstractRing[R]):
    """A ring of `SLOTS` rows of scalars."""

    slots: tuple[R, ...]
    count: jax.Array

    @property
    def capacity(self) -> int:
        """The number of rows that it holds."""
        return len(self.slots)

    def example(self) -> R:
        """A row, for its structure."""
        return self.slots[0]

    def with_row(self, row: R, wanted: Condition) -> "SlotRing[R]":
        """The ring with the row in its next slot, if the row is wanted."""
        slots = tuple(
            jax.tree.map(
                lambda new, old, k=k: jnp.where(wanted & (self.count == k), new, old), row, slot
            )
            for k, slot in enumerate(self.slots)
        )
        return SlotRing(slots=slots, count=self.count + wanted)

    def next_of(self, window: Times) -> Scalar:
        """The first of the next times, s, that has no row yet; infinite if all have one."""
        time: Scalar = window[self.capacity]
        for k in reversed(range(self.capacity)):
            time = jnp.where(self.count == k, window[k], time)
        return time


class TableRing(AbstractRing[R]):
    """A ring of `ROWS` rows, each leaf of which is an array with rows in front, and one more for
    a row that is not counted."""

    rows: R
    count: jax.Array

    @property
    def capacity(self) -> int:
        """The number of rows that it holds."""
        return jax.tree.leaves(self.rows)[0].shape[0] - 1

    def example(self) -> R:
        """A row, for its structure."""
        return jax.tree.map(lambda leaf: leaf[0], self.rows)

    def with_row(self, row: R, wanted: Condition) -> "TableRing[R]":
        """The ring with the row behind the last one, if the row is wanted."""

        def write() -> R:
            return jax.tree.map(
                lambda rows, leaf: jax.lax.dynamic_update_index_in_dim(rows, leaf, self.count, 0),
                self.rows,
                row,
            )

        rows = jax.lax.cond(wanted, write, lambda: self.rows)
        return TableRing(rows=rows, count=self.count + wanted)

    def next_of(self, window: Times) -> Scalar:
        """The first of the next times, s, that has no row yet; infinite if all have one."""
        return jnp.asarray(window)[self.count]


def empty_ring(row: R, rows: int) -> AbstractRing[R]:
    """A ring without rows, for rows like the given one: a `TableRing` of so many rows, or with
    none a `SlotRing`."""
    if not rows:
        return SlotRing(slots=(row,) * SLOTS, count=jnp.zeros((), int))
    tables = jax.tree.map(lambda leaf: jnp.zeros((rows + 1, *jnp.shape(leaf))), row)
    return TableRing(rows=tables, count=jnp.zeros((), int))


class CrossingRecord(eqx.Module):
    """The level of a section where a lane is, and its crossings."""

    level: Scalar
    rows: AbstractRing[Snapshot]


class CrossingRecorder(eqx.Module):
    """Records the crossings of a section, as many as are still wanted."""

    section: Crossing
    wanted: Scalar

    def __call__(self, record: CrossingRecord, stride: Stride) -> CrossingRecord:
        """The record after a stride, with a crossing more if the stride had one that is wanted."""
        kept, before, after = stride.kept, record.level, self.section.level(stride.now)
        row = self.section.row(stride, before, after)
        rises = kept & (before < 0.0) & (after >= 0.0)
        wanted = rises & (row.t >= self.section.after) & (self.wanted > record.rows.count)
        return CrossingRecord(jnp.where(kept, after, before), record.rows.with_row(row, wanted))
