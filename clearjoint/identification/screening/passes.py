"""Screening and searches in turn, until noise explains what they leave."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .. import goodness_of_fit as statistics
from ..residuals import Experiment, Samples
from ..searches import Search
from .misfit_curves import SideBySide
from .screening import Screened, Screening, screen

LOOSER = 1000.0
"""Tolerance of the integration of runs that only screen, over that of the fit."""


@dataclass(frozen=True)
class Passes:
    """Passes of a screening round a guess `centre` (p,), by coarse runs of an experiment.

    `progress`: whether to show a line.
    """

    screening: Screening
    runs: Experiment
    centre: np.ndarray
    names: tuple[str, ...]
    progress: bool

    def searches(
        self, data: Samples, searched: Callable[[np.ndarray], Search]
    ) -> tuple[tuple[Search, ...], tuple[Screened, ...]]:
        """The searches from what each pass left, and the passes; the last is the first after which
        chi squared is not too large for the noise."""
        lanes, degrees_of_freedom = SideBySide(self.runs, data), data.count - len(self.names)
        searches: list[Search] = []
        screened: list[Screened] = []
        for number in range(self.screening.passes):
            screened.append(
                screen(self.screening, lanes, self.centre, self.names, number, self.progress)
            )
            searches += map(searched, screened[-1].starts)
            chi_squared = lowest(searches).best.chi_squared
            if not statistics.chi_squared_p(chi_squared, degrees_of_freedom) < statistics.UNLIKELY:
                break
        return tuple(searches), tuple(screened)


def lowest(searches: Sequence[Search]) -> Search:
    """The search that led to the smallest chi squared."""
    return min(searches, key=lambda search: search.best.chi_squared)
