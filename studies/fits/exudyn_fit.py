"""Parameters of the double pendulum by Exudyn's optimiser on Exudyn's model.

`exudyn.processing.Minimize` is SciPy's `minimize`, by default Nelder and Mead's simplex. It
minimises chi squared over the coordinates within ranges.
"""

import time

import numpy as np

import clearjoint as cj
from studies.common.baselines.exudyn_pendulum import probes
from studies.fits.scipy_fit import UNREACHED, Found

try:
    import exudyn
    from exudyn import processing
except ImportError as error:
    raise ImportError("this baseline needs Exudyn: pip install exudyn") from error

STEP = 1e-4
"""Largest step, s; contacts recommend shorter ones."""
EVALUATIONS = 400
"""Limit of one search."""


class Misfit:
    """Chi squared as a function of coordinates by name, with a count of its runs."""

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
        """Return chi squared; a failed run counts as if all samples were far off."""
        self.runs += 1
        values = {name: float(s.value(coordinates[name])) for name, s in self.scales.items()}
        try:
            predicted = probes(**values, times=self.times, step=STEP)
        except (ValueError, exudyn.SolverError):
            return self.measured.size * UNREACHED
        return float(np.sum(((predicted - self.measured) / self.noise) ** 2))


def minimise(misfit: Misfit, start: np.ndarray, ranges: dict[str, tuple[float, float]]) -> Found:
    """Run `Minimize` with its defaults from coordinates (p,)."""
    exudyn.config.printToConsole = False  # it prints a page on each run that fails
    misfit.runs, begun = 0, time.perf_counter()
    best, *_ = processing.Minimize(
        misfit,
        ranges,
        initialGuess=list(start),
        options={"maxfev": EVALUATIONS},
        storeFunctionValues=False,
        showProgress=False,
    )
    end = np.array([best[name] for name in misfit.scales])
    return Found(end, misfit.runs, time.perf_counter() - begun)
