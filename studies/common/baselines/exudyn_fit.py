"""Parameters of the double pendulum by Exudyn's optimisers on Exudyn's model.

`exudyn.processing.Minimize` is SciPy's `minimize`, by default Nelder and Mead's simplex;
`GeneticOptimization` draws from ranges. Both take one number, here chi squared, and search the
coordinates of the scales within ranges.
"""

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import clearjoint as cj
from studies.common.baselines.exudyn_pendulum import probes
from studies.common.baselines.scipy_fit import UNREACHED, Found

try:
    import exudyn
    from exudyn import processing
except ImportError as error:
    raise ImportError("this baseline needs Exudyn: pip install exudyn") from error

STEP = 1e-4
"""s, the largest; contacts recommend shorter ones."""
EVALUATIONS = 400
"""Allowed in one search of the simplex."""
POPULATION, GENERATIONS = 40, 10


class Misfit:
    """Chi squared over coordinates by name; counts its runs."""

    def __init__(
        self,
        times: np.ndarray,
        measured: np.ndarray,
        noise: float,
        scales: dict[str, cj.extend.AbstractScale],
    ):
        self.times, self.measured, self.noise, self.scales = times, measured, noise, scales
        self.runs = 0

    def __call__(self, coordinates: dict[str, float]) -> float:
        """Chi squared; of a run that failed as if all samples were far off."""
        self.runs += 1
        values = {name: float(s.value(coordinates[name])) for name, s in self.scales.items()}
        try:
            predicted = probes(**values, times=self.times, step=STEP)
        except (ValueError, exudyn.SolverError):
            return self.measured.size * UNREACHED
        return float(np.sum(((predicted - self.measured) / self.noise) ** 2))


def simplex(misfit: Misfit, start: np.ndarray, ranges: dict[str, tuple[float, float]]) -> Found:
    """`Minimize` with its defaults from coordinates (p,)."""
    return _timed(
        misfit,
        lambda: processing.Minimize(
            misfit,
            ranges,
            initialGuess=list(start),
            options={"maxfev": EVALUATIONS},
            storeFunctionValues=False,
            showProgress=False,
        ),
    )


def genetic(misfit: Misfit, ranges: dict[str, tuple[float, float]], seed: int) -> Found:
    """`GeneticOptimization` with fewer individuals than its 100, and the simplex from its best."""

    def both() -> Any:
        best, *_ = processing.GeneticOptimization(
            misfit,
            ranges,
            populationSize=POPULATION,
            numberOfGenerations=GENERATIONS,
            randomizerInitialization=seed,
            showProgress=False,
        )
        return processing.Minimize(
            misfit,
            ranges,
            initialGuess=[best[name] for name in ranges],
            options={"maxfev": EVALUATIONS},
            storeFunctionValues=False,
            showProgress=False,
        )

    return _timed(misfit, both)


def _timed(misfit: Misfit, optimise: Callable[[], Sequence[Any]]) -> Found:
    exudyn.config.printToConsole = False  # it prints a page on each run that fails
    misfit.runs, begun = 0, time.perf_counter()
    best = optimise()[0]
    at = np.array([best[name] for name in misfit.scales])
    return Found(at, misfit.runs, time.perf_counter() - begun)
