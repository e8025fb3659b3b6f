"""Recorder of impacts, for single runs, runs with derivatives and lanes of sweeps.

An impact is a finished contact. While a contact lasts, its peak force and its largest penetration
are updated after each accepted step. When the contact ends, they are written as a row of a buffer.
"""

from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ...dynamics.system import System
from ...math.groups import by_name
from ...math.vectors import Condition, Scalar
from ...model.contact.laws import AbstractContactLaw
from ...model.joints.base import ByLabel, each_label
from ...quantities.base import Quantity
from ...quantities.instant import Instant
from ..reductions.base import Window
from ..results.impact_table import IMPACT_UNITS
from ..results.state_tables import contact_label
from ..step.contact_step import (
    ContactInstant,
    begin_before,
    contact_instants,
    end_in_step,
    peak_in_step,
)
from ..step.solvers import UnrolledExplicit
from ..step.step_state import Method, Step, choose
from .recorders import ROWS, RowBuffer
from .run_loop import AbstractRecorder, RunStart, StepOutcome

INSTANTS = ("onset", "separation", "peak_time")
"""Names of the fields of an `ImpactRow` that are times on the clock of the run."""


class ImpactRow(eqx.Module):
    """A finished contact.

    - `onset`, `separation`: s, times at which the contact force began and ended.
    - `entry_speed`, `exit_speed`: m/s, speeds of approach at the onset and of separation at the
      end, both positive.
    - `peak_force`, `peak_time`: largest normal force in N, and its time in s.
    - `largest_penetration`: m.
    """

    onset: Scalar
    separation: Scalar
    entry_speed: Scalar
    exit_speed: Scalar
    peak_force: Scalar
    peak_time: Scalar
    largest_penetration: Scalar

    def columns(self, system: System, channels: Mapping[str, Quantity]) -> dict[str, Scalar]:
        """Return the columns of the table of impacts in a row, as `reported` does.

        The scheduler of lanes calls this method for the rows of all recorders. The arguments, which
        rows of sections need to compute their channels, are not used.
        """
        del system, channels
        return self.reported()

    def reported(self) -> dict[str, Scalar]:
        """Return all fields by name, and also the "duration" of the contact, s."""
        return {**vars(self), "duration": self.separation - self.onset}

    @staticmethod
    def none() -> "ImpactRow":
        """Return a row of zeros, from which a buffer of rows takes its structure."""
        return ImpactRow(*(jnp.zeros(()) for _ in range(7)))


class OpenContact(eqx.Module):
    """A contact at the end of the latest accepted step.

    - `instant`: its gap and entry speed at that time.
    - `begun`: whether it touches at that time and its onset was after the start of the run.
    - `row`: its onset and its peaks so far. `separation` and `exit_speed` of this row become valid
      in the step in which the contact ends.
    """

    instant: ContactInstant
    begun: Condition
    row: ImpactRow

    def after(
        self, law: AbstractContactLaw, t0: Scalar, t1: Scalar, end: ContactInstant
    ) -> tuple["OpenContact", Condition, ImpactRow]:
        """Return the contact after a further step, from t0 to t1, s.

        **Arguments:** `law`: the contact's law; `end`: the contact at t1.

        **Returns:** the contact after the step; whether a contact that began in the run ended in
        the step; and its row, which is valid only in this case.
        """
        start, row, h = self.instant, self.row, t1 - t0
        touched, touches = start.touches(law), end.touches(law)
        # The peak mostly lies inside a step, not at its ends.
        peak = peak_in_step(law, start, end, h)
        stronger = peak.force > row.peak_force
        # End and exit speed are overwritten in each step, until the contact ends.
        row = ImpactRow(
            row.onset,
            t0 + h * end_in_step(law, start, end, h),
            row.entry_speed,
            -end.gap.rate,
            jnp.where(stronger, peak.force, row.peak_force),
            jnp.where(stronger, t0 + h * peak.fraction, row.peak_time),
            jnp.maximum(row.largest_penetration, peak.depth),
        )
        begins = touches & jnp.logical_not(touched)
        # The peaks of a contact that began in this step are minus infinity, so that its first whole
        # step, the next one, sets them. Mostly steps end at onsets, and hardly any part of the
        # contact is in this step.
        nothing = jnp.full_like(row.peak_force, -jnp.inf)
        fresh = ImpactRow(
            t1 - begin_before(law, end), t1, end.speed(), end.gap.rate, nothing, t1, nothing
        )
        # A contact that exists at the start of the run gets no row, because its onset is unknown.
        begun = touches & (begins | self.begun)
        contact = OpenContact(end, begun, choose(begins, fresh, row))
        return contact, self.begun & jnp.logical_not(touches), row


class ContactRecord(eqx.Module):
    """A contact at the end of the latest accepted step, and the rows of its finished impacts."""

    contact: OpenContact
    rows: RowBuffer[ImpactRow]


ImpactRecord = dict[str, dict[str, ContactRecord]]
"""A `ContactRecord` for each contact, as record[joint][contact]."""


class ImpactRecorder(AbstractRecorder[ImpactRecord]):
    """Recorder of the impacts of one joint, or of all joints.

    - `joint`: name of the joint, or ``None`` for all joints.
    - `window`: span of time; only contacts with an onset in it are recorded. ``None`` records all.
    - `capacity`: number of rows of each contact's buffer. Further impacts are counted, but their
      rows are lost, so the caller must empty a full buffer, or repeat the run with more room.
    - `wanted`: largest number of impacts to record until the buffer is emptied, by the contact's
      label such as "pin V"; later ones are neither recorded nor counted. ``None`` for no such
      limit.
    """

    joint: str | None = eqx.field(default=None, static=True)
    window: Window | None = None
    capacity: int = eqx.field(default=ROWS, static=True)
    wanted: Mapping[str, Scalar] | None = None

    def start(self, start: RunStart) -> ImpactRecord:
        """Return empty buffers, and the contacts at the start of the run."""
        no, none, loop = jnp.asarray(False), ImpactRow.none(), start.loop
        rows = RowBuffer.like(none, self.capacity)
        instants = self._instants(loop.method, loop.system, start.now, start.step)
        return each_label(
            lambda name, label: ContactRecord(OpenContact(instants[name][label], no, none), rows),
            instants,
        )

    def after(self, record: ImpactRecord, step_outcome: StepOutcome) -> ImpactRecord:
        """Return the record after an attempt; it is unchanged if the step was not accepted."""
        now, system, kept = step_outcome.now, step_outcome.system, step_outcome.kept
        t0, t1, laws = step_outcome.before.t, step_outcome.after.t, now.scene.laws()
        ends = self._instants(step_outcome.method, system, now, step_outcome.after)

        def after(name: str, label: str) -> ContactRecord:
            one = record[name][label]
            contact, over, row = one.contact.after(laws[name][label], t0, t1, ends[name][label])
            # A row is written if the contact ended in this step, and the row is to be recorded.
            written = kept & over
            if self.window is not None:
                written = written & self.window.holds(system.clock(row.onset))
            if self.wanted is not None:
                written = written & (self.wanted[contact_label(name, label)] > one.rows.count)
            rows = one.rows.with_row(row, written)
            return ContactRecord(choose(kept, contact, one.contact), rows)

        return each_label(after, record)

    def _instants(
        self, method: Method, system: System, now: Instant, step: Step
    ) -> dict[str, dict[str, ContactInstant]]:
        """Return the gap of each recorded contact after a step, the second time derivative of its
        penetration, m/s^2, and its entry speed, m/s, by joint and contact; `now` is the same
        instant as `step`."""
        names = now.contacts if self.joint is None else [self.joint]
        forces = {name: now.contacts[name] for name in names}
        second_rates = by_name(_second_rates(method, system, step))
        return contact_instants(forces, second_rates, now.entry_speeds)


def _second_rates(method: Method, system: System, step: Step) -> ByLabel[Scalar]:
    """Return the second time derivatives of all penetrations at the end of a step, m/s^2, by joint
    and contact."""
    if isinstance(method.solver, UnrolledExplicit):
        return step.second_rates
    # Other solvers do not keep the rates at the end of a step, so they are computed here.
    motion = step.y.motion
    rates, _ = system.rates(motion, step.entry_speeds, step.t, bristles=step.y.bristles)
    # A rate may be a Python number. Adding zero times the variable gives it the variable's type, as
    # `jax.jvp` demands.
    rates = jax.tree.map(lambda like, rate: rate + 0.0 * like, motion, rates)
    return system.second_rates(motion, rates)


def most(record: ImpactRecord) -> int:
    """Return the number of impacts of the contact that has most of them.

    Impacts for which its buffer had no room are counted too, so that the result is the number of
    rows that the buffers need.
    """
    counts = (int(one.rows.count) for family in record.values() for one in family.values())
    return max(counts, default=0)


def impact_rows_of(record: ImpactRecord, origin: float = 0.0) -> list[tuple[str | float, ...]]:
    """Return the impacts in a record as rows for `Impacts.of_rows`, one tuple for each impact.

    **Arguments:** `record`: the record in NumPy arrays, whose buffers must have had room for all
    impacts; `origin`: s, the time at which the clock of the run was zero, which is added to all
    times.
    """
    rows: list[tuple[str | float, ...]] = []
    for joint, family in record.items():
        for contact, one in family.items():
            columns = one.rows.filled().reported()
            columns |= {name: columns[name] + origin for name in INSTANTS}
            numbers = (np.asarray(columns[name]).tolist() for name in IMPACT_UNITS)
            rows += [(joint, contact, *row) for row in zip(*numbers, strict=True)]
    return rows
