"""Measurements cut into windows."""

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from ...fields.checks import require
from ...measurements.series import Measurements
from ...simulation.sensitivities import few
from ..residuals import Samples, check_start, samples


@dataclass(frozen=True)
class Piece:
    """A window: its span, s, the times that are looked at, (T,), padded, and their samples."""

    start: float
    end: float
    times: jax.Array
    data: Samples
    count: int


class Record:
    """The measurements, cut into windows on demand, with equally many padded times in each."""

    def __init__(self, measurements: Measurements, boundaries: Sequence[float], start_time: float):
        self._times = measurements.times()
        check_start(start_time, self._times)
        self.cuts = np.array([start_time, *boundaries, self._times[-1]], float)
        require(
            len(boundaries) > 0 and bool((np.diff(self.cuts) > 0.0).all()),
            "boundaries",
            np.asarray(boundaries),
            f"rising times between {start_time} and {float(self._times[-1])}",
            "take identify() for a single run, or cut the record inside",
        )
        self.data = samples(measurements, len(self._times))
        spans = zip(self.cuts[:-1], self.cuts[2:].tolist() + [self.cuts[-1]], strict=True)
        self._length = few(1 + max(int(self._inside(a, b).sum()) for a, b in spans))

    def _inside(self, start: float, end: float) -> np.ndarray:
        last = end == self._times[-1]
        return (self._times >= start) & ((self._times < end) | last)

    def piece(self, start: float, end: float) -> Piece:
        """The window from one time to another."""
        inside = self._inside(start, end)
        count, whole = int(inside.sum()), self.data
        padded = np.full(self._length, end)
        padded[:count] = self._times[inside]
        values, weights = (np.zeros((len(whole.periods), self._length)) for _ in range(2))
        values[:, :count], weights[:, :count] = whole.values[:, inside], whole.weights[:, inside]
        data = Samples(values, weights, whole.periods)
        return Piece(start, end, jnp.asarray(padded), data, count)
