"""What a sweep keeps of each lane beside reductions: states at chosen times, and sections."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..fields import require
from ..records import Crossing
from ..reductions import Quantity
from ..scene import Scene

Channels = Mapping[str, tuple[Quantity, str]]
"""Quantities with their units, by name."""


@dataclass(frozen=True)
class Saved:
    """Quantities at chosen times, by the solver's dense output.

    **Arguments:**

    - `times`: (K,) s, rising; or a function of the lane's scene that returns as many for every
      lane, such as one instant in each turn of a crank whose speed is swept.
    - `channels`: quantity and unit by name.
    """

    times: Any
    channels: Channels

    def __post_init__(self) -> None:
        _check_channels(self.channels)

    def at(self, scene: Scene) -> np.ndarray:
        """The times of a lane."""
        times = self.times(scene) if isinstance(self.times, Callable) else self.times
        times = np.asarray(times, dtype=float)
        fine = times.ndim == 1 and times.size > 0 and bool(np.isfinite(times).all())
        require(
            fine and bool((np.diff(times) >= 0).all()),
            "times",
            times,
            "a rising row of finite times",
            "sort the times",
        )
        return times


@dataclass(frozen=True)
class Section:
    """A Poincaré section: quantities where another one passes zero, rising.

    **Arguments:**

    - `crossing`: the quantity that passes zero.
    - `channels`: quantity and unit by name, taken there.
    - `count`: how many crossings are kept, the first ones.
    - `after`: s; earlier crossings, of the transient, are left out.
    """

    crossing: Quantity
    channels: Channels
    count: int
    after: float = 0.0
    condition: Crossing = field(init=False)

    def __post_init__(self) -> None:
        _check_channels(self.channels)
        require(self.count > 0, "count", self.count, "positive", "pass a number of crossings")
        object.__setattr__(self, "condition", Crossing(self.crossing, self.after))


def _check_channels(channels: Channels) -> None:
    fine = bool(channels) and all(
        isinstance(pair, tuple)
        and len(pair) == 2
        and callable(pair[0])
        and isinstance(pair[1], str)
        for pair in channels.values()
    )
    require(
        fine,
        "channels",
        channels,
        "a (quantity, unit) pair by name",
        'pass for example {"x": (Position("slider", "x"), "m")}',
    )
    taken = sorted({"time", "count"} & set(channels))
    require(not taken, "channels", taken, "of names that the output does not use", "rename them")
