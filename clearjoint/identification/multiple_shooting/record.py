"""Measurements cut into windows."""

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import numpy as np

from ...fields.checks import require
from ...fields.conversion import on_device
from ...measurements.series import Measurements
from ...simulation.sampling import few
from ..residuals import Samples, check_start, samples


@dataclass(frozen=True)
class Piece:
    """A window of the record.

    - `start`, `end`: s.
    - `times`: (T,) s, those of its samples, padded by `end`; `count` of them are samples' times.
    - `data`: the samples at these times.
    """

    start: float
    end: float
    times: jax.Array
    data: Samples
    count: int


class DividedRecord:
    """Measurements of which windows are cut on demand, all padded to the same number of times.

    `cuts`: (K + 2,) s, the start, the boundaries that the user chose, and the last sample.
    """

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
        """The window from `start` to `end`, s; the end is excluded, but for the last sample's."""
        inside = self._inside(start, end)
        count, whole = int(inside.sum()), self.data
        times = np.full(self._length, end)
        times[:count] = self._times[inside]
        values, weights = (np.zeros((len(whole.periods), self._length)) for _ in range(2))
        values[:, :count], weights[:, :count] = whole.values[:, inside], whole.weights[:, inside]
        data = Samples(values, weights, whole.periods)
        return Piece(start, end, on_device(times), data, count)
