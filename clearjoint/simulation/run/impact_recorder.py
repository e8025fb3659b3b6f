"""Recorder of impacts: a tally of each contact while it lasts, and a row when it ends.

Single runs, runs with derivatives and lanes of sweeps all use it.
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
from ...model.joints.base import ByLabel
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
from ..step.dense_output import Snapshot
from ..step.step_state import Method, Step, choose
from ..step.unrolled_runge_kutta import UnrolledExplicit
from .advance import StepOutcome
from .row_buffer import RowBuffer

INSTANTS = ("onset", "separation", "peak_time")
"""Fields of an `ImpactRow` that are times on the run's clock."""


class ImpactRow(eqx.Module):
    """A finished contact: times in s, speeds in m/s (both positive), force in N, depth in m."""

    onset: Scalar
    separation: Scalar
    entry_speed: Scalar
    exit_speed: Scalar
    peak_force: Scalar
    peak_time: Scalar
    largest_penetration: Scalar

    def columns(self, system: System, channels: Mapping[str, Quantity]) -> dict[str, Scalar]:
        """The reported columns by name; an impact has no channels."""
        del system, channels
        return self.reported()

    def reported(self) -> dict[str, Scalar]:
        """The fields by name, and the `duration` of the contact, s."""
        return {**vars(self), "duration": self.separation - self.onset}

    @staticmethod
    def none() -> "ImpactRow":
        """Return a row of zeros."""
        return ImpactRow(*(jnp.zeros(()) for _ in range(7)))


class OpenContact(eqx.Module):
    """A contact after the latest step, and its tally since it began.

    `instant`: its gap then. `begun`: whether it touches and began within the run. `row`: the tally,
    whose `separation` and `exit_speed` are final when the contact ends.
    """

    instant: ContactInstant
    begun: Condition
    row: ImpactRow

    def after(
        self, law: AbstractContactLaw, t0: Scalar, t1: Scalar, end: ContactInstant
    ) -> tuple["OpenContact", Condition, ImpactRow]:
        """Return the contact after a step from t0 to t1, whether it ended in it, and its row."""
        start, row, h = self.instant, self.row, t1 - t0
        touched, touches = start.touches(law), end.touches(law)
        # The peak mostly lies inside a step, not at its ends.
        peak = peak_in_step(law, start, end, h)
        stronger = peak.force > row.peak_force
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
        # Below any force and depth, so that the first step inside the contact sets the peak.
        nothing = jnp.full_like(row.peak_force, -jnp.inf)
        fresh = ImpactRow(
            t1 - begin_before(law, end), t1, end.speed(), end.gap.rate, nothing, t1, nothing
        )
        # A contact that touches at the start of the run has no known begin, and gets no row.
        begun = touches & (begins | self.begun)
        contact = OpenContact(end, begun, choose(begins, fresh, row))
        return contact, self.begun & jnp.logical_not(touches), row


class ContactRecord(eqx.Module):
    """A contact after the latest step, and the rows of its impacts that are over."""

    contact: OpenContact
    rows: RowBuffer[ImpactRow]


ImpactRecord = dict[str, dict[str, ContactRecord]]
"""Records by joint and contact, by the elements' own names."""
Wanted = dict[str, dict[str, Scalar]]
"""Largest numbers of rows, by joint and contact."""


class ImpactRecorder(eqx.Module):
    """Records the contacts of a joint, or of all joints.

    `joint`: its name, or ``None`` for all. `window`: only contacts that begin in it are recorded.
    """

    joint: str | None = eqx.field(default=None, static=True)
    window: Window | None = None

    def start(
        self, method: Method, system: System, step: Step, rows: RowBuffer[ImpactRow]
    ) -> ImpactRecord:
        """Return the record before the first step, with an empty buffer of `rows`."""
        now = Snapshot(step.t, step.y, step.entry_speeds).instant(system)
        no, none = jnp.asarray(False), ImpactRow.none()
        return {
            name: {
                label: ContactRecord(OpenContact(instant, no, none), rows)
                for label, instant in family.items()
            }
            for name, family in self._instants(method, system, now, step).items()
        }

    def after(
        self, record: ImpactRecord, step_outcome: StepOutcome, wanted: Wanted | None = None
    ) -> ImpactRecord:
        """Return the record after a step was tried, with at most the `wanted` rows if given."""
        laws = step_outcome.now.scene.laws()
        ends = self._instants(
            step_outcome.method, step_outcome.system, step_outcome.now, step_outcome.after
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

    def _instants(
        self, method: Method, system: System, now: Instant, step: Step
    ) -> dict[str, dict[str, ContactInstant]]:
        names = now.contacts if self.joint is None else [self.joint]
        forces = {name: now.contacts[name] for name in names}
        second_rates = by_name(_second_rates(method, system, step))
        return contact_instants(forces, second_rates, now.entry_speeds)


def _second_rates(method: Method, system: System, step: Step) -> ByLabel[Scalar]:
    """Second derivatives of the depths at the end of a step, m/s^2."""
    if isinstance(method.solver, UnrolledExplicit):
        return step.second_rates
    # Other solvers don't keep the rates at the end of a step.
    motion = step.y.motion
    rates, _ = system.rates(motion, step.entry_speeds, step.t, bristles=step.y.bristles)
    # Rates that are constants take the types of the variables, as `jax.jvp` demands.
    rates = jax.tree.map(lambda like, rate: rate + 0.0 * like, motion, rates)
    return system.second_rates(motion, rates)


def most(record: ImpactRecord) -> int:
    """Return the largest number of impacts of a contact, with those that found no room."""
    counts = (int(one.rows.count) for family in record.values() for one in family.values())
    return max(counts, default=0)


def impact_rows_of(record: ImpactRecord, origin: float = 0.0) -> list[tuple[str | float, ...]]:
    """Rows of a table of impacts: the finished contacts of a record (host arrays), none of whose
    buffers was too short, and whose clock showed zero at `origin`, s."""
    rows: list[tuple[str | float, ...]] = []
    for joint, family in record.items():
        for contact, one in family.items():
            columns = one.rows.filled().reported()
            columns |= {name: columns[name] + origin for name in INSTANTS}
            numbers = (np.asarray(columns[name]).tolist() for name in IMPACT_UNITS)
            rows += [(joint, contact, *row) for row in zip(*numbers, strict=True)]
    return rows


def _after(
    law: AbstractContactLaw,
    record: ContactRecord,
    step_outcome: StepOutcome,
    end: ContactInstant,
    wanted: Scalar | None,
    window: Window | None,
) -> ContactRecord:
    contact, over, row = record.contact.after(law, step_outcome.before.t, step_outcome.after.t, end)
    over = step_outcome.kept & over
    if window is not None:
        over = over & window.holds(step_outcome.system.clock(row.onset))
    if wanted is not None:
        over = over & (wanted > record.rows.count)
    rows = record.rows.with_row(row, over)
    return ContactRecord(choose(step_outcome.kept, contact, record.contact), rows)
