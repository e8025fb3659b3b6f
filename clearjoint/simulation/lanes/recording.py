"""Rows that lanes record: of states, of impacts and of sections.

A lane has a ring for each thing that it records. The host empties the rings, and a lane whose ring
is full waits for that.
"""

from typing import Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp

from ...math.vectors import Condition, Scalar
from ..run.advance import StepOutcome
from ..run.sections import Crossing
from ..step.dense_output import Snapshot
from ..step.types import Numbers

ROWS = 64
"""Rows of a ring."""
R = TypeVar("R", bound=eqx.Module)


class Ring(eqx.Module, Generic[R]):
    """Up to `ROWS` rows, and how many of them are filled.

    Each leaf of `rows` is an array with rows in front, and one more for a row that is not counted.
    """

    rows: R
    count: jax.Array

    @staticmethod
    def empty(row: R) -> "Ring[R]":
        """A ring for rows like the given one."""
        tables = jax.tree.map(lambda leaf: jnp.zeros((ROWS + 1, *jnp.shape(leaf))), row)
        return Ring(rows=tables, count=jnp.zeros((), int))

    def example(self) -> R:
        """A row, for its structure."""
        return jax.tree.map(lambda leaf: leaf[0], self.rows)

    def with_row(self, row: R, wanted: Condition) -> "Ring[R]":
        """The ring with the row behind the last one, if the row is wanted."""

        def write() -> R:
            return jax.tree.map(
                lambda rows, leaf: jax.lax.dynamic_update_index_in_dim(rows, leaf, self.count, 0),
                self.rows,
                row,
            )

        rows = jax.lax.cond(wanted, write, lambda: self.rows)
        return Ring(rows=rows, count=self.count + wanted)

    def next_of(self, window: Numbers) -> Scalar:
        """The first of the next times, s, that has no row yet; infinite if all have one."""
        return jnp.asarray(window)[self.count]

    def full(self) -> Condition:
        """Whether another row must wait for the host."""
        return self.count >= ROWS

    def waits(self, wanted: Scalar) -> Condition:
        """Whether a lane waits for the host, of which so many more rows are wanted."""
        return self.full() & (wanted > self.count)


class CrossingRecord(eqx.Module):
    """The level of a section where a lane is, and its crossings."""

    level: Scalar
    rows: Ring[Snapshot]


class CrossingRecorder(eqx.Module):
    """Records the crossings of a section, as many as are still wanted."""

    section: Crossing
    wanted: Scalar

    def __call__(self, record: CrossingRecord, step_outcome: StepOutcome) -> CrossingRecord:
        """The record after a stride, with a crossing more if the stride had one that is wanted."""
        kept, before, after = step_outcome.kept, record.level, self.section.level(step_outcome.now)
        row = self.section.row(step_outcome, before, after)
        rises = kept & (before < 0.0) & (after >= 0.0)
        wanted = rises & (row.t >= self.section.after) & (self.wanted > record.rows.count)
        return CrossingRecord(jnp.where(kept, after, before), record.rows.with_row(row, wanted))
