"""Steps in which time passes unevenly: slowly where a contact begins or ends.

Forces begin as (t - t_on)^1.5, and end so; their derivatives along a parameter as the square root.
In t neither is smooth. Error estimates then miss nearly all of the error of a step from the begin,
which cost 1e-6 of an impact's energy at rtol 1e-8; and steps with derivatives could grow from
there, and had to shrink towards the end, by no more than a seventh each. In the root of the time
from the begin, or to the end, all of this is smooth.

A place in a step runs from 0 to 1, and the part of its time that has passed is a polynomial of it.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp

from ...math.vectors import Condition, Scalar

LEAST = 1e-300
"""What stands for zero under a root, which has a slope there."""


class AbstractTimeMap(eqx.Module):
    """How the time of a step passes with the place in it."""

    @abc.abstractmethod
    def elapsed(self, place: float) -> Scalar:
        """The part of the step's time that has passed at a place."""

    @abc.abstractmethod
    def slope(self, place: float) -> Scalar:
        """How fast that part grows with the place."""

    @abc.abstractmethod
    def place(self, part: Scalar) -> Scalar:
        """The place at which a part of the step's time has passed."""

    def next_length(self, proposed: Scalar, keep: Condition) -> Scalar:
        """Length in s of the next step, or of this one tried again unless it is to `keep`, where
        the controller proposes one as if all steps were graded alike."""
        del keep
        return proposed


class FromOnset(AbstractTimeMap):
    """Time as the square of the place where a contact `begins` at the start of the step; else it
    passes evenly."""

    begins: Condition

    def elapsed(self, place: float) -> Scalar:
        """The part of the step's time that has passed at a place."""
        return jnp.where(self.begins, place * place, place)

    def slope(self, place: float) -> Scalar:
        """How fast that part grows with the place."""
        return jnp.where(self.begins, 2.0 * place, 1.0)

    def place(self, part: Scalar) -> Scalar:
        """The place at which a part of the step's time has passed."""
        return jnp.where(self.begins, jnp.sqrt(jnp.maximum(part, 0.0)), part)


class WithinContact(AbstractTimeMap):
    """Steps even in the root of the time from the begin or to the end of a contact, whichever is
    nearer.

    - `length`: s, of the step.
    - `start`, `end`: the roots, s^0.5, where the step starts and ends; both 1 without a contact.
    """

    length: Scalar
    start: Scalar
    end: Scalar

    @staticmethod
    def of(
        length: Scalar, touches: Condition, begins: Condition, since: Scalar, due: Scalar
    ) -> "WithinContact":
        """The time map of a step.

        **Arguments:** `touches`: whether any contact is closed; `begins`: whether one begins at the
        start; `since`: s, time since one last began; `due`: s, time until the first one ends.
        """
        nears_end = ~begins & (due < since)
        known = touches & jnp.isfinite(jnp.minimum(since, due))
        start = jnp.where(nears_end, due, jnp.where(begins, 0.0, since))
        end = jnp.where(nears_end, jnp.maximum(due - length, 0.0), since + length)
        roots = (jnp.sqrt(jnp.where(known, time, 1.0)) for time in (start, end))
        # Where steps end, and how time passes in them, is no function of the parameters.
        return jax.lax.stop_gradient(WithinContact(length, *roots))

    def elapsed(self, place: float) -> Scalar:
        """The part of the step's time that has passed at a place."""
        pace = self._pace()
        return place * (pace + (1.0 - pace) * place)

    def slope(self, place: float) -> Scalar:
        """How fast that part grows with the place."""
        pace = self._pace()
        return pace + 2.0 * place * (1.0 - pace)

    def place(self, part: Scalar) -> Scalar:
        """The place at which a part of the step's time has passed."""
        pace = self._pace()
        square = pace * pace + 4.0 * (1.0 - pace) * part
        return 2.0 * part / (pace + jnp.sqrt(jnp.maximum(square, LEAST)))

    def next_length(self, proposed: Scalar, keep: Condition) -> Scalar:
        """Length in s of a step that differs from this one in the roots as the controller's
        proposal does in time; the proposal itself where that would go past the end."""
        change = proposed / self.length * (self.end - self.start)
        here = jnp.where(keep, self.end, self.start)
        alike = proposed * (2.0 * here + change) / (self.start + self.end)
        return jnp.where(here + change >= 0.0, alike, proposed)

    def _pace(self) -> Scalar:
        """How fast time passes at the start, on the whole step's average 1."""
        return 2.0 * self.start / (self.start + self.end)
