"""Windows in time of reductions. Without one, nothing of it is in the program."""

import math
from typing import Annotated, TypeAlias

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ...fields.checks import as_number, require
from ...math.vectors import Condition, Scalar

Instants: TypeAlias = Annotated[float | None, "s"]
"""A time in s, or ``None`` where the run's own begin or end is meant."""


def optional_time(value: Instants) -> Instants:
    """A time as a window stores it."""
    if value is None:
        return None
    time = np.asarray(as_number(value))
    known = time.shape == () and not bool(np.isnan(time))
    require(known, "after or until", value, "a time in s", "give one number, or leave it out")
    return float(time)


class Window(eqx.Module):
    """The part of a run between two times, s: from the first on, and before the second."""

    after: Instants = eqx.field(static=True, converter=optional_time)
    until: Instants = eqx.field(static=True, converter=optional_time)

    def __check_init__(self):
        require(
            self.end > self.start,
            "until",
            self.until,
            f"later than after = {self.after}",
            "give the window in s, of the run's clock",
        )

    @property
    def is_whole(self) -> bool:
        """Whether it is the whole run."""
        return self.after is None and self.until is None

    @property
    def start(self) -> float:
        """Its begin, s."""
        return -math.inf if self.after is None else self.after

    @property
    def end(self) -> float:
        """Its end, s."""
        return math.inf if self.until is None else self.until

    def holds(self, time: Scalar) -> Condition:
        """Whether a time, s, is in it."""
        return (time >= self.start) & (time < self.end)

    def places(self, begin: Scalar, end: Scalar) -> tuple[Scalar, Scalar]:
        """Where in a step from `begin` to `end`, s, it begins and ends: between 0 and 1, and alike
        outside of it."""
        length = jnp.where(end > begin, end - begin, 1.0)
        first, last = (self.start - begin) / length, (self.end - begin) / length
        return jnp.clip(first, 0.0, 1.0), jnp.clip(last, 0.0, 1.0)

    def if_reached(self, value: Scalar, time: Scalar) -> Scalar:
        """The value, or NaN for a run that ended, at a time in s, before the window."""
        return value if self.after is None else jnp.where(time >= self.after, value, jnp.nan)
