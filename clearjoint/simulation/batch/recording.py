"""Looking inside the steps of a batch: dense output in scalar form, and rings that hold rows.

Inside the native loop nothing may be written at an index that differs from lane to lane, so a lane
has a ring of a few slots for each thing it records; the host empties them between segments, and a
lane whose ring is full waits for that.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from ...dynamics.contact_forces import Memory
from ...dynamics.system import System
from ...math.interpolation import secant_root
from ...math.vectors import Scalar
from ...quantities.instant import Instant
from ..dense_output import require_dense
from ..step_state import Attempt, Method, Variables, choose
from ..unrolled_runge_kutta import DenseOutput, UnrolledExplicit, place_in_step
from .reductions import Quantity

SLOTS = 8


class Row(eqx.Module):
    """A time, the variables and the memory there."""

    t: Scalar
    y: Variables
    memory: Memory

    def instant(
        self,
        system: System,
        inside: Callable[[Scalar], Instant] | None = None,
    ) -> Instant:
        """The system at this row; `inside` gives that at a place of the step that ends here."""
        motion, work = self.y.motion, self.y.work
        return Instant(system, self.t, motion, self.memory, work, inside)


class Bracket(eqx.Module):
    """The latest accepted step, with its stages."""

    start: Row
    end: Row
    stages: Any
    graded: Any

    @staticmethod
    def of(tried: Attempt) -> "Bracket":
        """The bracket of an accepted attempt."""
        step, inside = tried.step, tried.information
        return Bracket(
            Row(tried.t_start, inside["y0"], tried.memory_start),
            Row(step.t, step.y, step.memory),
            inside["stages"],
            tried.graded,
        )

    def inside(self, method: Method, x: Scalar) -> Variables:
        """The variables at a fraction x of the step, by the solver's dense output."""
        assert isinstance(method.solver, UnrolledExplicit)
        start, end = self.start, self.end
        dense = DenseOutput(method.solver.method, start.t, end.t, start.y, self.stages)
        return dense.at(place_in_step(x, self.graded))

    def within(self, method: Method, x: Scalar) -> Row:
        """The row at a fraction x of the step."""
        require_dense(method.solver)
        t = self.start.t + x * (self.end.t - self.start.t)
        return Row(t, self.inside(method, x), self.start.memory)

    def at(self, method: Method, t: Scalar) -> Row:
        """The row at a time of the step."""
        length = self.end.t - self.start.t
        x = (t - self.start.t) / jnp.where(length > 0.0, length, 1.0)
        ends = t >= self.end.t
        y = choose(ends, self.end.y, self.inside(method, x))
        return Row(t, y, choose(ends, self.end.memory, self.start.memory))


class Ring(eqx.Module):
    """A few rows, and how many of them are filled."""

    slots: tuple[Row, ...]
    count: Scalar

    @staticmethod
    def like(row: Row) -> "Ring":
        """An empty ring."""
        return Ring((row,) * SLOTS, jnp.zeros((), int))

    def full(self) -> Scalar:
        """Whether another row must wait."""
        return self.count >= SLOTS

    def emptied(self) -> "Ring":
        """The ring after the host has taken its rows."""
        return Ring(self.slots, jnp.zeros_like(self.count))

    def with_row(self, row: Row, wanted: Scalar) -> "Ring":
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


def crossing_row(
    method: Method,
    bracket: Bracket,
    before: Scalar,
    after: Scalar,
    value: Callable[[Row], Scalar],
) -> Row:
    """The row where a function of rows, of given values at both ends of the step, rises through
    zero, by the dense output."""
    start, end = bracket.start.t, bracket.end.t
    x = secant_root(lambda x: value(bracket.within(method, x)), before, after)
    return bracket.at(method, start + x * (end - start))
