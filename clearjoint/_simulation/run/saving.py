"""The argument `save` of runs: the states and impacts that a run keeps besides its outputs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..._fields.checks import as_number, concrete, require, require_type
from ..._fields.types import ArrayLike
from ..._math.vectors import Scalar
from ..._model.scene import Scene
from ..step.settings import checked_times, strictly_rising_times
from ..step.types import Numbers


@dataclass(frozen=True, eq=False)
class Saving:
    """What a run saves besides its outputs and its final state.

    **Arguments:**

    - `times`: (N,) s, strictly rising and within the run, the sample times, at which states are
      saved, in `solution.saved`, and quantities among the outputs are evaluated. The states are
      interpolated by the solver's dense output, so that saving does not change the steps. In a
      sweep, a function of the scene may give each run its own times, equally many, for example one
      in each revolution of a crank whose speed is swept.
    - `states`: whether the states of all bodies are saved at `times`; if false, only the quantities
      among the outputs are evaluated there, which saves memory in a sweep.
    - `steps`: save the states at the start and after every accepted step, in `solution.steps`.
    - `impacts`: save a table of impacts, with one row for each finished contact, in
      `solution.impacts`. A contact that exists at the start of the run has no row. If steps do not
      end at contact events, because the `landing_tolerance` of the `Settings` is ``None``, contacts
      that begin and end within one step have no row, and times and speeds are interpolated.

    **Raises:** `ValueError` for times that are not finite or do not rise strictly, for an array of
    times that is empty or not one-dimensional, and for fields of other types. Times that JAX traces
    are not checked.

    >>> cj.Saving(np.linspace(0.0, 1.0, 1001), impacts=True).impacts
    True
    """

    times: ArrayLike | Callable[[Scene], ArrayLike] | None = None
    states: bool = field(default=True, kw_only=True)
    steps: bool = field(default=False, kw_only=True)
    impacts: bool = field(default=False, kw_only=True)

    def __post_init__(self) -> None:
        for name in ("states", "steps", "impacts"):
            value = getattr(self, name)
            require(isinstance(value, bool), name, value, "True or False", "pass a bool")
        if self.times is not None and not callable(self.times):
            # The class is frozen, so its fields are set by `object`.
            object.__setattr__(self, "times", _checked(self.times))

    def at(self, scene: Scene) -> Numbers | None:
        return _checked(self.times(scene)) if callable(self.times) else self.times

    def times_between(self, scene: Scene, start_time: Scalar, end_time: Scalar) -> Numbers | None:
        times = self.at(scene)
        return None if times is None else checked_times(start_time, end_time, times)

    def require_none(self, names: Sequence[str], where: str, remedy: str) -> None:
        """Raise a `ValueError` with the `remedy` if one of the fields `names` is set. `where`: the
        words for what does not support these fields, such as "under a transformation of JAX"."""
        for name in names:
            value = getattr(self, name)
            require(not value, name, value, f"False {where}", remedy)


EXCEPT_TIMES = ("steps", "impacts")
"""Fields of `Saving` that request other results than states at given times."""


def saving_or_nothing(save: Saving | None) -> Saving:
    remedy = "pass cj.Saving(times), with times in s"
    require_type("save", save, Saving | None, "a Saving or None", remedy)
    return NOTHING if save is None else save


def _checked(times: ArrayLike) -> Numbers:
    row = as_number(times, "times", "s")
    if concrete(row) is not None:
        strictly_rising_times(row)
    # Single precision is kept, because later checks allow for its rounding errors.
    return times if isinstance(times, np.ndarray) and times.dtype.kind == "f" else row


NOTHING = Saving()
