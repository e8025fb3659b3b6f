"""Recorder of impacts, which are finished contacts.

While a contact lasts, its peak force and its largest penetration are updated after each accepted
step. When the contact ends, both are written into a row of a buffer, with the times and speeds of
its onset and its end. The penetration, negative where the surfaces are apart, is also called depth.
"""

from collections.abc import Callable, Mapping
from dataclasses import fields, replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from typing_extensions import override

from ..._compilation.xla import shared_by_many
from ..._dynamics.sampled_forces import holding
from ..._dynamics.system import System
from ..._math.interpolation import (
    Bend,
    Point,
    Quintic,
    Slope,
    hermite_rate,
    hermite_root,
    hermite_value,
    higher,
    highest,
)
from ..._math.vectors import Condition, Scalar
from ..._model.contact.laws import AbstractContactLaw, Gap, contact_normal_force
from ..._model.joints.base import ByLabel, each_label
from ...quantities.base import Instant
from ..reductions.base import Window
from ..results.impact_table import IMPACT_UNITS
from ..results.solution import contact_label
from ..step.solvers import UnrolledExplicit
from ..step.step_state import Method, Step, choose, without_weak_types
from .recorders import ROWS, RowBuffer
from .run_loop import AbstractRecorder, RunStart, StepOutcome

RESOLVED_TRAVEL = 1e-8
"""Smallest product of a step's length and the contact's speed, m, for which rates of the depth in
the step are computed from depths. Below it, rounding errors dominate the change of the depth."""
PIECES = 4
"""Number of equal intervals of a step in a first search for the peak of a contact. The contact may
fill only a small part of the step, unless steps end at its onset and its end."""


class ContactInstant(eqx.Module):
    """A contact at one instant.

    - `gap`: depth, m, and its rate, m/s, positive while the surfaces approach.
    - `second_rate`: second time derivative of the depth, m/s^2.
    - `entry_speed`: m/s; ``None`` if the contact law does not use it.
    """

    gap: Gap
    second_rate: Scalar
    entry_speed: Scalar | None

    def touches(self, law: AbstractContactLaw) -> Condition:
        """Return whether the contact has a force: whether its entry speed is not zero or, for a law
        that uses none, its depth is beyond the onset of the force."""
        if self.entry_speed is None:
            return self.gap.depth + law.onset_offset() > 0.0
        return self.entry_speed > 0.0

    def speed(self) -> Scalar:
        """Return the entry speed, m/s, or the present rate of the depth if the law uses none."""
        return self.gap.rate if self.entry_speed is None else self.entry_speed


def peak_in_step(
    law: AbstractContactLaw, start: ContactInstant, end: ContactInstant, h: Scalar
) -> tuple[Point, Scalar]:
    """Return the largest normal force, N, and the largest depth, m, of a contact in a step of
    length h, s, from `start` to `end`. The `Point` has the force and its place in the step, 0 to 1.

    In the whole step the law uses the entry speed at `start`. If this is zero, because the contact
    begins in the step, the law uses the current rate (see `contact_normal_force`).
    """
    first, last = (Bend(at.gap.depth, at.gap.rate, at.second_rate) for at in (start, end))
    quintic = Quintic.through(first, last, h)
    rates = Slope(start.gap.rate, start.second_rate), Slope(end.gap.rate, end.second_rate)
    # In very short steps the slope of the quintic suffers from rounding errors of the depths. The
    # cubic through rates and second rates does not. Whether the step is long enough is judged by
    # `speed`: the entry speed or, for a law that uses none, the rate.
    moves = h * jnp.abs(start.speed()) > RESOLVED_TRAVEL

    # The factor by which the law's force is multiplied at a place in the step, if the gap has one.
    # The normal force does not depend on the factor's rate, so this rate is set to zero.
    def factor(x: Scalar) -> Slope | None:
        at_start, at_end = start.gap.factor, end.gap.factor
        if at_start is None or at_end is None:
            return None
        return Slope(hermite_value(x, at_start, at_end, h), 0.0)

    def force(x: Scalar) -> Scalar:
        rate = jnp.where(moves, quintic.rate(x), hermite_value(x, *rates, h))
        gap = replace(start.gap, depth=quintic.value(x), rate=rate, factor=factor(x))
        return contact_normal_force(law, gap, start.entry_speed)

    return _largest(force), _largest(quintic.value).value


# Returns the peak of a function of the position in the step, 0 to 1.
def _largest(value_at: Callable[[Scalar], Scalar]) -> Point:
    # Among all triples of neighbouring points, the one with the highest middle point is selected.
    # The ends of the step are in the middle of no triple, so they are compared with the result.
    points = [Point(k / PIECES, value_at(k / PIECES)) for k in range(PIECES + 1)]
    best = points[:3]
    for k in range(2, PIECES):
        best = choose(points[k].value > best[1].value, points[k - 1 : k + 2], best)
    return higher(highest(value_at, *best), higher(points[0], points[-1]))


def end_in_step(
    law: AbstractContactLaw, start: ContactInstant, end: ContactInstant, h: Scalar
) -> Scalar:
    """Return the fraction, 0 to 1, of a step of length h, s, after which a contact that exists at
    `start` ends; 1 if it still exists at `end`. The depth in the step is taken as the cubic through
    the depths, and their rates, at both ends."""
    before, after = _depths(law, start, end)
    return jnp.where(after.value < 0.0, hermite_root(before, after, h), 1.0)


def _depths(
    law: AbstractContactLaw, start: ContactInstant, end: ContactInstant
) -> tuple[Slope, Slope]:
    """Return the depth beyond the force's onset, m, and its rate, m/s, at both ends of a step."""
    lead = law.onset_offset()
    return Slope(start.gap.depth + lead, start.gap.rate), Slope(end.gap.depth + lead, end.gap.rate)


INSTANTS = ("onset", "separation", "peak_time")
"""Names of the fields of an `ImpactRow` that are times since `System.origin`."""


class ImpactRow(eqx.Module):
    """A finished contact. Units are those of `Impacts`; times are counted from `System.origin`."""

    onset: Scalar
    separation: Scalar
    entry_speed: Scalar
    exit_speed: Scalar
    peak_force: Scalar
    peak_time: Scalar
    largest_penetration: Scalar

    def columns(self, *_: object) -> dict[str, Scalar]:
        """Return all fields by name, and the "duration", s. Arguments are ignored: lanes call this
        method with the arguments of `Snapshot.columns`, the other type of row."""
        return {**vars(self), "duration": self.separation - self.onset}


class ContactSoFar(eqx.Module):
    """A contact at the end of the latest accepted step.

    - `instant`: the contact at that time.
    - `begun`: whether it touches at that time and its onset was after the start of the run.
    - `row`: the contact's onset, entry speed and peaks so far, valid only if `begun`. `separation`
      and `exit_speed` have no meaning before the contact ends.
    """

    instant: ContactInstant
    begun: Condition
    row: ImpactRow

    def after(
        self, law: AbstractContactLaw, t0: Scalar, t1: Scalar, end: ContactInstant, lands: bool
    ) -> tuple["ContactSoFar", Condition, ImpactRow]:
        """Return the contact after a further step, from t0 to t1, s; whether a contact that began
        in an earlier step of the run ended in this one; and, valid only if it did, its row.

        **Arguments:** `end`: the contact at t1; `lands`: whether steps end at contact events.
        """
        start, row, h = self.instant, self.row, t1 - t0
        touched, touches = start.touches(law), end.touches(law)
        # The peak mostly lies inside a step, not at its ends.
        peak, deepest = peak_in_step(law, start, end, h)
        stronger = peak.value > row.peak_force
        depth_at_start, depth_at_end = _depths(law, start, end)
        x_end = end_in_step(law, start, end, h)
        # `separation` and `exit_speed` are overwritten in each step, until the contact ends. If
        # steps land at the ends of contacts, the rate there needs no interpolation.
        row = ImpactRow(
            onset=row.onset,
            separation=t0 + h * x_end,
            entry_speed=row.entry_speed,
            # Surfaces that separate have a negative rate of the depth, but a positive exit speed.
            exit_speed=-(
                end.gap.rate if lands else hermite_rate(x_end, depth_at_start, depth_at_end, h)
            ),
            peak_force=jnp.where(stronger, peak.value, row.peak_force),
            peak_time=jnp.where(stronger, t0 + h * peak.x, row.peak_time),
            largest_penetration=jnp.maximum(row.largest_penetration, deepest),
        )
        begins = touches & jnp.logical_not(touched)
        if lands:
            # Depth beyond the onset of the force over its rate: steps end just after an onset, so
            # the rate hardly changes in this time.
            since_onset = (end.gap.depth + law.onset_offset()) / end.gap.rate
            onset, speed = t1 - since_onset, end.speed()
            # The peaks of a contact that began in this step are minus infinity, so that its first
            # whole step, the next one, sets them. Hardly any part of the contact is in this step.
            unset = jnp.full_like(row.peak_force, -jnp.inf)
            peak_force, peak_time, largest_penetration = unset, t1, unset
        else:
            # The contact may have begun long before the end of the step, and may already recede
            # there.
            x_onset = hermite_root(depth_at_start, depth_at_end, h)
            onset = t0 + h * x_onset
            speed = hermite_rate(x_onset, depth_at_start, depth_at_end, h)
            peak_force, peak_time, largest_penetration = peak.value, t0 + h * peak.x, deepest
        # The separation and the exit speed are still unknown, so these fields get any numbers.
        fresh = ImpactRow(
            onset=onset,
            separation=t1,
            entry_speed=speed,
            exit_speed=end.gap.rate,
            peak_force=peak_force,
            peak_time=peak_time,
            largest_penetration=largest_penetration,
        )
        # A contact that exists at the start of the run gets no row, because its onset is unknown.
        begun = touches & (begins | self.begun)
        contact = ContactSoFar(end, begun, choose(begins, fresh, row))
        has_ended = self.begun & jnp.logical_not(touches)
        return contact, has_ended, row


class ContactRecord(eqx.Module):
    """A contact at the end of the latest accepted step, and the rows of its finished impacts."""

    contact: ContactSoFar
    rows: RowBuffer[ImpactRow]


ImpactRecord = dict[str, dict[str, ContactRecord]]
"""A `ContactRecord` for each contact, as record[joint][contact]."""


class ImpactRecorder(AbstractRecorder[ImpactRecord]):
    """Recorder of the impacts of one joint, or of all joints, with rows for each contact.

    - `joint`: name of the joint, or ``None`` for all joints.
    - `window`: span of the scene's time in which recorded contacts begin; ``None`` records all.
    - `capacity`: number of rows of each contact's buffer. Further impacts are counted, but their
      rows are lost, so the caller must empty a full buffer, or repeat the run with more room.
    - `wanted`: by label of the contact, such as "pin V", the number of impacts to record until the
      buffer is emptied; further ones are not counted. ``None`` for no such limit.
    """

    joint: str | None = eqx.field(default=None, static=True)
    window: Window | None = eqx.field(default=None, static=True)
    capacity: int = eqx.field(default=ROWS, static=True)
    wanted: Mapping[str, Scalar] | None = None

    @override
    def start(self, start: RunStart) -> ImpactRecord:
        # A contact that exists at the start of the run counts as not begun, and gets no row.
        begun, loop = jnp.asarray(False), start.loop
        blank = ImpactRow(**{field.name: jnp.zeros(()) for field in fields(ImpactRow)})
        rows = RowBuffer.like(blank, self.capacity)
        instants = self._instants(loop.method, loop.system, start.now, start.step)

        # The record of one contact, with an empty buffer.
        def record(name: str, label: str) -> ContactRecord:
            return ContactRecord(ContactSoFar(instants[name][label], begun, blank), rows)

        return each_label(record, instants)

    @override
    def after(self, record: ImpactRecord, step_outcome: StepOutcome) -> ImpactRecord:
        now, system, accepted = step_outcome.now, step_outcome.system, step_outcome.accepted
        t0, t1, laws = step_outcome.before.t, step_outcome.after.t, now.scene.laws()
        lands = step_outcome.method.landing is not None
        at_step_end = self._instants(step_outcome.method, system, now, step_outcome.after)
        # If a scene has many contacts, they share one trace of the function. Contacts of all joints
        # count, so that the bits of impacts do not depend on which joints are recorded.
        count = sum(map(len, laws.values()))

        def contact_after(name: str, label: str) -> ContactRecord:
            recorded = record[name][label]
            law, end = laws[name][label], at_step_end[name][label]
            arguments = recorded.contact, law, t0, t1, end, lands
            contact, has_ended, row = shared_by_many(count, ContactSoFar.after, *arguments)
            # A row is written if the contact ended in this step, and the row is to be recorded.
            written = accepted & has_ended
            if self.window is not None:
                written = written & self.window.at(now).holds(system.scene_time(row.onset))
            if self.wanted is not None:
                written = written & (self.wanted[contact_label(name, label)] > recorded.rows.count)
            rows = recorded.rows.with_row(row, written)
            return ContactRecord(choose(accepted, contact, recorded.contact), rows)

        return each_label(contact_after, record)

    def _instants(
        self, method: Method, system: System, now: Instant, step: Step
    ) -> dict[str, dict[str, ContactInstant]]:
        names = now.contacts if self.joint is None else [self.joint]
        second_rates = _second_rates(method, system, step)

        def instant(name: str, label: str) -> ContactInstant:
            speed = now.entry_speeds.get(name, {}).get(label)
            # The record must have the same types before and after a step.
            gap = without_weak_types(now.contacts[name][label].contact.gap)
            return ContactInstant(gap, second_rates[name][label], speed)

        return each_label(instant, {name: now.contacts[name] for name in names})


def _second_rates(method: Method, system: System, step: Step) -> ByLabel[Scalar]:
    """Return by joint and contact the second time derivatives of penetrations at `step`, m/s^2."""
    if isinstance(method.solver, UnrolledExplicit):
        return step.second_rates
    # Other solvers do not keep the rates at the end of a step, so they are computed here.
    motion = step.y.motion
    system = holding(system, step.y.memory)
    rates, _ = system.rates(motion, step.entry_speeds, step.t, bristles=step.y.bristles)
    # A rate may be a Python number. Adding zero times the variable gives it the variable's type, as
    # `jax.jvp` demands.
    rates = jax.tree.map(lambda like, rate: rate + 0.0 * like, motion, rates)
    return system.second_rates(motion, rates)


def most(record: ImpactRecord) -> int:
    """Return the largest number of impacts, recorded or not, of any contact; 0 without contacts."""
    contacts = (contact for family in record.values() for contact in family.values())
    return max((int(contact.rows.count) for contact in contacts), default=0)


def impact_rows_of(record: ImpactRecord, origin: float = 0.0) -> list[tuple[str | float, ...]]:
    """Return the impacts in a record of NumPy arrays as rows for `Impacts.of_rows`. `origin`, s,
    the scene's time from which the run counts its times, is added to all times."""
    rows: list[tuple[str | float, ...]] = []
    for joint, family in record.items():
        for contact, recorded in family.items():
            columns = recorded.rows.filled().columns()
            columns |= {name: columns[name] + origin for name in INSTANTS}
            numbers = (np.asarray(columns[name]).tolist() for name in IMPACT_UNITS)
            rows += [(joint, contact, *row) for row in zip(*numbers, strict=True)]
    return rows
