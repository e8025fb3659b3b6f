"""Peak and end of a contact within one step, from the depth and its rate at the ends of the step.

The depth of a contact (its penetration, m) is interpolated by a quintic polynomial through its
value, first and second time derivative at both ends of the step, which is two orders more accurate
than the solver's dense output. The contact law at the interpolated depth gives the force.
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
from ...model.joints.base import ByLabel, each_label

RESOLVED_TRAVEL = 1e-8
"""Smallest length of a step, times the entry speed, m, at which rates inside the step are computed
from depths. In a shorter step, rounding errors of the depths dominate their differences."""
PIECES = 4
"""Number of equal intervals into which a step is divided for the first search of its peak. If steps
do not end at contact events, one step may contain a whole contact."""


class ContactInstant(eqx.Module):
    """A contact at one instant.

    - `gap`: depth, m, and its rate, m/s.
    - `second_rate`: second time derivative of the depth, m/s^2.
    - `entry_speed`: m/s, rate of the depth at the onset of the contact, zero in flight; ``None`` if
      the contact law does not use it.
    """

    gap: Gap
    second_rate: Scalar
    entry_speed: Scalar | None

    def touches(self, law: AbstractContactLaw) -> Condition:
        """Return whether the contact has a force under its contact law.

        It has one if its entry speed is not zero or, for a law that uses no entry speed, if its
        depth is beyond the onset of the force.
        """
        if self.entry_speed is None:
            return self.gap.depth + law.onset_offset() > 0.0
        return self.entry_speed > 0.0

    def speed(self) -> Scalar:
        """Return the entry speed, m/s, or the present rate of the depth if the law uses no entry
        speed."""
        return self.gap.rate if self.entry_speed is None else self.entry_speed


def contact_instants(
    forces: ByLabel[LoadedContact], second_rates: ByLabel[Scalar], entry_speeds: EntrySpeeds
) -> ByLabel[ContactInstant]:
    """Return all contacts at one instant, by joint and contact.

    **Arguments:** all are by joint and contact; `forces`: contacts with their forces;
    `second_rates`: second time derivatives of depths, m/s^2; `entry_speeds`: m/s, only of contacts
    whose law uses them.
    """

    def instant(name: str, label: str) -> ContactInstant:
        gap = jax.tree.map(_array, forces[name][label].contact.gap)
        return ContactInstant(gap, second_rates[name][label], entry_speeds.get(name, {}).get(label))

    return each_label(instant, forces)


class StepPeak(NamedTuple):
    """The peak of a contact in a step.

    - `force`: largest normal force, N.
    - `fraction`: part of the step's time, 0 to 1, after which this force occurs.
    - `depth`: largest depth, m, which may occur at another time.
    """

    force: Scalar
    fraction: Scalar
    depth: Scalar


def peak_in_step(
    law: AbstractContactLaw, start: ContactInstant, end: ContactInstant, h: Scalar
) -> StepPeak:
    """Return the peak of a contact in a step of length h, s.

    **Arguments:** `law`: the contact law; `start`, `end`: the contact at the ends of the step. The
    entry speed at `start` is used in the whole step.
    """
    quintic = Quintic.through(_bend(start), _bend(end), h)
    rates = Slope(start.gap.rate, start.second_rate), Slope(end.gap.rate, end.second_rate)
    # In very short steps the slope of the quintic suffers from rounding errors of the depths. The
    # cubic through rates and second rates does not.
    moves = h * jnp.abs(start.speed()) > RESOLVED_TRAVEL

    def force(x: Scalar) -> Scalar:
        rate = jnp.where(moves, quintic.rate(x), hermite_value(x, *rates, h))
        gap = Gap(quintic.value(x), rate, start.gap.bearing_radius, start.gap.clearance)
        return contact_normal_force(law, gap, start.entry_speed)

    strongest = _largest(force)
    return StepPeak(strongest.value, strongest.x, _largest(quintic.value).value)


def _largest(value_at: Callable[[Scalar], Scalar]) -> Point:
    """Return the largest value of a function on the interval 0 to 1, and its position.

    The function is evaluated at `PIECES` + 1 equidistant points. The peak is refined around the
    inner point with the largest value, and the values at both ends are compared with the result.
    """
    # Among all triples of neighbouring points, the one with the highest middle point is selected.
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
    """Return the fraction, 0 to 1, of a step of length h, s, after which a contact ends; 1 if it
    does not end in the step.

    The depth is interpolated by the cubic through depths and rates at `start`, where the contact
    must exist, and at `end`.
    """
    # Depths are counted from the onset of the force.
    ahead = law.onset_offset()
    before, after = (Slope(at.gap.depth + ahead, at.gap.rate) for at in (start, end))
    return jnp.where(after.value < 0.0, hermite_root(before, after, h), 1.0)


def begin_before(law: AbstractContactLaw, instant: ContactInstant) -> Scalar:
    """Return the time, s, from the onset of a contact to an instant just after it.

    It is the depth beyond the onset of the force, divided by its rate. Steps end just after an
    onset, so the rate hardly changes in this time.
    """
    return (instant.gap.depth + law.onset_offset()) / instant.gap.rate


def _array(leaf: Scalar) -> jax.Array:
    """Return a number as a JAX array without weak type, because the state of a loop must keep its
    types."""
    return jnp.asarray(leaf, dtype=jnp.result_type(leaf))


def _bend(at: ContactInstant) -> Bend:
    """Return depth, rate and second rate of a contact, as interpolation needs them."""
    return Bend(at.gap.depth, at.gap.rate, at.second_rate)
