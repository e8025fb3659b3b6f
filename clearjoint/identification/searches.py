"""Searches for the best fit: one from each start, over growing windows of the record."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .levenberg_marquardt import Ending, Iteration
from .residuals import RunMisfit


@dataclass(frozen=True)
class WindowSearch:
    """The search over the samples up to `end_time`, s: its iterations and how it ended."""

    end_time: float
    iterations: tuple[Iteration, ...]
    ending: Ending


@dataclass(frozen=True)
class Search:
    """The search from one start.

    - `start`: (p,) its coordinates.
    - `windows`: the searches over growing windows of the record, one after the other.
    - `best`: the run with the smallest misfit in the last window.
    """

    start: Float[np.ndarray, " p"]
    windows: tuple[WindowSearch, ...]
    best: RunMisfit

    @property
    def ending(self) -> Ending:
        """How the last window's search ended."""
        return self.windows[-1].ending

    @property
    def evaluations(self) -> int:
        """Number of runs in all windows."""
        return sum(len(window.iterations) for window in self.windows)
