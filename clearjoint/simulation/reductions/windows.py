"""Time windows of reductions. Without a window, the program contains nothing of it."""

import math
from typing import Annotated, TypeAlias

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ...fields.checks import as_number, require
from ...math.vectors import Condition, Scalar

Instants: TypeAlias = Annotated[float | None, "s"]
"""A time in s, or ``None`` for the start or end of the run."""


def optional_time(value: Instants) -> Instants:
    """Convert a time to a Python float; ``None`` stays."""
    if value is None:
        return None
    time = np.asarray(as_number(value))
    known = time.shape == () and not bool(np.isnan(time))
    require(known, "after or until", value, "a time in s", "give one number, or leave it out")
    return float(time)


class Window(eqx.Module):
    """The part of a run from `after` on and before `until`, s."""

    after: Instants = eqx.field(static=True, converter=optional_time)
    until: Instants = eqx.field(static=True, converter=optional_time)

    def __check_init__(self):
        require(
            self.end > self.start,
            "until",
            self.until,
            f"later than after = {self.after}",
            "give both times in s",
        )

    @property
    def is_whole(self) -> bool:
        """Whether it is the whole run."""
        return self.after is None and self.until is None

    @property
    def start(self) -> float:
        """Start of the window, s."""
        return -math.inf if self.after is None else self.after

    @property
    def end(self) -> float:
        """End of the window, s."""
        return math.inf if self.until is None else self.until

    def holds(self, time: Scalar) -> Condition:
        """Whether a time, s, is in the window."""
        return (time >= self.start) & (time < self.end)

    def fractions(self, begin: Scalar, end: Scalar) -> tuple[Scalar, Scalar]:
        """Return the fractions, 0 to 1, of a step from `begin` to `end`, s, between which it is in
        the window; equal fractions if it is not."""
        length = jnp.where(end > begin, end - begin, 1.0)
        first, last = (self.start - begin) / length, (self.end - begin) / length
        return jnp.clip(first, 0.0, 1.0), jnp.clip(last, 0.0, 1.0)

    def if_reached(self, value: Scalar, time: Scalar) -> Scalar:
        """Return the value, or NaN if the run ended, at a time in s, before the window."""
        return value if self.after is None else jnp.where(time >= self.after, value, jnp.nan)
