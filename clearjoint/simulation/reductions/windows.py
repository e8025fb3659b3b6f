"""Time windows of reductions. For a whole run, the compiled program has no operations for them."""

import math
from typing import Annotated, TypeAlias

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ...fields.checks import as_number, require
from ...math.vectors import Condition, Scalar

Instants: TypeAlias = Annotated[float | None, "s"]
"""A time in s; ``None`` for the start or the end of the run."""


def optional_time(value: Instants) -> Instants:
    """Return a time, s, as a Python float; ``None`` stays.

    **Raises:** `ValueError` if `value` is not a single number, or NaN.
    """
    if value is None:
        return None
    time = np.asarray(as_number(value))
    known = time.shape == () and not bool(np.isnan(time))
    require(known, "after or until", value, "a time in s", "give one number, or leave it out")
    return float(time)


class Window(eqx.Module):
    """Window of time: the part of a run from `after`, inclusive, to `until`, exclusive, both s.

    **Raises:** `ValueError` for a window that does not end after its start.
    """

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
        """Whether the window is the whole run."""
        return self.after is None and self.until is None

    @property
    def start(self) -> float:
        """Start of the window, s; minus infinity if `after` is ``None``."""
        return -math.inf if self.after is None else self.after

    @property
    def end(self) -> float:
        """End of the window, s; infinity if `until` is ``None``."""
        return math.inf if self.until is None else self.until

    def holds(self, time: Scalar) -> Condition:
        """Whether a time, s, is in the window."""
        return (time >= self.start) & (time < self.end)

    def fractions(self, begin: Scalar, end: Scalar) -> tuple[Scalar, Scalar]:
        """Return the part of a step that is in the window, as two fractions of the step, 0 to 1.

        **Arguments:** `begin`, `end`: start and end of the step, s.

        **Returns:** the fractions where the part begins and ends, equal if no part is in the
        window.
        """
        length = jnp.where(end > begin, end - begin, 1.0)
        first, last = (self.start - begin) / length, (self.end - begin) / length
        return jnp.clip(first, 0.0, 1.0), jnp.clip(last, 0.0, 1.0)

    def if_reached(self, value: Scalar, time: Scalar) -> Scalar:
        """Return `value`; NaN if the run ended at a `time`, s, before the start of the window."""
        return value if self.after is None else jnp.where(time >= self.after, value, jnp.nan)
