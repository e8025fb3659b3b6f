"""Steps that land on the begin and end of contacts.

A step that begins in flight and ends deeper than the landing tolerance is rejected and tried again
to the root of the gap's Hermite interpolant; likewise one that leaves a contact. How deep contacts
are, and what they remember, is in `clearjoint.dynamics.contact_events`.
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from ...dynamics.contact_events import ContactGap, ContactGaps
from ...math.groups import any_, min_
from ...math.interpolation import Slope, hermite_rate, hermite_root, hermite_value
from ...math.vectors import Condition, Scalar
from .types import SecondRates

LATEST = 1e-11
"""s past an event, at its rate, within which a step must land. The depth landed at holds energy
that nothing brought there; the landing tolerance alone may be deeper than a slow impact."""
CLOSEST = 1e-4
"""Of the landing tolerance: what is asked of however slow a contact, since gaps are rounded."""


class Landing(eqx.Module):
    """Landing on the instants where contacts begin and end.

    **Arguments:** `tolerance`: m, the depth within which a step must land; slow contacts closer, in
    proportion to their rate.
    """

    tolerance: Scalar

    def _depth(self, rate: Scalar) -> Scalar:
        """The depth within which to land at a rate in m/s."""
        return self.tolerance * jnp.clip(jnp.abs(rate) * (LATEST / self.tolerance), CLOSEST, 1.0)

    def time_to_next_event(self, contact_gaps: ContactGaps, second_rates: SecondRates) -> Scalar:
        """Time in s to the next event, by the parabolas through depths, rates and second rates.

        A step that would go past it ends there instead: a trial step that meets a wall it does not
        know of has an error beyond all bounds, and would be cut down again and again.
        """
        soonest: Scalar = jnp.inf
        for name, family in contact_gaps.items():
            for label, gap in family.items():
                time = self._time_to_zero(gap, second_rates[name][label])
                soonest = jnp.minimum(soonest, min_(time))
        return jax.lax.stop_gradient(soonest)

    def time_to_contact_end(self, contact_gaps: ContactGaps, second_rates: SecondRates) -> Scalar:
        """Time in s to the next end of a contact; infinite where none is in sight."""
        soonest: Scalar = jnp.inf
        for name, family in contact_gaps.items():
            for label, gap in family.items():
                time = self._time_to_zero(gap, second_rates[name][label])
                soonest = jnp.minimum(soonest, min_(jnp.where(gap.depth > 0.0, time, jnp.inf)))
        return jax.lax.stop_gradient(soonest)

    def _time_to_zero(self, gap: ContactGap, second_rate: Scalar) -> Scalar:
        """First positive root of the parabola, half the tolerance past its change of sign."""
        inwards = _inwards(gap)
        away = 0.5 * self._depth(gap.rate) + jnp.abs(gap.depth)
        rate, bend = inwards * gap.rate, inwards * second_rate
        square = rate * rate + 2.0 * bend * away
        slope = rate + jnp.sqrt(jnp.where(square > 0.0, square, 1.0))
        meets = (square > 0.0) & (slope > 0.0)
        return jnp.where(meets, 2.0 * away / jnp.where(meets, slope, 1.0), jnp.inf)

    def retry(
        self, before: ContactGaps, after: ContactGaps, t0: Scalar, t1: Scalar
    ) -> tuple[Condition, Scalar]:
        """Whether the step passes an event beyond the tolerance, and the time to end at instead."""
        h = t1 - t0
        resolution = 4.0 * jnp.finfo(jnp.result_type(t1)).eps * jnp.maximum(jnp.abs(t1), h)
        fraction = jax.lax.cond(
            _may_pass(before, after),
            lambda: self._first_crossing(before, after, h),
            lambda: jnp.ones_like(h),
        )
        # As diffrax's controllers do: where steps end is no function of the parameters.
        landing = jax.lax.stop_gradient(t0 + jnp.maximum(fraction * h, resolution))
        return (fraction < 1.0) & (landing < t1 - resolution), landing

    def _first_crossing(self, before: ContactGaps, after: ContactGaps, h: Scalar) -> Scalar:
        """The smallest `_crossing` of all contacts."""
        fraction = jnp.ones_like(h)
        for name, family in before.items():
            for label, start in family.items():
                crossing = self._crossing(start, after[name][label], h)
                fraction = jnp.minimum(fraction, min_(crossing))
        return fraction

    def _crossing(self, start: ContactGap, end: ContactGap, h: Scalar) -> Scalar:
        """Fraction of the step at which the gap is half the tolerance past its change of sign; 1
        where the step need not land."""
        inwards = _inwards(start)
        grazes, x, inner = self._turning(start, end, h, inwards)
        end = ContactGap(
            jnp.where(grazes, inner.depth, end.depth), jnp.where(grazes, inner.rate, end.rate)
        )
        depth = self._depth(jnp.maximum(jnp.abs(start.rate), jnp.abs(end.rate)))
        aim = 0.5 * inwards * depth
        shifted = (Slope(start.depth - aim, start.rate), Slope(end.depth - aim, end.rate))
        passes = inwards * end.depth > depth
        length = jnp.where(grazes, x, 1.0)
        return jnp.where(passes, length * hermite_root(*shifted, length * h), 1.0)

    def _turning(
        self, start: ContactGap, end: ContactGap, h: Scalar, inwards: Scalar
    ) -> tuple[Scalar, Scalar, ContactGap]:
        """Whether the step passes an event and comes back; and where about it turns, a fraction of
        the step."""
        turns = _turns(start, end)
        x = start.rate / jnp.where(turns, start.rate - end.rate, 1.0)
        ends = Slope(start.depth, start.rate), Slope(end.depth, end.rate)
        inner = ContactGap(hermite_value(x, *ends, h), hermite_rate(x, *ends, h))
        beyond = inwards * inner.depth > self.tolerance
        return turns & beyond & (inwards * end.depth <= self.tolerance), x, inner


def _inwards(gap: ContactGap) -> Scalar:
    """The sign of a depth that has changed since."""
    return jnp.where(gap.depth > 0.0, -1.0, 1.0)


def _turns(start: ContactGap, end: ContactGap) -> Condition:
    """Whether a gap goes towards zero at the start of a step, and away from it at the end."""
    inwards = _inwards(start)
    return (inwards * start.rate > 0.0) & (inwards * end.rate < 0.0)


def _may_pass(before: ContactGaps, after: ContactGaps) -> Condition:
    """Whether any contact's depth may change sign within a step, which few do: a single run then
    looks for the place, and else computes nothing of it."""
    may_pass: Condition = jnp.asarray(False)
    for name, family in before.items():
        for label, start in family.items():
            end = after[name][label]
            changes = (start.depth > 0.0) != (end.depth > 0.0)
            may_pass = may_pass | any_(changes | _turns(start, end))
    return may_pass
