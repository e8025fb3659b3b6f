"""What lanes record: rings that hold rows, and the rows of sections.

Inside the native loop nothing may be written at an index that differs from lane to lane, so a lane
has a ring of a few slots for each thing it records; the host empties them between segments, and a
lane whose ring is full waits for that.
"""

from collections.abc import Callable
from typing import Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp

from ...math.interpolation import secant_root
from ...math.vectors import Condition, Scalar
from ...quantities.base import Quantity
from ...quantities.instant import Instant
from ..advance import Stride
from ..dense_output import Bracket, Snapshot, on_constraints
from ..step_state import Method

SLOTS = 8
R = TypeVar("R", bound=eqx.Module)


class Ring(eqx.Module, Generic[R]):
    """A few rows, and how many of them are filled."""

    slots: tuple[R, ...]
    count: jax.Array

    @staticmethod
    def like(row: R) -> "Ring[R]":
        """An empty ring."""
        return Ring((row,) * SLOTS, jnp.zeros((), int))

    def full(self) -> Condition:
        """Whether another row must wait."""
        return self.count >= SLOTS

    def waits(self, wanted: Scalar) -> Condition:
        """Whether a lane waits for the host, of which so many more rows are wanted."""
        return self.full() & (wanted > self.count)

    def emptied(self) -> "Ring[R]":
        """The ring after the host has taken its rows."""
        return Ring(self.slots, jnp.zeros_like(self.count))

    def with_row(self, row: R, wanted: Condition) -> "Ring[R]":
        """The row added, if it is wanted."""
        slots = tuple(
            jax.tree.map(
                lambda new, old, k=k: jnp.where(wanted & (self.count == k), new, old), row, slot
            )
            for k, slot in enumerate(self.slots)
        )
        return Ring(slots, self.count + wanted)


class Crossing(eqx.Module):
    """Where a Poincaré section is: a quantity passes zero, rising.

    **Arguments:** `quantity`: a scalar function of an `Instant`. `after`: s, earlier crossings are
    left out.
    """

    quantity: Quantity = eqx.field(static=True)
    after: float = eqx.field(default=0.0, static=True)

    def level(self, now: Instant) -> Scalar:
        """The quantity that passes zero."""
        return jnp.asarray(self.quantity(now), dtype=float)


class CrossingRecord(eqx.Module):
    """The level of a section where a lane is, and its crossings."""

    level: Scalar
    rows: Ring[Snapshot]


class CrossingRecorder(eqx.Module):
    """Records the crossings of a section, as many as are still wanted."""

    section: Crossing
    wanted: Scalar

    def __call__(self, record: CrossingRecord, stride: Stride) -> CrossingRecord:
        """The record after a stride."""
        system, kept = stride.system, stride.kept
        before, after = record.level, self.section.level(stride.now)

        def level(row: Snapshot) -> Scalar:
            return self.section.level(row.instant(system))

        row = crossing_row(stride.method, stride.bracket, before, after, level)
        row = Snapshot(row.t, on_constraints(system, row.y, row.t), row.memory)
        rises = kept & (before < 0.0) & (after >= 0.0)
        wanted = rises & (row.t >= self.section.after) & (self.wanted > record.rows.count)
        return CrossingRecord(jnp.where(kept, after, before), record.rows.with_row(row, wanted))


def crossing_row(
    method: Method,
    bracket: Bracket,
    before: Scalar,
    after: Scalar,
    value: Callable[[Snapshot], Scalar],
) -> Snapshot:
    """The row where a function of rows, of given values at both ends of the step, rises through
    zero, by the dense output."""
    start, end = bracket.start.t, bracket.end.t
    x = secant_root(lambda x: value(bracket.within(method, x)), before, after)
    return bracket.at(method, start + x * (end - start))
