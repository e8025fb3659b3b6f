"""Test of a fit's covariance by runs around the estimates, and intervals from runs where it fails.

After many impacts chi squared may be rough on the scale of its own error bars: a search converges
in one of several minima close together, and the covariance there describes that minimum alone. So
some ten runs for each parameter compare chi squared with what the covariance predicts. Where they
differ, many runs without derivatives, side by side, and local searches from the lowest of them
explore the surroundings (`clearjoint.identification.likelihood`).
"""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ..parametrisation.parameter import Parameter
from . import goodness_of_fit as statistics
from . import likelihood
from .levenberg_marquardt import Ending, Iteration, search_with_damping
from .residuals import Experiment, RunMisfit, Samples, run_misfit
from .screening.misfit_curves import SideBySide
from .searches import Search, WindowSearch

ROUNDS = 6
"""Rounds of drawing points, at most."""
STEPS_DOWN = 15
"""Runs of a local search, at most."""
NEAR, NEAREST = 0.03, 1e-3
"""Gauss-Newton step, in standard errors, at which a local search ends, and at which the search ends
that the fit moves to."""
FARTHEST = 100.0
"""Distance, in standard errors, to which the surroundings are explored."""


@dataclass(frozen=True)
class LikelihoodCheck:
    """Runs around the estimates of a fit, which test whether chi squared rises as the covariance
    predicts, and explore it where it does not.

    - `test`: the rise of chi squared at points up to four standard errors away, predicted and
      found, and the time up to which they agree.
    - `exploration`: further points and minima with their chi squared, ``None`` where the test
      passed.
    - `searches`: the local searches that found the minima.
    - `runs`: number of runs, with and without derivatives; `seconds`: what all of it took.
    - `difference`: of chi squared at the estimates, between the two kinds of runs. More than about
      one means that errors of the integration exceed the noise.

    >>> data = cj.Series(x, times, 0.1 * np.cos(10.0 * times), noise=1e-4)
    >>> fit = cj.identify(
    ...     scene, state, cj.Measurements({"x": data}), {"stiffness": stiffness}, progress=False
    ... )
    >>> fit.check.passed, fit.check.runs
    (True, 14)
    """

    test: likelihood.QuadraticTest
    exploration: likelihood.Exploration | None
    searches: tuple[Search, ...]
    runs: int
    seconds: float
    difference: float

    @property
    def passed(self) -> bool:
        """Whether chi squared rises as the covariance predicts."""
        return self.test.passed

    @property
    def horizon(self) -> float:
        """Time, s, of the first sample from which on chi squared is not as the covariance predicts;
        infinite if it is to the end."""
        return self.test.horizon

    def widening(self, best: RunMisfit) -> float:
        """By what factor the intervals of the exploration differ from those by the covariance of a
        fit's best run: the largest of all parameters' lower and upper halves, and their inverses.
        """
        assert self.exploration is not None
        half = math.sqrt(likelihood.RISE) * np.sqrt(
            np.diag(statistics.parameter_covariance(best.jacobian))
        )
        low, high = self.exploration.intervals()
        ratios = np.abs(np.concatenate([best.coordinates - low, high - best.coordinates]))
        ratios = ratios / np.tile(half, 2)
        return float(np.maximum(ratios, 1.0 / np.maximum(ratios, 1e-12)).max())

    @cached_property
    def minima(self) -> int:
        """Number of minima whose chi squared is at most 3.84 above the lowest."""
        if self.exploration is None:
            return 1
        limit = self.exploration.lowest + likelihood.RISE
        found: list[likelihood.LocalMinimum] = []
        for one in sorted(self.exploration.minima, key=lambda minimum: minimum.chi_squared):
            apart = not any(likelihood.inside(other, one.coordinates) for other in found)
            if one.chi_squared <= limit and apart:
                found.append(one)
        return len(found)


def check(
    best: RunMisfit,
    runs: Experiment,
    data: Samples,
    parameters: Mapping[str, Parameter],
    number: int,
    on_iteration: Callable[[Iteration], None],
) -> LikelihoodCheck:
    """Test the covariance at the best run of a fit.

    **Arguments:** `number`: of points that the first round of an exploration draws;
    `on_iteration`: called with the runs of local searches.
    """
    begun = time.perf_counter()
    generator = np.random.default_rng(0)
    end = float(np.asarray(runs.times)[-1])
    limits = longest(best, parameters)
    covariance = statistics.parameter_covariance(best.jacobian)
    offsets = likelihood.displacements(covariance, limits, generator)
    shape = data.weights.shape
    residuals, jacobian = best.residuals.reshape(shape), best.jacobian.reshape(*shape, -1)
    tried = [run_misfit(runs, data, end, best.coordinates + offset) for offset in offsets]
    moved = np.array([one.residuals.reshape(shape) for one in tried])
    near = (np.abs(offsets) < 0.5 * limits).all(axis=1)
    test = likelihood.tested(residuals, jacobian, offsets, moved, np.asarray(runs.times), near)
    count = len(offsets)
    if test.passed:
        seconds = time.perf_counter() - begun
        return LikelihoodCheck(test, None, (), count, seconds, 0.0)

    lanes = SideBySide(runs, data)
    searches: list[Search] = []
    strides = np.array([parameter.scale.max_step for parameter in parameters.values()])

    def chi_squared(points: np.ndarray) -> np.ndarray:
        return lanes.chi_squared(points, lanes.count)[:, -1]

    def descend(
        start: np.ndarray, near: float = NEAR, steps: int = STEPS_DOWN
    ) -> likelihood.LocalMinimum:
        found, iterations, ending = search_with_damping(
            lambda at: run_misfit(runs, data, end, at), start, strides, near, steps, on_iteration
        )
        if ending is Ending.INTERRUPTED:
            raise KeyboardInterrupt
        searches.append(Search(start, (WindowSearch(end, iterations, ending),), found))
        return _minimum(found)

    difference = float(chi_squared(best.coordinates[None])[0]) - best.chi_squared
    covariances = [covariance, *_early_covariances(runs, jacobian, test.horizon)]
    explored = likelihood.explore(
        chi_squared,
        descend,
        _minimum(best),
        covariances,
        np.minimum(limits, FARTHEST * np.sqrt(np.diag(covariance))),
        number,
        ROUNDS,
        statistics.likely_chi_squared(data.count - len(best.coordinates)),
        generator,
    )
    low = min(explored.minima, key=lambda minimum: minimum.chi_squared)
    if best.chi_squared - low.chi_squared > likelihood.FLOOR:
        descend(low.coordinates, NEAREST, 4 * STEPS_DOWN)
    count += len(explored.points) + sum(search.evaluations for search in searches)
    seconds = time.perf_counter() - begun
    return LikelihoodCheck(test, explored, tuple(searches), count, seconds, difference)


def longest(best: RunMisfit, parameters: Mapping[str, Parameter]) -> Float[np.ndarray, " p"]:
    """How far points may lie from the estimates, (p,): two strides of the scale; where these are
    infinite, as far as the estimate is from zero, or `FARTHEST` standard deviations that it has if
    all others are known, whichever is more."""
    strides = np.array([parameter.scale.max_step for parameter in parameters.values()])
    lengths = np.linalg.norm(best.jacobian, axis=0)
    alone = np.where(lengths > 0.0, FARTHEST / np.where(lengths > 0.0, lengths, 1.0), 0.0)
    far = np.maximum(np.abs(best.coordinates), alone)
    return np.where(np.isfinite(strides), 2.0 * strides, far)


def lowest(check: LikelihoodCheck, best: Search) -> Search:
    """The search with the smallest chi squared, of a fit's best and those of its check; of equal
    ones the fit's own, then the last, which went on from the lowest."""
    return min((best, *check.searches[::-1]), key=lambda search: search.best.chi_squared)


def _minimum(found: RunMisfit) -> likelihood.LocalMinimum:
    covariance = statistics.parameter_covariance(found.jacobian)
    return likelihood.LocalMinimum(found.coordinates, found.chi_squared, covariance)


def _early_covariances(
    runs: Experiment, jacobian: Float[np.ndarray, "S T p"], horizon: float
) -> list[Float[np.ndarray, "p p"]]:
    """Covariances by the data up to the horizon, s, and up to half of it, for which chi squared is
    smoother and wider; none if the horizon is infinite."""
    start, times = float(runs.start_time), np.asarray(runs.times)[: jacobian.shape[1]]
    found = []
    for share in (1.0, 0.5) if math.isfinite(horizon) else ():
        early = times < start + share * (horizon - start)
        rows = (jacobian * early[:, None]).reshape(-1, jacobian.shape[-1])
        found.append(statistics.parameter_covariance(rows))
    return found
