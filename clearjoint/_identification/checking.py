"""Checks of a fit's covariance by runs around the estimates, and intervals where it fails.

After many impacts chi squared may be rough on the scale of the standard errors: the search
converges in one of several minima close together, and the covariance describes only that minimum.
By the quadratic model of chi squared, a displacement d of the coordinates from a minimum raises chi
squared by d^T C^-1 d, with the covariance C.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from numpy.random import Generator

from .._information.fisher_information import covariance
from .._parametrisation.parameter import step_limits
from .._simulation.run.terminal import ProgressBar
from . import goodness_of_fit as statistics
from .comparison import Comparison, OnFitIteration
from .goodness_of_fit import RISE
from .levenberg_marquardt import Ending, Search
from .points import Box, Covariance, Point, Points, drawn_among, far_apart
from .posterior.posterior import ImpossiblePointsError, TooManyRunsError, drawn_posterior
from .posterior.result import Posterior
from .residuals import RunMisfit, run_misfit

STEPS = (-4.0, -2.0, -1.0, 1.0, 2.0, 4.0)
"""Distances of the test points from the minimum along each direction, in standard errors."""
DRAWN = 8
"""Number of random test points for each parameter."""
LESS, MORE, FLOOR = 1.5, 2.0, 0.5
"""Chi squared agrees with the quadratic model if its rise is between predicted / LESS - FLOOR and
predicted * MORE + FLOOR."""
DIFFERING_SHARE = 0.1
"""The horizon is the first time at which chi squared disagrees with the quadratic model at this
share of the test points or more."""
WIDENINGS = (1.0, 2.0, 4.0)
"""Points are drawn from normal distributions with a fit's standard errors times these factors."""
KEPT = 32
"""Smallest number of points with the lowest chi squared among which a round draws new points."""
WORTH = 3.0
"""A point counts as low if its chi squared is at most this multiple of `RISE` above the lowest one.
New points are drawn among the low points."""
DESCENTS = 6
"""Largest number of local searches in a round."""
ROUNDS = 6
"""Maximum number of rounds in which an exploration draws points."""
SETTLED = 0.05
"""Growth of the intervals in a round, relative to their width, below which they are final."""


def displacements(covariance: Covariance, limits: Point, generator: Generator) -> Points:
    """Return displacements from a minimum of chi squared, at which runs test its quadratic model.

    Six displacements for each parameter change it by ±1, ±2 and ±4 standard errors, and the other
    parameters so that the model predicts the smallest chi squared for that change. With several
    parameters, six more lie along each eigenvector of the correlation matrix. Then `DRAWN` for each
    parameter are random: normally distributed with the `covariance`, every second one twice as
    long. All are shortened so that no component exceeds its entry of `limits` in magnitude.
    """
    errors, root = np.sqrt(np.diag(covariance)), _root(covariance)
    # Columns are displacements by one standard error. Column k of the first matrix is the
    # covariance with parameter k over the standard error of k: along this column the other
    # parameters minimise chi squared for a given value of parameter k.
    axes = [covariance / errors]
    if len(errors) > 1:  # With one parameter, the root is the same displacement again.
        axes.append(root)
    along = np.concatenate([np.multiply.outer(STEPS, row) for axis in axes for row in axis.T])
    normal = generator.standard_normal((DRAWN * len(errors), len(errors))) @ root.T
    normal[1::2] *= 2.0
    return within(np.concatenate([along, normal]), limits)


def within(offsets: Points, limits: Point) -> Float[np.ndarray, "m p"]:
    """Shorten each offset, keeping its direction, until no component exceeds its limit in
    magnitude; leave out offsets of zero length."""
    with np.errstate(divide="ignore", invalid="ignore"):
        factors = np.where(offsets == 0.0, 1.0, limits / np.abs(offsets))
    shortened = offsets * np.minimum(factors.min(axis=1), 1.0)[:, None]
    return shortened[np.abs(shortened).max(axis=1) > 0.0]


def _root(covariance: Covariance) -> Float[np.ndarray, "p p"]:
    """Return R with R R^T = `covariance`, which may be singular. The columns of R are displacements
    by one standard error along the eigenvectors of the correlation matrix."""
    errors = np.sqrt(np.diag(covariance))
    variances, vectors = np.linalg.eigh(covariance / np.outer(errors, errors))
    return errors[:, None] * vectors * np.sqrt(np.maximum(variances, 0.0))


@dataclass(frozen=True)
class QuadraticTest:
    """Test of the quadratic model of chi squared by runs at n points around a minimum.

    - `predicted`, `actual`: rise of chi squared from the minimum to each point, by model and runs.
    - `horizon`: first time at which chi squared of the samples up to it disagrees with the model at
      a tenth of the points or more, s; infinite if there is none.
    """

    predicted: Float[np.ndarray, " n"]
    actual: Float[np.ndarray, " n"]
    horizon: float

    @property
    def differing(self) -> Bool[np.ndarray, " n"]:
        """Whether the rise of chi squared at each point disagrees with the quadratic model."""
        return _differing(self.predicted, self.actual)

    @property
    def passed(self) -> bool:
        return not self.differing.any()


def _differing(predicted: np.ndarray, actual: np.ndarray) -> np.ndarray:
    low, high = predicted / LESS - FLOOR, predicted * MORE + FLOOR
    return ~((actual >= low) & (actual <= high))


def tested(
    residuals: Float[np.ndarray, "S T"],
    jacobian: Float[np.ndarray, "S T p"],
    offsets: Float[np.ndarray, "n p"],
    moved: Float[np.ndarray, "n S T"],
    times: Float[np.ndarray, " T"],
    near: Bool[np.ndarray, " n"],
) -> QuadraticTest:
    """Compare runs at n points around a minimum with the quadratic model, for S series at T times.

    `residuals` and `jacobian` are those at the minimum, `moved` the residuals at the points, at the
    given `offsets` of coordinates from the minimum, and `times` those of the samples, s. Only the
    points marked in `near` determine the `horizon` of the result: at far points the model fails
    from the first sample on if a scale, such as a logarithm, is not nearly linear on the way there.
    """
    linear = np.einsum("stp,np->nst", jacobian, offsets)
    predicted = np.cumsum((linear**2).sum(axis=1), axis=1)
    actual = np.cumsum((moved**2 - residuals**2).sum(axis=1), axis=1)
    # Rises are those over records that end at each of the times, (n, T). The minimum of the whole
    # record is no minimum of a part of it: chi squared of the samples up to an earlier time has a
    # slope there, which is subtracted.
    slope = np.cumsum(2.0 * (residuals * linear).sum(axis=1), axis=1)
    differing = _differing(predicted, actual - slope)[near]
    # The share is that of all points, so that a few near points alone do not count as many.
    late = np.flatnonzero(differing.sum(axis=0) >= max(DIFFERING_SHARE * len(offsets), 1.0))
    horizon = float(times[late[0]]) if late.size else math.inf
    return QuadraticTest(predicted[:, -1], actual[:, -1], horizon)


@dataclass(frozen=True)
class Exploration:
    """Result of `explore`: points around a minimum, and minima found from the lowest points.

    - `points`, `chi_squared`: coordinates of the minimum at which the fit's own search ended, then
      of all points drawn, and chi squared at each of them.
    - `minima`: the run at the minimum of the fit's own search, then the ends of the local searches.
    - `settled`: whether noise explains the lowest chi squared, and the last round widened every
      interval by less than a twentieth and found no new minimum that affects the intervals.
    """

    points: Points
    chi_squared: Float[np.ndarray, " n"]
    minima: tuple[RunMisfit, ...]
    settled: bool

    @property
    def lowest(self) -> float:
        """Smallest chi squared of all points and minima."""
        return min(float(self.chi_squared.min()), *(minimum.chi_squared for minimum in self.minima))

    def intervals(self) -> Box:
        """Return the ends of the 95 % intervals, which contain all points whose chi squared is at
        most `RISE` above the lowest, and the `interval_ends` of the minima."""
        allowed = self.points[self.chi_squared <= self.lowest + RISE]
        ends = np.concatenate([allowed, interval_ends(self.minima, self.lowest)])
        return ends.min(axis=0), ends.max(axis=0)


def interval_ends(minima: Sequence[RunMisfit], lowest: float) -> Float[np.ndarray, "k p"]:
    """Return the 95 % intervals around minima: for each minimum, a row of the lower ends of all
    coordinates, then a row of the upper ends.

    The interval of a coordinate has the values at which chi squared, minimised over the other
    coordinates by the quadratic model of the minimum, is at most `RISE` above `lowest`, the
    smallest known chi squared. Minima whose own chi squared is higher are left out.
    """
    ends = []
    for minimum in minima:
        excess = RISE - (minimum.chi_squared - lowest)
        if excess >= 0.0:
            half = np.sqrt(excess * np.diag(minimum.covariance))
            ends += [minimum.coordinates - half, minimum.coordinates + half]
    return np.array(ends).reshape(-1, len(minima[0].coordinates))


STEPS_DOWN = 15
"""Maximum number of runs of a local search; the final search has four times as many."""
NEAR, NEAREST = 0.03, 1e-3
"""Gauss-Newton steps, in standard errors, at which a local search and the final search end."""


@dataclass
class _CountedRuns:
    """Makes and counts the runs of `explore`: a run with derivatives by p parameters as 1 + p runs.
    `most`: limit of the count. `points`: number of runs without derivatives so far, one for each
    point. `searches`: local searches so far, whose runs have derivatives."""

    compared: Comparison
    most: float
    on_iteration: OnFitIteration
    bar: ProgressBar
    points: int = 0
    searches: list[Search] = field(default_factory=list)

    def chi_squared(self, points: Points) -> Float[np.ndarray, " n"]:
        self.points += len(points)
        values = self.compared.chi_squared(points, self.compared.count)[:, -1]
        self.bar.update(len(points))
        return values

    def descend(self, start: Point, near: float = NEAR, steps: int = STEPS_DOWN) -> RunMisfit:
        """Return the best run of a local search from `start`. The search ends when its next step is
        below `near` standard errors, or after `steps` runs with derivatives."""
        end = float(self.compared.times[-1])
        search = self.compared.search(start, [end], near, steps, self.on_iteration)
        # An interruption, which `search` catches, ends the whole check.
        if search.ending is Ending.INTERRUPTED:
            raise KeyboardInterrupt
        self.searches.append(search)
        self.bar.update(search.evaluations)
        return search.best

    @property
    def searched(self) -> int:
        """Number of runs with derivatives, each counted once."""
        return sum(search.evaluations for search in self.searches)

    def left(self) -> float:
        """Return the number of further runs without derivatives within the limit."""
        each = 1 + len(self.compared.parameters)
        return self.most - self.points - each * self.searched


def explore(
    runs: _CountedRuns,
    minimum: RunMisfit,
    covariances: Sequence[Covariance],
    limits: Point,
    number: int,
    likely: float,
    generator: Generator,
) -> Exploration:
    """Explore the neighbourhood of a fit's `minimum` for all points with a similar chi squared.

    The first round draws `number` points around the minimum, from normal distributions with once,
    twice and four times the standard errors of each of the `covariances`, the first of which is
    that of the minimum. Each further round draws half as many points among those with the lowest
    chi squared so far (`drawn_among`). If the round before found a much lower minimum, or if the
    lowest chi squared is above `likely`, the largest that noise explains, the round draws as many
    points again around the lowest minimum. Points drawn around a minimum are at most `limits` away
    from it in each coordinate. In every round, local searches start from low points that are far
    from each other and from the known minima. The exploration ends when it has settled (see
    `Exploration`), after `ROUNDS` rounds, or when no further runs are affordable.
    """
    p = len(minimum.coordinates)
    bounds = minimum.coordinates - limits, minimum.coordinates + limits

    def drawn_around(centre: Point, covariances: Sequence[Covariance], count: int) -> Points:
        # The points take the covariances and factors in turn.
        roots = [factor * _root(matrix) for matrix in covariances for factor in WIDENINGS]
        normal = generator.standard_normal((count, p))
        offsets = np.stack([roots[k % len(roots)] @ row for k, row in enumerate(normal)])
        return centre + within(offsets, limits)

    new_points = drawn_around(minimum.coordinates, covariances, number)
    points, values = minimum.coordinates[None], np.array([minimum.chi_squared])
    minima, best, previous_intervals = [minimum], minimum, None
    for _ in range(ROUNDS):
        points = np.concatenate([points, new_points])
        values = np.concatenate([values, runs.chi_squared(new_points)])
        # The points with the lowest chi squared: at least `KEPT`, and all of a chi squared that is
        # worth a closer look, but at most half as many as the first round has.
        low_enough = max(KEPT, int((values <= values.min() + WORTH * RISE).sum()))
        lowest_points = points[np.argsort(values, kind="stable")[: min(low_enough, number // 2)]]
        descended = _local_searches(lowest_points, minima, runs)
        # Returned as it is, with `settled` true, only if the intervals have settled.
        explored = Exploration(points, values, (*minima, *descended), True)
        low, high = explored.intervals()
        # A minimum is new if it affects the intervals and is none of the known ones.
        relevant = [end for end in descended if end.chi_squared <= explored.lowest + RISE]
        new_minima = [
            end for end in relevant if not any(inside(known, end.coordinates) for known in minima)
        ]
        minima += descended
        best_before, best = best, min(minima, key=lambda other: other.chi_squared)
        decrease = best_before.chi_squared - best.chi_squared
        if previous_intervals is not None and not new_minima and explored.lowest <= likely:
            # Growth of each interval at its two ends since the round before, relative to its width.
            before_low, before_high = previous_intervals
            grown = np.maximum(before_low - low, high - before_high) / (high - low)
            if (grown < SETTLED).all():
                return explored
        previous_intervals = low, high
        if runs.left() <= 0.0:
            break
        # New points are drawn among the lowest points and the minima, because local searches reach
        # lower chi squared than random points.
        limit = explored.lowest + WORTH * RISE
        near = [other.coordinates for other in minima if other.chi_squared <= limit]
        among = np.concatenate([lowest_points, np.array(near).reshape(-1, p)])
        new_points = drawn_among(among, number // 2, bounds, generator)
        # If a much lower minimum has been found, the first points were drawn around the wrong one.
        # If noise doesn't explain its chi squared, an even lower one may be near.
        if decrease > RISE or explored.lowest > likely:
            around_best = [best.covariance, *covariances[1:]]
            further_points = drawn_around(best.coordinates, around_best, number // 2)
            new_points = np.concatenate([new_points, further_points])
    return replace(explored, settled=False)


def _local_searches(
    starts: Points, minima: Sequence[RunMisfit], runs: _CountedRuns
) -> list[RunMisfit]:
    """Search for minima from up to `DESCENTS` of the starts, chosen far from each other and not
    `inside` the known `minima`, and return the ends of the searches. All but the first search are
    made only while further runs are affordable."""
    # Searches from points in known minima would only find these minima again.
    candidates = [x for x in starts if not any(inside(minimum, x) for minimum in minima)]
    # `far_apart` measures distances in standard deviations of the points, so it needs two or more.
    several = len(candidates) > 1
    chosen = far_apart(np.array(candidates), DESCENTS) if several else range(len(candidates))
    ends: list[RunMisfit] = []
    for k in chosen:
        if not ends or runs.left() > 0.0:
            ends.append(runs.descend(candidates[k]))
    return ends


def inside(minimum: RunMisfit, point: Point) -> bool:
    """Return whether d^T C^-1 d < 1 for the offset d of a point from a minimum with the covariance
    C: a search from such a point would probably end in this minimum."""
    offset = point - minimum.coordinates
    errors = np.sqrt(np.diag(minimum.covariance))
    # In units of the standard errors, C is the correlation matrix. It may be singular, and the
    # cutoff of its pseudoinverse does not depend on the units of the coordinates.
    scaled = minimum.covariance / np.outer(errors, errors)
    return float((offset / errors) @ np.linalg.pinv(scaled) @ (offset / errors)) < 1.0


FARTHEST = 100.0
"""Distance from the estimates, in standard errors, up to which an exploration may draw points."""
POINTS, MOST_RUNS = 1.25, 75
"""Number of points of the small posterior, and number of runs above which it is given up, in
multiples of the number of points in the first round of the exploration."""
LEAST_NUMBER, MOST_NUMBER = 50, 400
"""Limits of the number of points in the first round, if the user gives no number."""
LEAST_RUNS = 20
"""A posterior is begun only if at least this many runs for each of its points are affordable."""
MARGIN = 4.0
"""Half the width of the small posterior's box, in multiples of the result of `_extent`. A wider box
takes more runs, a narrower one may cut the posterior off."""


@dataclass(frozen=True)
class LikelihoodCheck:
    """Result of `check`: runs around the estimates of a fit's own search.

    - `test`: comparison of chi squared at points around the estimates with the covariance.
    - `exploration`, `posterior`: ``None`` if the test passed. The posterior is also ``None`` if
      noise doesn't explain chi squared, or if it was too costly or discarded (`_small_posterior`).
    - `searches`: the local searches of the exploration. If they have found a minimum lower than the
      fit's by more than `FLOOR`, a more accurate search from the lowest minimum is the last.
    - `runs`: number of runs, except those of the posterior.
    - `seconds`: computing time, including that of the posterior.
    - `difference`: chi squared at the estimates in a run without derivatives, less that in the run
      with derivatives. Integration errors are too large if its magnitude exceeds 1, the rise of chi
      squared at a distance of one standard error.
    - `bounded`: whether the cost was limited to about that of the fit and the test.
    """

    test: QuadraticTest
    exploration: Exploration | None
    searches: tuple[Search, ...]
    runs: int
    seconds: float
    difference: float
    posterior: Posterior | None = None
    bounded: bool = False

    @property
    def passed(self) -> bool:
        return self.test.passed

    def widening(self, best: RunMisfit) -> float:
        """Compare the distances of the intervals' ends from `best` by the exploration and by the
        covariance of `best`. Return the largest ratio of the larger distance to the smaller."""
        assert self.exploration is not None
        half = np.sqrt(RISE * np.diag(best.covariance))
        low, high = self.exploration.intervals()
        distances = np.abs(np.concatenate([best.coordinates - low, high - best.coordinates]))
        # Lower ends come first, then upper ends; `half` is the distance by the covariance of both.
        ratios = distances / np.tile(half, 2)
        return float(np.maximum(ratios, 1.0 / np.maximum(ratios, 1e-12)).max())

    @cached_property
    def minima(self) -> int:
        """Number of minima that are not `inside` a lower one, and whose chi squared is at most
        `RISE` above the lowest; 1 if the test passed."""
        if self.exploration is None:
            return 1
        limit, minima = self.exploration.lowest + RISE, self.exploration.minima
        return len(statistics.distinct(minima, limit, lambda a, b: not inside(a, b.coordinates)))


def check(
    best: RunMisfit,
    compared: Comparison,
    number: int | None,
    on_iteration: OnFitIteration,
    cost: int = 0,
    show: bool = False,
) -> LikelihoodCheck:
    """Test the covariance of a fit by runs around its `best` run, of the experiment in `compared`.

    If the test fails, explore chi squared and, if noise explains its lowest value, compute a small
    posterior. `number` is the number of points in the first round of the exploration, to which the
    size of the posterior is proportional. With ``None``, exploration and posterior together cost
    about as much as the test and the fit, which took `cost` runs with derivatives. `on_iteration`
    is called after each run of a local search; `show` tells whether to show a progress bar.
    """
    started = time.perf_counter()
    with ProgressBar(show, desc="check of the covariance", unit=" runs") as bar:
        # The seed is fixed: the check of the same fit always gives the same result.
        generator = np.random.default_rng(0)
        p = len(best.coordinates)
        limits = _largest_offsets(best, step_limits(compared.parameters))
        test = _quadratic_test(best, compared, limits, generator, bar)
        tested_points = len(test.actual)
        if test.passed:
            seconds = time.perf_counter() - started
            return LikelihoodCheck(test, None, (), tested_points, seconds, 0.0)
        most_runs = math.inf
        if number is None:
            # A run with derivatives costs as much as 1 + p runs without. The first round gets a
            # quarter of `most_runs`; the later rounds and the posterior need enough too.
            most_runs = float((1 + p) * (cost + tested_points))
            number = int(np.clip(most_runs // 4, LEAST_NUMBER, MOST_NUMBER))
        runs = _CountedRuns(compared, most_runs, on_iteration, bar)
        # Runs without derivatives have other steps than the `best` run.
        difference = float(runs.chi_squared(best.coordinates[None])[0]) - best.chi_squared
        farthest = np.minimum(limits, FARTHEST * np.sqrt(np.diag(best.covariance)))
        likely = statistics.chi_squared_exceeded(statistics.UNLIKELY, compared.data.count - p)
        # Chi squared of an early part of the record is smoother and wider: its covariance draws
        # points beyond the minimum that the whole record's covariance describes.
        covariances = [best.covariance, *_early_covariances(best, compared, test.horizon)]
        explored = explore(runs, best, covariances, farthest, number, likely, generator)
        # The local searches of the exploration end early. If one of them has found a lower minimum,
        # the fit moves there, which takes an accurate search. The test tolerates a decrease of chi
        # squared up to `FLOOR`, so that a smaller one is no other minimum.
        lowest_minimum = min(explored.minima, key=lambda minimum: minimum.chi_squared)
        if best.chi_squared - lowest_minimum.chi_squared > FLOOR:
            runs.descend(lowest_minimum.coordinates, near=NEAREST, steps=4 * STEPS_DOWN)
        posterior = None
        # If noise doesn't explain chi squared, the model is wrong, and so would be its posterior.
        if explored.lowest <= likely and runs.left() > LEAST_RUNS * POINTS * number:
            half = np.minimum(farthest, MARGIN * _extent(explored, lowest_minimum))
            box = lowest_minimum.coordinates - half, lowest_minimum.coordinates + half
            most = int(min(runs.left(), MOST_RUNS * number))
            posterior = _small_posterior(compared, box, number, explored.lowest, most, bar)
        return LikelihoodCheck(
            test=test,
            exploration=explored,
            searches=tuple(runs.searches),
            runs=tested_points + len(explored.points) + runs.searched,
            seconds=time.perf_counter() - started,
            difference=difference,
            posterior=posterior,
            bounded=math.isfinite(most_runs),
        )


def _extent(explored: Exploration, lowest: RunMisfit) -> Point:
    """Return the largest distance from the `lowest` minimum, in each coordinate, of points with a
    chi squared at most `WORTH` times `RISE` above the smallest; at least two standard errors."""
    low = explored.chi_squared <= explored.lowest + WORTH * RISE
    offsets = np.abs(explored.points[low] - lowest.coordinates)
    least = 2.0 * np.sqrt(np.diag(lowest.covariance))
    return np.maximum(offsets.max(axis=0, initial=0.0), least)


def _small_posterior(
    compared: Comparison, box: Box, number: int, lowest: float, most_runs: int, bar: ProgressBar
) -> Posterior | None:
    """Return the posterior for a uniform prior in a box, with `POINTS` times `number` points. The
    first round of the exploration had `number` points. Return ``None`` if the posterior has
    `warnings`, misses `lowest`, the smallest known chi squared, by over `RISE`, needs over
    `most_runs` runs, or has too few points with a likelihood above zero."""
    before = bar.n  # The bar has counted the other runs of the check so far.

    def on_step(time: float, runs: int) -> None:
        bar.set_postfix_str(f"posterior to {time:.4g} s")
        bar.update(before + runs - bar.n)

    try:
        # The seed is fixed at 0, so that the same fit always has the same posterior.
        points = int(POINTS * number)
        posterior = drawn_posterior(compared, box, None, points, 0, most_runs, on_step)
    except (TooManyRunsError, ImpossiblePointsError):
        return None  # The fit keeps its other intervals.
    # Warnings say that the box cuts the posterior off, that the data hardly determine a parameter,
    # or that few runs have a weight.
    nearest = posterior.coordinates[posterior.log_likelihood.argmax()]
    rise = float(compared.chi_squared(nearest[None], compared.count)[0, -1]) - lowest
    return None if posterior.warnings or rise > RISE else posterior


def _quadratic_test(
    best: RunMisfit, compared: Comparison, limits: Point, generator: Generator, bar: ProgressBar
) -> QuadraticTest:
    offsets = displacements(best.covariance, limits, generator)
    data, times, moved = compared.data, compared.times, []
    for offset in offsets:
        trial = run_misfit(compared.runs, data, times[-1], best.coordinates + offset)
        moved.append(trial.residuals.reshape(data.weights.shape))
        bar.update()
    # At far points chi squared deviates from the quadratic model because the scale of a parameter,
    # such as a logarithm, is not linear, whatever the motion: only near points decide up to which
    # time the fit is reliable. Half of the limits is the scale's `max_step`, where that is finite.
    near = np.all(np.abs(offsets) < 0.5 * limits, axis=1)
    residuals = best.residuals.reshape(data.weights.shape)
    jacobian = best.jacobian.reshape(*residuals.shape, -1)
    return tested(residuals, jacobian, offsets, np.array(moved), times, near)


def _largest_offsets(best: RunMisfit, max_changes: Point) -> Point:
    """Return the largest distance of explored points from the estimates in each coordinate: twice
    the `max_changes` in one step of a fit or, if infinite, the larger of the coordinate's magnitude
    and `FARTHEST` times the standard error that it would have if all others were known."""
    norms = np.linalg.norm(best.jacobian, axis=0)
    # With all other parameters known, the standard error is the inverse of the column's norm.
    far_alone = np.where(norms > 0.0, FARTHEST / np.where(norms > 0.0, norms, 1.0), 0.0)
    far = np.maximum(np.abs(best.coordinates), far_alone)
    return np.where(np.isfinite(max_changes), 2.0 * max_changes, far)


def _early_covariances(best: RunMisfit, compared: Comparison, horizon: float) -> list[Covariance]:
    """Return the covariances of fits to the record up to `horizon`, s, and to the first half of
    this part; none if `horizon` is infinite."""
    if not math.isfinite(horizon):
        return []
    start = float(compared.runs.base.start_time)
    are_early = [compared.times < start + part * (horizon - start) for part in (1.0, 0.5)]
    # Rows of the Jacobian are those of one series after the other, each at all times.
    series = len(compared.data.weights)
    return [covariance(best.jacobian * np.tile(early, series)[:, None]) for early in are_early]
