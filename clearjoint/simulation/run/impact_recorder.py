"""Impacts recorded while a run is on its way: a running tally of each contact, a row at its end.

The numbers are those of the table in `clearjoint.simulation.results.impact_table`, which is made
afterwards from the record of a single run's steps.
"""

from collections.abc import Mapping
from typing import Generic, Protocol, Self, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ...dynamics.system import System
from ...math.groups import by_name
from ...math.vectors import Condition, Scalar
from ...model.contact.laws import AbstractContactLaw
from ...quantities.base import Quantity
from ...quantities.instant import Instant
from ..reductions.windows import Window
from ..results.impact_table import IMPACT_UNITS
from ..step.contact_step import (
    ContactInstant,
    begin_before,
    contact_instants,
    end_in_step,
    peak_in_step,
)
from ..step.step_state import Step, choose
from .advance import StepOutcome
from .row_buffer import RowBuffer

INSTANTS = ("onset", "separation", "peak_time")
"""Which of these go by the clock."""


class ImpactRow(eqx.Module):
    """A finished contact: begin, end and peak s; speeds m/s, both positive; N; m."""

    onset: Scalar
    separation: Scalar
    entry_speed: Scalar
    exit_speed: Scalar
    peak_force: Scalar
    peak_time: Scalar
    largest_penetration: Scalar

    def columns(self, system: System, channels: Mapping[str, Quantity]) -> dict[str, Scalar]:
        """What is reported of the row, by name; no channels are taken at an impact."""
        del system, channels
        return self.reported()

    def reported(self) -> dict[str, Scalar]:
        """The fields by name, and the `duration` of the contact, s."""
        return {**vars(self), "duration": self.separation - self.onset}

    @staticmethod
    def none() -> "ImpactRow":
        """A row of zeros, in place of one that is not there."""
        return ImpactRow(*(jnp.zeros(()) for _ in range(7)))


class OpenContact(eqx.Module):
    """A contact where the run is: `here`, and what is known of it since it began.

    `seen`: whether it touches and its begin was seen. `row`: what it comes to so far, of which
    `separation` and `exit_speed` come last.
    """

    here: ContactInstant
    seen: Condition
    row: ImpactRow

    def after(
        self, law: AbstractContactLaw, t0: Scalar, t1: Scalar, end: ContactInstant
    ) -> tuple["OpenContact", Condition, ImpactRow]:
        """The contact after a step from t0 to t1; whether one was over in it, and its row."""
        here, row, h = self.here, self.row, t1 - t0
        touched, touches = here.touches(law), end.touches(law)
        peak = peak_in_step(law, here, end, h)
        stronger = peak.force > row.peak_force
        row = ImpactRow(
            row.onset,
            t0 + h * end_in_step(law, here, end, h),
            row.entry_speed,
            -end.gap.rate,
            jnp.where(stronger, peak.force, row.peak_force),
            jnp.where(stronger, t0 + h * peak.fraction, row.peak_time),
            jnp.maximum(row.largest_penetration, peak.depth),
        )
        begins = touches & jnp.logical_not(touched)
        nothing = jnp.full_like(row.peak_force, -jnp.inf)
        fresh = ImpactRow(
            t1 - begin_before(law, end), t1, end.speed(), end.gap.rate, nothing, t1, nothing
        )
        seen = touches & (begins | self.seen)
        contact = OpenContact(end, seen, choose(begins, fresh, row))
        return contact, self.seen & jnp.logical_not(touches), row


class Sink(Protocol):
    """A place for rows, such as a table or a ring, that counts them."""

    count: jax.Array

    def with_row(self, row: PyTree, wanted: Condition) -> Self:
        """The sink with another row, if it is wanted."""
        ...


S = TypeVar("S", bound=Sink)


class ContactRecord(eqx.Module, Generic[S]):
    """What is known of a contact, and its finished ones."""

    contact: OpenContact
    rows: S


ImpactRecord = dict[str, dict[str, ContactRecord[S]]]
"""Records by joint and contact, by the elements' own names."""
Wanted = dict[str, dict[str, Scalar]]
"""Numbers of rows by joint and contact."""


class ImpactRecorder(eqx.Module):
    """Records the contacts of a joint, or of all joints.

    `joint`: its name, or ``None``. `window`: the part of the run in which they begin, or ``None``.
    """

    joint: str | None = eqx.field(default=None, static=True)
    window: Window | None = None

    def start(self, now: Instant, step: Step, rows: S) -> ImpactRecord[S]:
        """The record before the first step. Contacts that touch then are left out."""
        return {
            name: {
                label: ContactRecord(OpenContact(here, jnp.asarray(False), ImpactRow.none()), rows)
                for label, here in family.items()
            }
            for name, family in self._instants(now, step).items()
        }

    def after(
        self, record: ImpactRecord[S], step_outcome: StepOutcome, wanted: Wanted | None = None
    ) -> ImpactRecord[S]:
        """The record after a stride; of each contact no more rows than are wanted, if that is
        said."""
        laws, ends = (
            step_outcome.now.scene.laws(),
            self._instants(step_outcome.now, step_outcome.after),
        )
        return {
            name: {
                label: _after(
                    laws[name][label],
                    one,
                    step_outcome,
                    ends[name][label],
                    None if wanted is None else wanted[name][label],
                    self.window,
                )
                for label, one in family.items()
            }
            for name, family in record.items()
        }

    def _instants(self, now: Instant, step: Step) -> dict[str, dict[str, ContactInstant]]:
        names = now.contacts if self.joint is None else [self.joint]
        forces = {name: now.contacts[name] for name in names}
        return contact_instants(forces, by_name(step.second_rates), now.entry_speeds)


def most(record: ImpactRecord[RowBuffer]) -> int:
    """The number of impacts of the contact that had most, also of those that found no room."""
    counts = (int(one.rows.count) for family in record.values() for one in family.values())
    return max(counts, default=0)


def impact_rows_of(
    record: ImpactRecord[RowBuffer], origin: float = 0.0
) -> list[tuple[str | float, ...]]:
    """Rows of a table of impacts: the finished contacts of a record (host arrays), none of whose
    buffers was too short, and whose clock showed zero at `origin`, s."""
    rows: list[tuple[str | float, ...]] = []
    for joint, family in record.items():
        for contact, one in family.items():
            columns = one.rows.filled().reported()
            columns |= {name: columns[name] + origin for name in INSTANTS}
            numbers = (columns[name].tolist() for name in IMPACT_UNITS)
            rows += [(joint, contact, *row) for row in zip(*numbers, strict=True)]
    return rows


def _after(
    law: AbstractContactLaw,
    record: ContactRecord[S],
    step_outcome: StepOutcome,
    end: ContactInstant,
    wanted: Scalar | None,
    window: Window | None,
) -> ContactRecord[S]:
    contact, over, row = record.contact.after(law, step_outcome.before.t, step_outcome.after.t, end)
    over = step_outcome.kept & over
    if window is not None:
        over = over & window.holds(step_outcome.system.clock(row.onset))
    if wanted is not None:
        over = over & (wanted > record.rows.count)
    rows = record.rows.with_row(row, over)
    return ContactRecord(choose(step_outcome.kept, contact, record.contact), rows)
