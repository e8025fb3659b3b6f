"""What a run keeps beside the state that it ends in."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..fields.checks import concrete, require
from ..math.vectors import Scalar
from .spans import check_rising, checked_times


@dataclass(frozen=True, eq=False)
class Saving:
    """What a run keeps beside the state that it ends in.

        cj.Saving(np.linspace(0.0, 1.0, 1001), impacts=True)

    **Arguments:**

    - `times`: (N,) s, rising, at which to save the state. Dense output gives them; they do not
      change the steps.
    - `steps`: keep every accepted step.
    - `impacts`: table all finished contacts.

    **Raises:** `ValueError` for times that don't rise.
    """

    times: ArrayLike | None = None
    steps: bool = field(default=False, kw_only=True)
    impacts: bool = field(default=False, kw_only=True)

    def __post_init__(self) -> None:
        for name in ("steps", "impacts"):
            value = getattr(self, name)
            require(isinstance(value, bool), name, value, "True or False", "say whether")
        if self.times is not None and concrete(self.times) is not None:
            check_rising(self.times, "times")

    @property
    def records(self) -> bool:
        """Whether steps are recorded as they are made."""
        return self.steps or self.impacts

    def times_between(self, start_time: Scalar, end_time: Scalar) -> np.ndarray | None:
        """The times of a run between two others, s.

        **Raises:** `ValueError` for times outside.
        """
        if self.times is None:
            return None
        return checked_times(start_time, end_time, self.times, "times")

    def require_no_steps(self, where: str, remedy: str) -> None:
        """Check that steps are not to be kept, for runs that can't."""
        require(not self.steps, "steps", True, f"False {where}", remedy)

    def require_times_alone(self, where: str, remedy: str) -> None:
        """Check that nothing is recorded, for runs that keep states at times alone."""
        self.require_no_steps(where, remedy)
        require(not self.impacts, "impacts", True, f"False {where}", remedy)


def saving_or_nothing(save: Saving | None) -> Saving:
    """What to save; nothing if not told.

    **Raises:** `ValueError` for anything else.
    """
    kind = type(save).__name__
    remedy = "pass cj.Saving(times), with times in s"
    require(isinstance(save, Saving | None), "save", kind, "a Saving or None", remedy)
    return Saving() if save is None else save
