"""Peak and end of a contact within one step, from its gap at the ends of the step.

The penetration is interpolated by a quintic through its value, first and second derivative at both
ends, which is two orders more accurate than the solver's dense output. The contact law at the
interpolated penetration gives the force.
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
"""Smallest distance, m, of a step at entry speed for which rates inside the step are found from
depths; in a shorter step, rounding of the depths dominates their differences."""
PIECES = 4
"""Number of equal intervals at whose ends a step is first searched for its peak. If steps do not
land on contact events, one step may contain a whole contact."""


class ContactInstant(eqx.Module):
    """A contact at one instant.

    - `gap`: depth, m, and its rate, m/s.
    - `second_rate`: second derivative of the depth, m/s^2.
    - `entry_speed`: m/s, zero in flight; ``None`` if the contact law does not use it.
    """

    gap: Gap
    second_rate: Scalar
    entry_speed: Scalar | None

    def touches(self, law: AbstractContactLaw) -> Condition:
        """Return whether the contact has a force. It has one if its entry speed is set or, if `law`
        uses no entry speed, if its depth is beyond the onset of the force."""
        if self.entry_speed is None:
            return self.gap.depth + law.onset_offset() > 0.0
        return self.entry_speed > 0.0

    def speed(self) -> Scalar:
        """Return the entry speed, m/s; the present rate of the depth if the law uses no entry
        speed."""
        return self.gap.rate if self.entry_speed is None else self.entry_speed


def contact_instants(
    forces: ByLabel[LoadedContact], second_rates: ByLabel[Scalar], entry_speeds: EntrySpeeds
) -> ByLabel[ContactInstant]:
    """Return all contacts at one instant, by joint and contact.

    **Arguments:** by joint and contact, `forces`: contacts with their forces; `second_rates`:
    second derivatives of depths, m/s^2; `entry_speeds`: m/s, only of contacts whose law uses them.
    """
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
    """The peak of a contact in a step.

    - `force`: largest normal force, N; `fraction`: part of the step, 0 to 1, at which it occurs.
    - `depth`: largest depth, m, which may occur at another time.
    """

    force: Scalar
    fraction: Scalar
    depth: Scalar


def peak_in_step(
    law: AbstractContactLaw, start: ContactInstant, end: ContactInstant, h: Scalar
) -> StepPeak:
    """Return the peak of a contact in a step of length h, s.

    **Arguments:** `start`, `end`: the contact at the ends of the step; the entry speed at `start`
    holds in the whole step.
    """
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
    """Return the largest value of a function on 0 to 1, and where it is.

    The function is evaluated at `PIECES` + 1 points. The peak is refined around the largest inner
    point, and the ends are compared with the result.
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
    """Return the fraction, 0 to 1, of a step of length h, s, at which a contact ends; 1 if it does
    not.

    The depth is interpolated by the cubic through depths and rates at `start`, where the contact
    must exist, and `end`.
    """
    ahead = law.onset_offset()
    before, after = (Slope(at.gap.depth + ahead, at.gap.rate) for at in (start, end))
    return jnp.where(after.value < 0.0, hermite_root(before, after, h), 1.0)


def begin_before(law: AbstractContactLaw, instant: ContactInstant) -> Scalar:
    """Return the time from the onset of a contact to an instant just after the onset, s."""
    return (instant.gap.depth + law.onset_offset()) / instant.gap.rate


def _array(leaf: Scalar) -> jax.Array:
    """Return the number as an array without weak type: the state of a loop must keep its types."""
    return jnp.asarray(leaf, dtype=jnp.result_type(leaf))


def _bend(at: ContactInstant) -> Bend:
    return Bend(at.gap.depth, at.gap.rate, at.second_rate)
