"""Peak and end of a contact within one step, from its gap at the ends of the step.

The penetration is a quintic through depth, rate and second rate at both ends, which is two orders
more accurate than the solver's dense output. The force follows from it by the contact law.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ...dynamics.contact_forces import EntrySpeeds, LoadedContact
from ...math.interpolation import (
    Bend,
    Point,
    Quintic,
    Slope,
    hermite_root,
    hermite_value,
    higher,
    highest,
)
from ...math.vectors import Condition, Scalar
from ...model.contact.gap import Gap
from ...model.contact.laws import AbstractContactLaw, contact_normal_force
from ...model.joints.base import ByLabel

RESOLVED_TRAVEL = 1e-8
"""m: distance that a step must cover at entry speed for the rate inside it to follow from depths;
below, rounding of the depths dominates."""
PIECES = 4
"""Number of intervals in which a step is first searched for its peak. If steps do not land on
contact events, one step may contain a whole contact."""


class ContactInstant(eqx.Module):
    """A contact at one instant: its gap, the second derivative of its depth, m/s^2, and its entry
    speed, m/s, ``None`` if its law does not use one."""

    gap: Gap
    second_rate: Scalar
    entry_speed: Scalar | None

    def touches(self, law: AbstractContactLaw) -> Condition:
        """Whether the contact has a force: its entry speed is set or, if its law uses none, its
        depth is beyond the onset of the force."""
        if self.entry_speed is None:
            return self.gap.depth + law.onset_offset() > 0.0
        return self.entry_speed > 0.0

    def speed(self) -> Scalar:
        """Return the entry speed, or the present rate if the law uses none, m/s."""
        return self.gap.rate if self.entry_speed is None else self.entry_speed


def contact_instants(
    forces: ByLabel[LoadedContact], second_rates: ByLabel[Scalar], entry_speeds: EntrySpeeds
) -> ByLabel[ContactInstant]:
    """Return all contacts of an instant, by joint and contact label."""
    return {
        name: {
            label: ContactInstant(
                jax.tree.map(_array, force.contact.gap),
                second_rates[name][label],
                entry_speeds.get(name, {}).get(label),
            )
            for label, force in family.items()
        }
        for name, family in forces.items()
    }


class StepPeak(NamedTuple):
    """The largest normal force of a contact in a step, N, the fraction of the step at which it
    occurs, and the largest depth, m."""

    force: Scalar
    fraction: Scalar
    depth: Scalar


def peak_in_step(
    law: AbstractContactLaw, start: ContactInstant, end: ContactInstant, h: Scalar
) -> StepPeak:
    """Return the peak of a contact in a step of length h, s, with the entry speed of its start."""
    quintic = Quintic.through(_bend(start), _bend(end), h)
    rates = Slope(start.gap.rate, start.second_rate), Slope(end.gap.rate, end.second_rate)
    # In very short steps the slope of the quintic suffers from rounding of the depths; the cubic
    # through rates and second rates does not.
    moves = h * jnp.abs(start.speed()) > RESOLVED_TRAVEL

    def force(x: Scalar) -> Scalar:
        rate = jnp.where(moves, quintic.rate(x), hermite_value(x, *rates, h))
        gap = Gap(quintic.value(x), rate, start.gap.bearing_radius, start.gap.clearance)
        return contact_normal_force(law, gap, start.entry_speed)

    strongest = _largest(force)
    return StepPeak(strongest.value, strongest.x, _largest(quintic.value).value)


def _largest(value_at: Callable[[Scalar], Scalar]) -> Point:
    """Return the largest value of a function over the fractions 0 to 1 of a step.

    The largest of the inner points selects the three points around which the peak is refined; then
    the ends of the step are compared with it.
    """
    points = [Point(k / PIECES, value_at(k / PIECES)) for k in range(PIECES + 1)]
    first, middle, last = points[:3]
    for k in range(2, PIECES):
        better = points[k].value > middle.value
        chosen = points[k - 1], points[k], points[k + 1]
        first, middle, last = jax.tree.map(
            lambda new, old, better=better: jnp.where(better, new, old),
            chosen,
            (first, middle, last),
        )
    ends = higher(points[0], points[-1])
    return higher(highest(value_at, first, middle, last), ends)


def end_in_step(
    law: AbstractContactLaw, start: ContactInstant, end: ContactInstant, h: Scalar
) -> Scalar:
    """Return the fraction of a step of length h, s, at which a contact that exists at its start
    ends, by the cubic through depths and rates; 1 if it does not end."""
    ahead = law.onset_offset()
    before, after = (Slope(at.gap.depth + ahead, at.gap.rate) for at in (start, end))
    return jnp.where(after.value < 0.0, hermite_root(before, after, h), 1.0)


def begin_before(law: AbstractContactLaw, instant: ContactInstant) -> Scalar:
    """Return the time between the onset of a contact and an instant just after it, s."""
    return (instant.gap.depth + law.onset_offset()) / instant.gap.rate


def _array(leaf: Scalar) -> jax.Array:
    """Return the number without weak type: the state of a loop must keep its types."""
    return jnp.asarray(leaf, dtype=jnp.result_type(leaf))


def _bend(at: ContactInstant) -> Bend:
    return Bend(at.gap.depth, at.gap.rate, at.second_rate)
