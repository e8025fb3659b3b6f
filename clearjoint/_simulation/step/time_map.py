"""Time maps of steps, which place the stages of a solver close together where a contact begins or
ends.

A stage is a time inside a step at which a Runge-Kutta solver evaluates the rates, the time
derivatives of the variables. After an onset at the time t_on, the force of a Hertz contact grows as
(t - t_on)^1.5, and before the end of the contact it falls likewise. Its derivative with respect to
a parameter is proportional to the square root of t - t_on. Neither is smooth in t, but both are
smooth in that square root. Solvers assume smooth rates. Without a time map, error estimates miss
nearly all of the error of the first step after an onset, which is 1e-6 of an impact's energy at an
`rtol` of 1e-8. In runs with derivatives, moreover, the error of the square root would force each
step after an onset, and before an end, to differ from the one before it by at most a seventh: many
short steps.

A time map is a polynomial. Its argument is the fraction x of a step, 0 to 1, at which the solver's
tableau places a stage. Its value is the part of the step's time, 0 to 1, that has elapsed at this
stage. If the two are equal, time is called uniform in the step.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp

from ..._math.vectors import Condition, Scalar

TINY = 1e-300
"""Lower bound of the argument of a square root; at zero, its derivative would be infinite."""


class AbstractTimeMap(eqx.Module):
    """Base class of time maps, functions from the fraction x of a step to the elapsed part of its
    time, both 0 to 1."""

    @abc.abstractmethod
    def elapsed(self, x: float) -> Scalar:
        """Return the elapsed part of the step's time, 0 to 1, at the fraction x."""

    @abc.abstractmethod
    def slope(self, x: float) -> Scalar:
        """Return the derivative of the method `elapsed` with respect to x, at x."""

    @abc.abstractmethod
    def fraction(self, elapsed: Scalar) -> Scalar:
        """Return the fraction x at which a part `elapsed` of the step's time has passed: the
        inverse of the method `elapsed`."""

    def next_length(self, proposed: Scalar, keep: Condition) -> Scalar:
        """Return the length of the step to try after a step with this map, s; by default the
        length that the step-size controller proposes.

        **Arguments:** `proposed`: s, the controller's proposal, which assumes that the next step
        has the same time map; `keep`: whether the step with this map is accepted. A rejected step
        is repeated from its start.
        """
        del keep
        return proposed


class FromOnset(AbstractTimeMap):
    """Time map of runs without derivatives: quadratic in a step that begins with an onset, and
    uniform in all others.

    **Arguments:** `begins`: whether a contact begins at the start of the step.
    """

    begins: Condition

    def elapsed(self, x: float) -> Scalar:
        """Return x^2 after an onset, otherwise x."""
        return jnp.where(self.begins, x * x, x)

    def slope(self, x: float) -> Scalar:
        """Return 2 x after an onset, otherwise 1."""
        return jnp.where(self.begins, 2.0 * x, 1.0)

    def fraction(self, elapsed: Scalar) -> Scalar:
        """Return the square root of `elapsed` after an onset, otherwise `elapsed`."""
        return jnp.where(self.begins, jnp.sqrt(jnp.maximum(elapsed, 0.0)), elapsed)


class WithinContact(AbstractTimeMap):
    """Time map of runs with derivatives: during a contact, x is linear in the square root of the
    time since the contact's onset, or of the time until its end.

    **Arguments:**

    - `length`: length of the step, s.
    - `start`, `end`: these square roots at the start and end of the step, s^0.5. Without a contact,
      or if neither time is known, both are 1, which makes time uniform.
    """

    length: Scalar
    start: Scalar
    end: Scalar

    @staticmethod
    def of(
        length: Scalar, touches: Condition, begins: Condition, since: Scalar, until_end: Scalar
    ) -> "WithinContact":
        """Return the time map of a step.

        **Arguments:**

        - `length`: length of the step, s.
        - `touches`: whether any contact exists at the start of the step; `begins`: whether a
          contact begins there.
        - `since`: time from the latest onset to the start of the step, s, infinite if there was
          none.
        - `until_end`: predicted time from the start of the step until the first contact ends, s,
          infinite if none is expected to end.
        """
        # The map follows the onset or the end of a contact, whichever is nearer. If a contact
        # begins now, `since` is not exactly zero, because the step before ended slightly after the
        # onset. The map then starts from exactly zero, and does not follow a predicted end, however
        # near.
        nears_end = ~begins & (until_end < since)
        known = touches & jnp.isfinite(jnp.minimum(since, until_end))
        start = jnp.where(nears_end, until_end, jnp.where(begins, 0.0, since))
        end = jnp.where(nears_end, jnp.maximum(until_end - length, 0.0), since + length)
        roots = (jnp.sqrt(jnp.where(known, time, 1.0)) for time in (start, end))
        # The solution does not depend on step sizes and time maps, so they are not differentiated.
        return jax.lax.stop_gradient(WithinContact(length, *roots))

    def elapsed(self, x: float) -> Scalar:
        """Return the elapsed part of the step's time, x (p + (1 - p) x), where p is the slope of
        the map at the start of the step."""
        pace = self._initial_slope()
        return x * (pace + (1.0 - pace) * x)

    def slope(self, x: float) -> Scalar:
        """Return p + 2 (1 - p) x, the derivative of `elapsed`, where p is the slope of the map at
        the start of the step."""
        pace = self._initial_slope()
        return pace + 2.0 * x * (1.0 - pace)

    def fraction(self, elapsed: Scalar) -> Scalar:
        """Return the fraction x at which a part `elapsed` of the step's time has passed.

        It is a root of a quadratic equation, in a form that avoids the cancellation of nearly equal
        terms.
        """
        pace = self._initial_slope()
        square = pace * pace + 4.0 * (1.0 - pace) * elapsed
        return 2.0 * elapsed / (pace + jnp.sqrt(jnp.maximum(square, TINY)))

    def next_length(self, proposed: Scalar, keep: Condition) -> Scalar:
        """Return the length of the step to try next, s.

        The rates are smooth in the square root of time in which x is linear, not in time. Therefore
        the controller's ratio of lengths, `proposed / length`, is applied to the difference of the
        square roots over this step. The result is the length of a step with the new difference. If
        such a step would go past the end of the contact, `proposed` is returned.
        """
        change = proposed / self.length * (self.end - self.start)
        root = jnp.where(keep, self.end, self.start)
        # Length of a step with this difference of roots: (root + change)^2 - root^2, up to its
        # sign, since `length` is end^2 - start^2.
        alike = proposed * (2.0 * root + change) / (self.start + self.end)
        return jnp.where(root + change >= 0.0, alike, proposed)

    def _initial_slope(self) -> Scalar:
        """Return the slope of the map at the start of the step: 0 at an onset, below 1 after
        it, 1 if time is uniform, and up to 2 before the end of a contact."""
        return 2.0 * self.start / (self.start + self.end)
