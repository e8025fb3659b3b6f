"""A contact within one step: its peak, and where it ends, from what is known at the step's ends.

The depth is a quintic through depth, rate and second rate at both ends, which is two orders better
than the solver's dense output; the force is the law's along it.
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

RESOLVED_TRAVEL = 1e-8
"""Distance in m that a step must cover at entry speed for depths to tell the rate within it."""
PIECES = 4
"""In which a step is first searched for its peak: where steps don't land on the begin and end of a
contact, one may hold the whole of it."""


class ContactInstant(eqx.Module):
    """A contact at one instant: its gap, the second derivative of its depth, m/s^2, and the entry
    speed on record, m/s, or ``None`` if its law keeps none."""

    gap: Gap
    second_rate: Scalar
    entry_speed: Scalar | None

    def touches(self, law: AbstractContactLaw) -> Condition:
        """Whether the contact has a force: it has an entry speed on record or, if its law keeps
        none, a depth within the law's reach."""
        if self.entry_speed is None:
            return self.gap.depth + law.onset_offset() > 0.0
        return self.entry_speed > 0.0

    def speed(self) -> Scalar:
        """The entry speed on record, or the present rate where none is kept, m/s."""
        return self.gap.rate if self.entry_speed is None else self.entry_speed


def contact_instants(
    forces: dict[str, dict[str, LoadedContact]],
    second_rates: dict[str, dict[str, Scalar]],
    entry_speeds: EntrySpeeds,
) -> dict[str, dict[str, ContactInstant]]:
    """All contacts of an instant, by the elements' own names."""
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
    """The largest normal force of a contact in a step, N, the part of the step before it, and the
    largest depth, m."""

    force: Scalar
    place: Scalar
    depth: Scalar


def peak_in_step(
    law: AbstractContactLaw, start: ContactInstant, end: ContactInstant, h: Scalar
) -> StepPeak:
    """The peak of a contact in a step of length h, with the entry speed of its start.

    The rate is the quintic's slope, or in steps so short that rounding of the depth would spoil it
    the cubic through the rates and their derivatives.
    """
    quintic = Quintic.through(_bend(start), _bend(end), h)
    rates = Slope(start.gap.rate, start.second_rate), Slope(end.gap.rate, end.second_rate)
    moves = h * jnp.abs(start.speed()) > RESOLVED_TRAVEL

    def force(x: Scalar) -> Scalar:
        rate = jnp.where(moves, quintic.rate(x), hermite_value(x, *rates, h))
        gap = Gap(quintic.value(x), rate, start.gap.bearing_radius, start.gap.clearance)
        return contact_normal_force(law, gap, start.entry_speed)

    strongest = _largest(force)
    return StepPeak(strongest.value, strongest.x, _largest(quintic.value).value)


def _largest(value_at: Callable[[Scalar], Scalar]) -> Point:
    """The largest value of a function over a step."""
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
    """The part of a step of length h after which a contact that touches at its start is over, by
    the cubic through depths and rates; all of it where that finds no end."""
    ahead = law.onset_offset()
    before, after = (Slope(at.gap.depth + ahead, at.gap.rate) for at in (start, end))
    return jnp.where(after.value < 0.0, hermite_root(before, after, h), 1.0)


def begin_before(law: AbstractContactLaw, here: ContactInstant) -> Scalar:
    """How long before an instant a contact that has just begun did so, s."""
    return (here.gap.depth + law.onset_offset()) / here.gap.rate


def _array(leaf: Scalar) -> jax.Array:
    """Without a weak type, which a loop's result has not."""
    return jnp.asarray(leaf, dtype=jnp.result_type(leaf))


def _bend(at: ContactInstant) -> Bend:
    return Bend(at.gap.depth, at.gap.rate, at.second_rate)
