"""Time maps of steps, which place a solver's stages close together where a contact begins or ends.

After an onset at the time t_on, the force of a Hertz contact grows as (t - t_on)^1.5, and its
derivative with respect to a parameter as the square root of t - t_on; likewise before the end of
the contact. Neither is smooth in t, but both are smooth in that square root. Solvers assume smooth
rates. Without a time map, error estimates miss nearly all of the error of the first step after an
onset, which is 1e-6 of an impact's energy at an `rtol` of 1e-8. In runs with derivatives, the error
of the square root would force the length of each step after an onset, and before an end, to differ
from the length of the step before by at most a seventh: many short steps.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
from typing_extensions import override

from ..._math.vectors import Condition, Scalar

TINY = 1e-300
"""Lower bound of the argument of a square root; at zero, its derivative would be infinite."""


class AbstractTimeMap(eqx.Module):
    """Base class of time maps. A time map is a polynomial that gives, for the fraction x of a step
    at which the solver's tableau places a stage, the part of the step's time that has elapsed at
    this stage; both are 0 to 1. If the two are equal, time is called uniform in the step."""

    @abc.abstractmethod
    def elapsed(self, x: float) -> Scalar:
        """Return the elapsed part of the step's time at the fraction x."""

    @abc.abstractmethod
    def slope(self, x: float) -> Scalar:
        """Return the derivative of `elapsed` with respect to x."""

    @abc.abstractmethod
    def fraction(self, elapsed: Scalar) -> Scalar:
        """Return the fraction x at which a part `elapsed` of the step's time has passed."""

    def next_length(self, proposed: Scalar, keep: Condition) -> Scalar:
        """Return the length of the step to try after a step with this map, s; by default the length
        `proposed` by the controller, s, which assumes that the next step has the same time map.
        `keep`: whether this step is accepted; otherwise the next one begins where this one began.
        """
        del keep
        return proposed


class FromOnset(AbstractTimeMap):
    """Time map of runs without derivatives: quadratic in a step that begins with an onset, and
    uniform in all others."""

    begins: Condition

    @override
    def elapsed(self, x: float) -> Scalar:
        return jnp.where(self.begins, x * x, x)

    @override
    def slope(self, x: float) -> Scalar:
        return jnp.where(self.begins, 2.0 * x, 1.0)

    @override
    def fraction(self, elapsed: Scalar) -> Scalar:
        return jnp.where(self.begins, jnp.sqrt(jnp.maximum(elapsed, 0.0)), elapsed)


class WithinContact(AbstractTimeMap):
    """Time map of runs with derivatives: during a contact, the fraction x is linear in the square
    root of the time since the contact's onset, or of the time until its end.

    **Arguments:** `length`: of the step, s; `start`, `end`: the square root at the start and end of
    the step, s^0.5. In flight, or if onset and end are unknown, both are 1: time is uniform.
    """

    length: Scalar
    start: Scalar
    end: Scalar

    @staticmethod
    def of(
        length: Scalar, touches: Condition, begins: Condition, since: Scalar, until_end: Scalar
    ) -> "WithinContact":
        """Return the time map of a step of the given `length`, s.

        **Arguments:** `touches`, `begins`: whether any contact exists, and whether one begins, at
        the start of the step; `since`, `until_end`: s, time since the latest onset and predicted
        time until a contact ends, infinite if unknown.
        """
        # The map follows the onset or the end of a contact, whichever is nearer. If a contact
        # begins now, `since` is not exactly zero, because the step before ended slightly after the
        # onset. The map then starts from exactly zero, and does not follow a predicted end, however
        # near.
        nears_end = ~begins & (until_end < since)
        is_known = touches & jnp.isfinite(jnp.minimum(since, until_end))
        start = jnp.where(nears_end, until_end, jnp.where(begins, 0.0, since))
        end = jnp.where(nears_end, jnp.maximum(until_end - length, 0.0), since + length)
        start, end = (jnp.sqrt(jnp.where(is_known, time, 1.0)) for time in (start, end))
        # The solution does not depend on step sizes and time maps, so they are not differentiated.
        return jax.lax.stop_gradient(WithinContact(length, start, end))

    @override
    def elapsed(self, x: float) -> Scalar:
        # (root(x)^2 - root(0)^2)/(root(1)^2 - root(0)^2), with root(x) = start + (end - start) x.
        pace = self._initial_slope()
        return x * (pace + (1.0 - pace) * x)

    @override
    def slope(self, x: float) -> Scalar:
        pace = self._initial_slope()
        return pace + 2.0 * x * (1.0 - pace)

    @override
    def fraction(self, elapsed: Scalar) -> Scalar:
        pace = self._initial_slope()
        # A root of a quadratic equation, without the cancellation of nearly equal terms.
        square = pace * pace + 4.0 * (1.0 - pace) * elapsed
        return 2.0 * elapsed / (pace + jnp.sqrt(jnp.maximum(square, TINY)))

    @override
    def next_length(self, proposed: Scalar, keep: Condition) -> Scalar:
        """Return the length of a next step, s, in which the square root changes `proposed`/`length`
        times as much as in this step, because rates are smooth in this root. If such a step would
        pass the contact's end, return `proposed`. `keep`: whether this step is accepted."""
        change = proposed / self.length * (self.end - self.start)
        # The square root at the start of the next step.
        root = jnp.where(keep, self.end, self.start)
        # Length of a step with this difference of roots: (root + change)^2 - root^2, up to its
        # sign, where `length` is |end^2 - start^2|. Towards the end of a contact the roots
        # decrease; the root at the end of the next step must not become negative.
        alike = proposed * (2.0 * root + change) / (self.start + self.end)
        return jnp.where(root + change >= 0.0, alike, proposed)

    def _initial_slope(self) -> Scalar:
        """Return the derivative of `elapsed` by x at the start of the step: 0 at an onset, below 1
        after it, 1 if time is uniform, and up to 2 before the end of a contact."""
        return 2.0 * self.start / (self.start + self.end)
