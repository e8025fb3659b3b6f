"""Test of a fit's covariance by runs around the estimates, and intervals by runs if it fails.

After many impacts chi squared may be rough on the scale of the standard errors: the search
converges in one of several minima close together, and the covariance describes only that minimum.
Therefore about twenty runs for each parameter compare chi squared with the prediction of the
covariance. If they differ, many runs without derivatives, and local searches from the points with
the lowest chi squared, explore the neighbourhood (`clearjoint.identification.likelihood`). Then a
small posterior around the lowest minimum gives the intervals.
"""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from jaxtyping import Float

from ..parametrisation.parameter import Parameter, step_limits
from . import goodness_of_fit as statistics
from . import likelihood
from .levenberg_marquardt import Ending, Iteration, Search, WindowSearch, search_with_damping
from .posterior.posterior import ImpossiblePointsError, TooManyRunsError, drawn_posterior
from .posterior.result import Posterior
from .residuals import Experiment, RunMisfit, Samples, parameter_covariance, run_misfit
from .screening.misfit_curves import SideBySide

ROUNDS = 6
"""Maximum number of rounds in which an exploration draws points."""
STEPS_DOWN = 15
"""Maximum number of runs of a local search."""
NEAR, NEAREST = 0.03, 1e-3
"""Gauss-Newton step, in standard errors, at which a local search ends, and at which the final
search in the lowest minimum ends."""
FARTHEST = 100.0
"""Distance from the estimates, in standard errors, up to which an exploration may draw points."""
POINTS, MOST_RUNS = 1.25, 75
"""Number of points of the small posterior, and number of runs above which it is given up, relative
to `check_runs`, the number of points in the first round of the exploration."""
MARGIN = 4.0
"""Half the width of the posterior's box, relative to the largest distance of explored points with a
low chi squared from the lowest minimum. A wider box takes more runs, a narrower one may cut the
posterior off."""


@dataclass(frozen=True)
class LikelihoodCheck:
    """Result of runs around the estimates of a fit.

    The runs test whether chi squared rises as the covariance predicts. If not, more runs explore
    chi squared around the estimates.

    - `test`: the rise of chi squared at points up to four standard errors away, predicted and
      actual, and the time up to which they agree.
    - `exploration`: more points and minima with their chi squared; ``None`` if the test passed.
    - `searches`: the local searches that found the minima.
    - `posterior`: a small `Posterior`, of few points, around the lowest minimum, from which the
      fit's intervals come. ``None`` if the test passed, if noise doesn't explain chi squared, if
      more runs would be needed than 75 times the argument `check_runs` of `identify`, or if its
      points don't represent it: they miss the lowest minimum, or `Posterior.warnings` reports a
      problem.
    - `runs`: number of runs with and without derivatives, those of the posterior not included;
      `seconds`: s, computing time of all runs.
    - `difference`: chi squared at the estimates in a run without derivatives, less that in the run
      with derivatives; 0 if the test passed. An absolute value above 1 means that integration
      errors exceed the noise.

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
    posterior: Posterior | None = None

    @property
    def passed(self) -> bool:
        """Whether chi squared rises as the covariance predicts."""
        return self.test.passed

    @property
    def horizon(self) -> float:
        """First time, s, at which chi squared of the record so far disagrees with the covariance.

        That is the case at the first time at which a tenth of the points disagree, see
        `QuadraticTest.horizon`. It is infinite if there is no such time.
        """
        return self.test.horizon

    def widening(self, best: RunMisfit) -> float:
        """Return by which factor the intervals of the exploration differ from those of the
        covariance.

        The factor, 1 or more, is the largest ratio of their half widths, over both halves of the
        intervals of all parameters; ratios below 1 are inverted. The test must have failed, because
        there is no exploration otherwise.

        **Arguments:** `best`: the best run of the fit, with its covariance.
        """
        assert self.exploration is not None
        half = np.sqrt(likelihood.RISE * np.diag(best.covariance))
        low, high = self.exploration.intervals()
        ratios = np.abs(np.concatenate([best.coordinates - low, high - best.coordinates]))
        ratios = ratios / np.tile(half, 2)
        return float(np.maximum(ratios, 1.0 / np.maximum(ratios, 1e-12)).max())

    @cached_property
    def minima(self) -> int:
        """Number of separate minima whose chi squared is at most 3.84 above the lowest.

        A minimum is separate if it is more than one standard error away from all lower ones. The
        number is 1 if the test passed, because no other minima were searched for then.
        """
        if self.exploration is None:
            return 1
        limit = self.exploration.lowest + likelihood.RISE
        distinct: list[RunMisfit] = []
        for one in sorted(self.exploration.minima, key=lambda minimum: minimum.chi_squared):
            apart = not any(likelihood.inside(other, one.coordinates) for other in distinct)
            if one.chi_squared <= limit and apart:
                distinct.append(one)
        return len(distinct)


def check(
    best: RunMisfit,
    runs: Experiment,
    data: Samples,
    parameters: Mapping[str, Parameter],
    units: Mapping[str, str],
    number: int,
    on_iteration: Callable[[Iteration], None],
) -> LikelihoodCheck:
    """Test the covariance of a fit by runs around its best run.

    If the test fails, explore chi squared there and compute a small posterior. `identify` calls
    this after its searches.

    **Arguments:**

    - `best`: the best run of the fit.
    - `runs`: the scene to run; `data`: the samples with which to compare it.
    - `parameters`, `units`: the parameters and the units of their values, by name.
    - `number`: number of points in the first round of an exploration.
    - `on_iteration`: function that is called with every iteration of the local searches.

    **Raises:** `KeyboardInterrupt` if the user interrupts it.
    """
    started = time.perf_counter()
    # The seed is fixed: the check of the same fit always gives the same result.
    generator = np.random.default_rng(0)
    limits = _largest_offsets(best, parameters)
    test = _quadratic_test(best, runs, data, limits, generator)
    explored, posterior, searches, difference = None, None, [], 0.0
    count = len(test.actual)
    if not test.passed:
        lanes = SideBySide(runs, data)

        def chi_squared(points: np.ndarray) -> np.ndarray:
            return lanes.chi_squared(points, lanes.count)[:, -1]

        def descend(start: np.ndarray, near: float = NEAR, steps: int = STEPS_DOWN) -> RunMisfit:
            searches.append(_descent(runs, data, parameters, start, near, steps, on_iteration))
            return searches[-1].best

        difference = float(chi_squared(best.coordinates[None])[0]) - best.chi_squared
        farthest = np.minimum(limits, FARTHEST * np.sqrt(np.diag(best.covariance)))
        likely = statistics.likely_chi_squared(data.count - len(best.coordinates))
        # Chi squared of an early part of the record is smoother and wider: its covariance draws
        # points beyond the minimum that the whole record's covariance describes.
        covariances = [best.covariance, *_early_covariances(best, runs, data, test.horizon)]
        explored = likelihood.explore(
            chi_squared,
            descend,
            best,
            covariances,
            farthest,
            number,
            ROUNDS,
            likely,
            generator,
        )
        # The local searches of the exploration end early. If one of them has found a lower minimum,
        # the fit moves there, which takes an accurate search.
        lowest = min(explored.minima, key=lambda minimum: minimum.chi_squared)
        if best.chi_squared - lowest.chi_squared > likelihood.FLOOR:
            descend(lowest.coordinates, NEAREST, 4 * STEPS_DOWN)
        count += len(explored.points) + sum(search.evaluations for search in searches)
        # If noise doesn't explain chi squared, the model is wrong, and so would be its posterior.
        if explored.lowest <= likely:
            half = np.minimum(farthest, MARGIN * _extent(explored, lowest))
            box = lowest.coordinates - half, lowest.coordinates + half
            posterior = _small_posterior(lanes, parameters, units, box, number, explored.lowest)
    seconds = time.perf_counter() - started
    found = tuple(searches)
    return LikelihoodCheck(test, explored, found, count, seconds, difference, posterior)


def _extent(explored: likelihood.Exploration, lowest: RunMisfit) -> Float[np.ndarray, " p"]:
    """Return how far explored points with a low chi squared are from the lowest minimum, (p,).

    For each coordinate, this is the largest distance, and at least two standard errors. Chi squared
    is low up to 11.5 above the smallest one, three times the rise at the ends of a 95 % interval.

    **Arguments:** `lowest`: the run at the lowest minimum.
    """
    low = explored.chi_squared <= explored.lowest + likelihood.WORTH * likelihood.RISE
    offsets = np.abs(explored.points[low] - lowest.coordinates)
    least = 2.0 * np.sqrt(np.diag(lowest.covariance))
    return np.maximum(offsets.max(axis=0, initial=0.0), least)


def _small_posterior(
    lanes: SideBySide,
    parameters: Mapping[str, Parameter],
    units: Mapping[str, str],
    box: tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]],
    number: int,
    lowest: float,
) -> Posterior | None:
    """Return the posterior in a box by few points, or ``None`` if they don't represent it.

    **Arguments:** `lanes`: the runs, and the samples; `parameters`, `units`, `number`: as in
    `check`; `box`: lower and upper ends (p,) of the coordinates, between which the prior is
    uniform; `lowest`: smallest chi squared that is known.
    """

    def uniform(points: np.ndarray) -> np.ndarray:
        """Return the logarithm of a constant density at points (n, p)."""
        return np.zeros(len(points))

    points, most_runs = int(POINTS * number), MOST_RUNS * number
    try:
        found = drawn_posterior(lanes, parameters, units, box, uniform, points, 0, most_runs)
    except (TooManyRunsError, ImpossiblePointsError, np.linalg.LinAlgError):
        # The last one is that of a singular cloud. The fit keeps its other intervals.
        return None
    # Warnings say that the box cuts the posterior off, or that few runs have a weight. Points that
    # do not come near the lowest minimum have missed it.
    nearest = found.coordinates[found.log_likelihood.argmax()]
    rise = float(lanes.chi_squared(nearest[None], lanes.count)[0, -1]) - lowest
    return None if found.warnings or rise > likelihood.RISE else found


def _quadratic_test(
    best: RunMisfit,
    runs: Experiment,
    data: Samples,
    limits: Float[np.ndarray, " p"],
    generator: np.random.Generator,
) -> likelihood.QuadraticTest:
    """Compare runs at points around the best run with the prediction of its covariance.

    **Arguments:** `best`, `runs`, `data`: as in `check`; `limits`: (p,) largest distance of the
    points, in coordinates; `generator`: source of random numbers.
    """
    offsets = likelihood.displacements(best.covariance, limits, generator)
    times, shape = np.asarray(runs.times), data.weights.shape
    trials = [run_misfit(runs, data, times[-1], best.coordinates + offset) for offset in offsets]
    moved = np.array([trial.residuals.reshape(shape) for trial in trials])
    # Far points bend chi squared by the scale of a parameter (such as a logarithm), which says
    # nothing about the motion: only near points decide up to which time the fit is reliable.
    near = np.all(np.abs(offsets) < 0.5 * limits, axis=1)
    residuals, jacobian = best.residuals.reshape(shape), best.jacobian.reshape(*shape, -1)
    return likelihood.tested(residuals, jacobian, offsets, moved, times, near)


def _descent(
    runs: Experiment,
    data: Samples,
    parameters: Mapping[str, Parameter],
    start: np.ndarray,
    near: float,
    steps: int,
    on_iteration: Callable[[Iteration], None],
) -> Search:
    """Search for the local minimum near a start, coordinates (p,).

    **Arguments:** `near`: Gauss-Newton step, in standard errors, below which the search ends;
    `steps`: largest number of its runs; the others are as in `check`.

    **Raises:** `KeyboardInterrupt` if the user interrupts it.
    """
    end = float(runs.times[-1])
    misfit = partial(run_misfit, runs, data, end)
    lowest, iterations, ending = search_with_damping(
        misfit, start, step_limits(parameters), near, steps, on_iteration
    )
    # `search_with_damping` catches an interruption by the user, which is to end the whole check.
    if ending is Ending.INTERRUPTED:
        raise KeyboardInterrupt
    return Search(start, (WindowSearch(end, iterations, ending),), lowest)


def _largest_offsets(
    best: RunMisfit, parameters: Mapping[str, Parameter]
) -> Float[np.ndarray, " p"]:
    """Return the largest distance of explored points from the estimates, (p,), in coordinates.

    The distance is twice the scale's `max_step` (see `AbstractScale`). If that is infinite, it is
    the larger of the coordinate's absolute value and `FARTHEST` standard deviations of an estimate
    of that parameter alone.
    """
    max_changes = step_limits(parameters)
    norms = np.linalg.norm(best.jacobian, axis=0)
    alone = np.where(norms > 0.0, FARTHEST / np.where(norms > 0.0, norms, 1.0), 0.0)
    far = np.maximum(np.abs(best.coordinates), alone)
    return np.where(np.isfinite(max_changes), 2.0 * max_changes, far)


def _early_covariances(
    best: RunMisfit, runs: Experiment, data: Samples, horizon: float
) -> list[Float[np.ndarray, "p p"]]:
    """Return covariances (p, p) of the coordinates for two early parts of the record.

    They end at `horizon`, s, and half way from the start of the run to it. The list is empty if the
    horizon is infinite.

    **Arguments:** `best`, `runs`, `data`: as in `check`.
    """
    if not math.isfinite(horizon):
        return []
    start, times = float(runs.start_time), np.asarray(runs.times)
    early = [times < start + fraction * (horizon - start) for fraction in (1.0, 0.5)]
    rows = best.jacobian.reshape(*data.weights.shape, -1)
    return [
        parameter_covariance((rows * part[:, None]).reshape(best.jacobian.shape)) for part in early
    ]
