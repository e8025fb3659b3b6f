"""Landing of steps on contact events, the instants at which a contact begins or ends.

A step that passes such an event by more than the landing tolerance is rejected, and repeated up to
the event, which is the root of the cubic Hermite interpolant of the penetration. Penetrations are
measured from the onset of the force, and are positive where a contact has one.
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from ..._compilation.xla import shared_by_many
from ..._dynamics.contact_events import ContactGap, ContactGaps, any_of, gap_pairs
from ..._math.interpolation import Slope, hermite_rate, hermite_root, hermite_value
from ..._math.vectors import Condition, Scalar
from ..._model.joints.base import ByLabel

LATEST = 1e-11
"""Longest time past an event at which a step may end, s. The depth within which a step must land is
the landing tolerance or, if it is smaller, as in slow contacts, the depth that the surfaces cover
in this time. A contact in which a step lands past the onset has an elastic energy that no work has
supplied: a large error in an impact so slow that its penetration may not reach the tolerance."""
CLOSEST = 1e-4
"""Smallest depth within which a step must land, relative to the landing tolerance. Otherwise
rounding errors of the penetration could make it impossible to land in slow contacts."""


class Landing(eqx.Module):
    """Rule by which steps end where contacts begin and end. `tolerance`: m, largest depth past an
    event at which a step may end; smaller in slow contacts (see `LATEST`)."""

    tolerance: Scalar

    def _depth(self, rate: Scalar) -> Scalar:
        """Return the depth, m, within which a step must land at a penetration `rate`, m/s."""
        return self.tolerance * jnp.clip(jnp.abs(rate) * (LATEST / self.tolerance), CLOSEST, 1.0)

    def time_to_next_event(
        self, contact_gaps: ContactGaps, second_rates: ByLabel[Scalar], ends_only: bool = False
    ) -> Scalar:
        """Predict the time to the next onset or end of a contact, s; infinite if none is expected.

        A step that would pass the event is shortened in advance, which saves rejected trials: a
        trial far past a wall can have a very large error, and would be cut several times.

        **Arguments:** `second_rates`: second time derivatives of penetrations, m/s^2; `ends_only`:
        whether to consider only the ends of existing contacts.
        """
        soonest: Scalar = jnp.inf
        count = sum(map(len, contact_gaps.values()))
        for name, family in contact_gaps.items():
            for label, gap in family.items():
                second_rate = second_rates[name][label]
                time = shared_by_many(count, Landing._time_to_zero, self, gap, second_rate)
                if ends_only:
                    time = jnp.where(gap.depth > 0.0, time, jnp.inf)
                soonest = jnp.minimum(soonest, time)
        # Step sizes are not differentiated: the solution does not depend on them.
        return jax.lax.stop_gradient(soonest)

    def _time_to_zero(self, gap: ContactGap, second_rate: Scalar) -> Scalar:
        """Predict the time until the penetration of a contact changes its sign, s, by a parabola.
        The parabola is shifted so that its root is half of the allowed `_depth` past the event:
        otherwise rounding errors might leave the step on the wrong side of the event."""
        inwards = _inwards(gap)
        # In the direction towards the event, `away` is the distance from it. The event is at the
        # time t with away = speed t + acceleration t^2 / 2.
        away = 0.5 * self._depth(gap.rate) + jnp.abs(gap.depth)
        speed, acceleration = inwards * gap.rate, inwards * second_rate
        square = speed * speed + 2.0 * acceleration * away
        # t = 2 away / (speed + sqrt(square)) is the smaller root, without cancellation for small
        # accelerations. Without a root, the square root gets 1 so that derivatives stay finite.
        slope = speed + jnp.sqrt(jnp.where(square > 0.0, square, 1.0))
        meets = (square > 0.0) & (slope > 0.0)
        return jnp.where(meets, 2.0 * away / jnp.where(meets, slope, 1.0), jnp.inf)

    def retry(
        self, before: ContactGaps, after: ContactGaps, t0: Scalar, t1: Scalar
    ) -> tuple[Condition, Scalar]:
        """Return whether a step from `t0` to `t1`, s, passes an event by more than the tolerance,
        and when, s, its repetition must end. `before`, `after`: gaps at its start and end."""
        h = t1 - t0
        # Because of rounding errors, times that differ by less than this are not distinguished.
        resolution = 4.0 * jnp.finfo(jnp.result_type(t1)).eps * jnp.maximum(jnp.abs(t1), h)
        pairs = list(gap_pairs(before, after))
        # Here and below, `shared_by_many` traces the function once for all pairs, if they are many.
        may_pass = any_of(shared_by_many(len(pairs), _may_pass, *pair) for pair in pairs)

        def first_crossing() -> Scalar:
            fraction = jnp.ones_like(h)
            for pair in pairs:
                crossing = shared_by_many(len(pairs), Landing._crossing, self, *pair, h)
                fraction = jnp.minimum(fraction, crossing)
            return fraction

        # Few steps pass an event. A single run therefore computes the roots in a branch; lanes of a
        # batch compute them always.
        fraction = jax.lax.cond(may_pass, first_crossing, lambda: jnp.ones_like(h))
        # As in diffrax's controllers, step sizes are not differentiated.
        landing = jax.lax.stop_gradient(t0 + jnp.maximum(fraction * h, resolution))
        # An event within rounding of the end of the step counts as landed on; a retry would end at
        # the same time.
        return (fraction < 1.0) & (landing < t1 - resolution), landing

    def _crossing(self, start: ContactGap, end: ContactGap, h: Scalar) -> Scalar:
        """Return the fraction, 0 to 1, of a step of length `h`, s, at which the step must end to
        land half the allowed `_depth` past one contact's event; 1 if it need not be repeated."""
        # Past the event, `inwards` times the depth is positive.
        inwards, turns = _inwards(start), _turns(start, end)
        # Zero of the rate, interpolated linearly; its error matters little at an extremum.
        x = start.rate / jnp.where(turns, start.rate - end.rate, 1.0)
        ends = Slope(start.depth, start.rate), Slope(end.depth, end.rate)
        inner = ContactGap(hermite_value(x, *ends, h), hermite_rate(x, *ends, h))
        # A contact may begin and end within one step, or end and begin. The penetrations at both
        # ends of the step then have the same sign, or that at the end is within the tolerance. A
        # contact, or a flight, that remains within the tolerance is ignored.
        beyond = inwards * inner.depth > self.tolerance
        grazes = turns & beyond & (inwards * end.depth <= self.tolerance)
        # If so, the turning point replaces the end of the step: the event is between the start and
        # there.
        end = ContactGap(
            jnp.where(grazes, inner.depth, end.depth), jnp.where(grazes, inner.rate, end.rate)
        )
        depth = self._depth(jnp.maximum(jnp.abs(start.rate), jnp.abs(end.rate)))
        # The target is half the allowed depth, which leaves room for errors of the interpolant in
        # both directions.
        aim = 0.5 * inwards * depth
        shifted = (Slope(start.depth - aim, start.rate), Slope(end.depth - aim, end.rate))
        passes = inwards * end.depth > depth
        length = jnp.where(grazes, x, 1.0)
        return jnp.where(passes, length * hermite_root(*shifted, length * h), 1.0)


def _may_pass(start: ContactGap, end: ContactGap) -> Condition:
    return ((start.depth > 0.0) != (end.depth > 0.0)) | _turns(start, end)


def _inwards(gap: ContactGap) -> Scalar:
    """Return the sign of the penetration after the contact's next event: 1 in flight, else -1."""
    return jnp.where(gap.depth > 0.0, -1.0, 1.0)


def _turns(start: ContactGap, end: ContactGap) -> Condition:
    """Return whether a penetration moves towards the contact's next event at the start of a step (a
    depth of zero counts as flight), and away from it at the end."""
    inwards = _inwards(start)
    return (inwards * start.rate > 0.0) & (inwards * end.rate < 0.0)
