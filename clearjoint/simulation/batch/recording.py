"""What lanes record: rings that hold rows, and the rows of sections.

Inside the native loop nothing may be written at an index that differs from lane to lane, so a lane
has a ring of a few slots for each thing it records; the host empties them between segments, and a
lane whose ring is full waits for that.
"""

from typing import Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp

from ...math.vectors import Condition, Scalar
from ..advance import Stride
from ..dense_output import Snapshot
from ..sections import Crossing

SLOTS = 8
R = TypeVar("R", bound=eqx.Module)


class Ring(eqx.Module, Generic[R]):
    """A few rows, and how many of them are filled."""

    slots: tuple[R, ...]
    count: jax.Array

    @staticmethod
    def like(row: R) -> "Ring[R]":
        """A ring without rows, with slots for rows like the given one."""
        return Ring((row,) * SLOTS, jnp.zeros((), int))

    def full(self) -> Condition:
        """Whether all slots are taken, so that another row must wait for the host."""
        return self.count >= SLOTS

    def waits(self, wanted: Scalar) -> Condition:
        """Whether a lane waits for the host, of which so many more rows are wanted."""
        return self.full() & (wanted > self.count)

    def emptied(self) -> "Ring[R]":
        """The ring after the host has taken its rows."""
        return Ring(self.slots, jnp.zeros_like(self.count))

    def with_row(self, row: R, wanted: Condition) -> "Ring[R]":
        """The ring with the row in its next slot, if the row is wanted."""
        slots = tuple(
            jax.tree.map(
                lambda new, old, k=k: jnp.where(wanted & (self.count == k), new, old), row, slot
            )
            for k, slot in enumerate(self.slots)
        )
        return Ring(slots, self.count + wanted)


class CrossingRecord(eqx.Module):
    """The level of a section where a lane is, and its crossings."""

    level: Scalar
    rows: Ring[Snapshot]


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
