"""Time maps of steps: time passes slowly where a contact begins or ends.

Contact forces begin as (t - t_on)^1.5, and end so; their derivatives along a parameter go as the
square root. Neither is smooth in t, but both are in the square root of the time since the onset or
until the end. With uniform time, error estimates miss nearly all of the error of the first step
after an onset: 1e-6 of an impact's energy at rtol 1e-8. Steps with derivatives can change by at
most a seventh each after an onset and before an end.

A time map is a polynomial from the fraction x of a step, 0 to 1, in which the solver's stages are
spaced, to the elapsed part of the step's time.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp

from ...math.vectors import Condition, Scalar

TINY = 1e-300
"""Floor for sqrt arguments; keeps the derivative finite."""


class AbstractTimeMap(eqx.Module):
    """Relation between the fraction x of a step and the elapsed part of its time."""

    @abc.abstractmethod
    def elapsed(self, x: float) -> Scalar:
        """Return the elapsed part of the step's time at a fraction x."""

    @abc.abstractmethod
    def slope(self, x: float) -> Scalar:
        """Return the derivative of `elapsed`."""

    @abc.abstractmethod
    def fraction(self, elapsed: Scalar) -> Scalar:
        """Return the fraction x at an elapsed part of the time, the inverse of `elapsed`."""

    def next_length(self, proposed: Scalar, keep: Condition) -> Scalar:
        """Convert the controller's proposal into the length of the step to try next, s.

        **Arguments:** `proposed`: s, as if the next step had the time map of this one; `keep`:
        whether this step is accepted; otherwise it is repeated.
        """
        del keep
        return proposed


class FromOnset(AbstractTimeMap):
    """Time as the square of x if a contact `begins` at the start of the step; uniform otherwise."""

    begins: Condition

    def elapsed(self, x: float) -> Scalar:
        """Return x^2 after an onset, otherwise x."""
        return jnp.where(self.begins, x * x, x)

    def slope(self, x: float) -> Scalar:
        """Return 2 x after an onset, otherwise 1."""
        return jnp.where(self.begins, 2.0 * x, 1.0)

    def fraction(self, elapsed: Scalar) -> Scalar:
        """Return the square root after an onset, otherwise the elapsed part."""
        return jnp.where(self.begins, jnp.sqrt(jnp.maximum(elapsed, 0.0)), elapsed)


class WithinContact(AbstractTimeMap):
    """x uniform in the square root of the time since the onset of a contact, or until its end.

    - `length`: s, of the step.
    - `start`, `end`: the square roots at its start and end, s^0.5; both 1 without a contact, which
      makes time uniform.
    """

    length: Scalar
    start: Scalar
    end: Scalar

    @staticmethod
    def of(
        length: Scalar, touches: Condition, begins: Condition, since: Scalar, until_end: Scalar
    ) -> "WithinContact":
        """Return the time map of a step of a given length, s.

        **Arguments:** `touches`: whether any contact is closed; `begins`: whether one begins at the
        start of the step; `since`: s, time since the last onset; `until_end`: s, time until the
        first contact ends.
        """
        # The nearer singularity decides. At an onset `since` may still be that of an earlier
        # contact, so `begins` overrides it.
        nears_end = ~begins & (until_end < since)
        known = touches & jnp.isfinite(jnp.minimum(since, until_end))
        start = jnp.where(nears_end, until_end, jnp.where(begins, 0.0, since))
        end = jnp.where(nears_end, jnp.maximum(until_end - length, 0.0), since + length)
        roots = (jnp.sqrt(jnp.where(known, time, 1.0)) for time in (start, end))
        # The solution does not depend on step sizes and time maps, so they are not differentiated.
        return jax.lax.stop_gradient(WithinContact(length, *roots))

    def elapsed(self, x: float) -> Scalar:
        """Return x (p + (1 - p) x) with the slope p at the start."""
        pace = self._initial_slope()
        return x * (pace + (1.0 - pace) * x)

    def slope(self, x: float) -> Scalar:
        """Return the derivative of `elapsed`."""
        pace = self._initial_slope()
        return pace + 2.0 * x * (1.0 - pace)

    def fraction(self, elapsed: Scalar) -> Scalar:
        """Return the root of the quadratic `elapsed`, in the form without cancellation."""
        pace = self._initial_slope()
        square = pace * pace + 4.0 * (1.0 - pace) * elapsed
        return 2.0 * elapsed / (pace + jnp.sqrt(jnp.maximum(square, TINY)))

    def next_length(self, proposed: Scalar, keep: Condition) -> Scalar:
        """Return the length of a step whose square roots differ by this step's difference times
        the ratio that the controller proposes for lengths.

        The controller's ratio applies to the variable in which the error is smooth, that is to the
        square root. If the next step would go past the end of the contact, the proposal is used.
        """
        change = proposed / self.length * (self.end - self.start)
        root = jnp.where(keep, self.end, self.start)
        # (root + change)^2 - root^2, in which end^2 - start^2 is the length up to its sign.
        alike = proposed * (2.0 * root + change) / (self.start + self.end)
        return jnp.where(root + change >= 0.0, alike, proposed)

    def _initial_slope(self) -> Scalar:
        """Return the slope of `elapsed` at the start of the step."""
        return 2.0 * self.start / (self.start + self.end)
