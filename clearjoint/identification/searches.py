"""Results of searches for the best fit: one from each start, over growing windows."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .levenberg_marquardt import Ending, Iteration
from .residuals import RunMisfit


@dataclass(frozen=True)
class WindowSearch:
    """Search that uses only the samples up to a time.

    - `end_time`: s, end of the window.
    - `iterations`: all runs of the search.
    - `ending`: reason why the search ended.
    """

    end_time: float
    iterations: tuple[Iteration, ...]
    ending: Ending


@dataclass(frozen=True)
class Search:
    """Search from one start.

    - `start`: (p,) coordinates of the start.
    - `windows`: the successive searches over growing windows of the record.
    - `best`: the run with the smallest misfit in the last window.
    """

    start: Float[np.ndarray, " p"]
    windows: tuple[WindowSearch, ...]
    best: RunMisfit

    @property
    def ending(self) -> Ending:
        """Reason why the search in the last window ended."""
        return self.windows[-1].ending

    @property
    def evaluations(self) -> int:
        """Number of runs in all windows."""
        return sum(len(window.iterations) for window in self.windows)


def best_search(searches: Iterable[Search]) -> Search:
    """Return the search with the smallest chi squared; of equal ones, the first."""
    return min(searches, key=lambda search: search.best.chi_squared)
