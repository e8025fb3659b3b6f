"""Sequential Monte Carlo over a growing record, and importance sampling at its end.

A cloud of points is drawn from the prior. Then the record enters the likelihood in steps of many
samples, or of a fraction of one. After each step the points are weighted, resampled and moved, so
that they are distributed as the posterior of the record so far (N. Chopin, *A sequential particle
filter method for static models*, 2002; adaptive steps as by A. Jasra et al., *Inference for
Lévy-driven stochastic volatility models via adaptive sequential Monte Carlo*, 2011). Over a part of
the record with few impacts, chi squared is smooth, so that the cloud finds the region of the truth
before later impacts make it rough. The usual growing powers of the likelihood of the whole record,
as in BlackJAX, would have to find this region in the rough chi squared.

The cloud serves only to find the region, because a small cloud loses the ends of a curved region.
The points of the result and the evidence come from rounds of importance sampling (O. Cappé et al.,
*Population Monte Carlo*, 2004).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from numpy.random import Generator

from ..points import Point, Points, chi_squared_over, filled, last_where

KEPT = 0.5
"""Smallest effective number of points after a step along the record, over the number of points."""
AHEAD = 1.5
"""Ratio of the number of sample times over which points are run to the number of those in the
likelihood. The further times serve the next steps."""
ACCEPTED, SWEEPS = 1.5, 10
"""Mean number of accepted moves of a point after which a step ends, and largest number of moves
tried for each point in a step."""
PRIOR_POINTS, PRIOR_NUMBER = 2**12, 2**10
"""Number of points of the box that show where the prior is zero, and whether it is uniform;
smallest number of points drawn from a prior that is not uniform. None of the points takes a run."""
CLOUD, SHARE = 100, 5
"""The cloud has `CLOUD` points, or the number of points to draw divided by `SHARE` if that is more,
but no more points than are to be drawn."""
FIRST, GROWTH, MOST, ROUNDS = 2, 3, 10, 5
"""Importance sampling makes `FIRST` draws for each point of the result in the first round. A later
round makes at most `GROWTH` times those of the round before, and at most `MOST` for each point.
There are at most `ROUNDS` rounds. Draws outside the box take no run."""
WIDER = 2.0
"""Factor on the standard deviations of the distributions from which importance sampling draws."""
RIDGE = 1e-10
"""Multiple of the cloud's variance along each coordinate that is added to this variance, so that
the covariance of a flat cloud is not singular."""
NARROWEST = 1e-4
"""Share of the cloud's covariance that is added to the covariance of the points near each point,
which is singular if these are nearly equal: 1 % of the cloud's standard deviations."""
WIDE, OVERALL = 1.5, 0.1
"""Standard deviations of the wide distribution of `Mixture.around`, over those of the cloud, and
weight of this distribution."""

TOGETHER = 256
"""Number of points whose densities are computed at once."""

Weights = Float[np.ndarray, " n"]
"""A weight of each of n points, or its logarithm."""
OnStep = Callable[[float], None]
"""Function that is called after each step along the record and each round of importance sampling,
with the number of sample times in the likelihood."""
Curves = Callable[[Points, int], Float[np.ndarray, "n counts"]]
"""Function that runs points (n, p) over the first T sample times, and returns chi squared over the
first 0 to T times, (n, T + 1), infinite from the first sample on that a run misses."""


@dataclass(frozen=True)
class Target:
    """Posterior to draw from: likelihood exp(-chi squared / 2), prior in the box `low` to `high`.

    - `curves`: function that runs points and returns chi squared over growing parts of the record
      (see `Curves`). `count`: number of sample times of the record.
    - `log_prior`: logarithm of the prior density at points in the box, up to a constant.
    """

    curves: Curves
    count: int
    low: Point
    high: Point
    log_prior: Callable[[Points], Float[np.ndarray, " n"]]

    def holds(self, points: Points) -> Bool[np.ndarray, " n"]:
        """Whether each point is in the box."""
        return np.all((points >= self.low) & (points <= self.high), axis=1)


class Cloud(NamedTuple):
    """Points in the box of a `Target`, and their runs over a first part of the record. `curves` is
    chi squared over the first 0, 1, 2, ... sample times of this part, as returned by `Curves`.
    `log_priors` are the logarithms of the points' prior density."""

    points: Points
    curves: Float[np.ndarray, "n counts"]
    log_priors: Float[np.ndarray, " n"]

    def taken(self, indices: np.ndarray) -> "Cloud":
        return Cloud(*(part[indices] for part in self))

    def replaced(self, mask: np.ndarray, others: "Cloud") -> "Cloud":
        """Return a copy in which `others` replace, in order, the points where `mask` is true."""
        copy = Cloud(*map(np.copy, self))
        for part, new_rows in zip(copy, others, strict=True):
            part[mask] = new_rows
        return copy


@dataclass(frozen=True)
class Drawn:
    """Result of `draw`: points of equal weight that are distributed as the posterior.

    - `log_evidence`: logarithm of the mean of exp(-chi squared / 2) over the prior, with its
      standard error `error`.
    - `effective`: effective number of the weighted runs from which the points were drawn.
    - `steps`: number of steps in which the record entered the likelihood.
    """

    points: Points
    chi_squared: Float[np.ndarray, " n"]
    log_evidence: float
    error: float
    effective: float
    steps: int


class ImpossiblePriorError(ArithmeticError):
    """Error of `draw` if the prior is zero at all or almost all points of the box."""


def draw(
    target: Target, number: int, generator: Generator, on_step: OnStep = lambda count: None
) -> Drawn:
    """Draw `number` points from the posterior `target`, by steps along the record. After each step
    or round, `on_step` is called with the number of sample times in the likelihood.

    **Raises:** `ImpossiblePriorError`; `FloatingPointError` if, in a step or round, the likelihood
    is zero at each point; `numpy.linalg.LinAlgError` if so few distinct points have a weight that
    they have no covariance.
    """
    points, log_integral, error = from_prior(target, _cloud_size(number), generator)
    drawn = drawn_from(target, points, number, generator, on_step)
    # The prior is given up to a constant, so the evidence is divided by its integral over the box.
    # The two are estimated from independent random numbers.
    log_evidence = drawn.log_evidence - log_integral
    return replace(drawn, log_evidence=log_evidence, error=math.hypot(drawn.error, error))


def _cloud_size(number: int) -> int:
    return min(number, max(CLOUD, number // SHARE))


def from_prior(target: Target, number: int, generator: Generator) -> tuple[Points, float, float]:
    """Return points of the prior, the logarithm of the prior's integral over the box, and the
    standard error of this logarithm.

    Points of a uniform prior fill the box evenly. Points of any other prior are drawn by
    `drawn_from`, with the prior as the likelihood of a record of one sample. Points that fill the
    box can't be weighted by the prior instead: if it is much narrower than the box, a single point
    has all the weight.
    """
    box = filled(target.low, target.high, PRIOR_POINTS, generator)
    logarithms = target.log_prior(box)
    possible = box[logarithms > -np.inf]
    # As many points as dimensions have no covariance.
    if len(possible) <= box.shape[1]:
        raise ImpossiblePriorError(f"finite at {len(possible)} of {PRIOR_POINTS} points")
    if np.ptp(logarithms) == 0.0:
        log_volume = float(np.log(target.high - target.low).sum())
        points = filled(target.low, target.high, number, generator)
        return points, log_volume + float(logarithms[0]), 0.0

    # A record of one sample whose chi squared is -2 log_prior has the prior as its likelihood.
    # Column k is chi squared of the first k samples.
    def curves(points: np.ndarray, count: int) -> np.ndarray:
        return np.stack([np.zeros(len(points)), -2.0 * target.log_prior(points)][: count + 1], 1)

    prior = replace(target, curves=curves, count=1, log_prior=lambda points: np.zeros(len(points)))
    drawn_number = max(number, PRIOR_NUMBER)
    # The cloud begins with points of the uniform distribution over the part of the box where the
    # prior is not zero. If they are few, they are repeated, and moves separate them.
    start = np.resize(generator.permutation(possible), (_cloud_size(drawn_number), len(target.low)))
    try:
        drawn = drawn_from(prior, start, drawn_number, generator, on_step=lambda count: None)
    except (FloatingPointError, np.linalg.LinAlgError) as error:
        raise ImpossiblePriorError(str(error)) from error
    return generator.permutation(drawn.points)[:number], drawn.log_evidence, drawn.error


def drawn_from(
    target: Target, points: Points, number: int, generator: Generator, on_step: OnStep
) -> Drawn:
    """Draw `number` points from the posterior, by steps along the record from `points` of the
    prior, and then by importance sampling.

    The cloud at the end of the record is small, and its points have moved little. Importance
    sampling therefore draws from wide normal distributions around the points of the cloud, and each
    further round from those around the weighted points of the round before, until the effective
    number of runs is at least `number`. Only the last round enters the result. The mean of its
    weights is an almost unbiased estimate of the integral of prior times likelihood: the mixture is
    fixed before the round, whose runs only decide whether another round follows.
    """
    points, weights, steps = along_record(target, points, generator, on_step)
    mixture, runs = Mixture.around(points, weights, WIDER), FIRST * number
    for _ in range(ROUNDS):
        drawn = mixture.drawn(runs, generator)
        # Outside the box the prior is zero, so these points need no run.
        inside = target.holds(drawn)
        cloud = evaluated(target, drawn[inside], target.count)
        chi_squared = cloud.curves[:, -1]
        logarithms = cloud.log_priors - 0.5 * chi_squared - mixture.log_density(cloud.points)
        weights, log_mean = normalised(logarithms)
        effective = effective_number(cloud.points, weights)
        on_step(target.count)
        chosen = resampled(weights, generator, number)
        if effective >= number:
            break
        kept, copies = np.unique(chosen, return_counts=True)
        # A mixture around a few points would shrink to a spot, where all weights are equal.
        if len(kept) >= fewest_for_covariance(points.shape[1]):
            mixture = Mixture.around(cloud.points[kept], copies / number, WIDER)
        # If the share of effective runs stays the same, `number` of the next ones are effective.
        next_runs = int(number * len(drawn) / effective)
        runs = min(next_runs, GROWTH * len(drawn), MOST * number)
    # `log_mean` is the logarithm of the mean weight of the draws inside the box. The weights of all
    # others are zero, so the mean over all draws is this mean times the share of those inside.
    log_evidence = log_mean + math.log(inside.mean())
    # Standard error of the mean of all weights, those outside the box included, relative to it.
    error = math.sqrt(max(1.0 / effective - 1.0 / len(drawn), 0.0))
    points, chi_squared = cloud.points[chosen], chi_squared[chosen]
    return Drawn(points, chi_squared, log_evidence, error, effective, steps)


def along_record(
    target: Target, points: Points, generator: Generator, on_step: OnStep
) -> tuple[Points, Weights, int]:
    """Return weighted points near the posterior of the whole record, their weights of sum 1, and
    the number of steps along the record, from `points` of the prior."""
    # The points have been run over `ahead` sample times; `reached` of these are in the likelihood.
    ahead, reached, steps = 1, 0.0, 0
    cloud = evaluated(target, points, ahead)
    while True:
        following = next_count(cloud.curves, reached)
        # If the step could go to the end of the runs, they may be too short for it: the points run
        # over more of the record first.
        if following >= ahead and ahead < target.count:
            ahead = min(int(AHEAD * ahead) + 1, target.count)
            cloud = evaluated(target, cloud.points, ahead)
            continue
        # Weights by what this part of the record adds to the likelihood.
        before, after = (chi_squared_over(cloud.curves, k) for k in (reached, following))
        weights, _ = normalised(0.5 * (before - after))
        reached, steps = following, steps + 1
        on_step(reached)
        if reached >= target.count:
            return cloud.points, weights, steps
        # New points need not run much farther than the likelihood, so the old ones are shortened.
        ahead = min(int(AHEAD * reached) + 2, ahead)
        cloud = Cloud(cloud.points, cloud.curves[:, : ahead + 1], cloud.log_priors)
        cloud = mutated(target, cloud, weights, reached, generator)


def evaluated(target: Target, points: Points, ahead: int) -> Cloud:
    """Return the cloud of `points`, all in the box, run over the first `ahead` sample times."""
    return Cloud(points, target.curves(points, ahead), target.log_prior(points))


def next_count(curves: Float[np.ndarray, "n counts"], reached: float) -> float:
    """Return the number of sample times in the likelihood after the next step, from the number
    `reached` before it. `curves`: chi squared of n points, in column k over the first k times.

    The step goes so far that the effective number of points falls to the share `KEPT` of all
    points, but at most to the end of the runs.
    """
    before, last = chi_squared_over(curves, reached), curves.shape[1] - 1

    def enough(count: float) -> bool:
        with np.errstate(invalid="ignore"):
            fall = 0.5 * (before - chi_squared_over(curves, count))
        # Without a point that reaches `count` times, there are no weights.
        if not np.isfinite(fall).any():
            return False
        weights, _ = normalised(fall)
        return 1.0 / (weights**2).sum() >= KEPT * len(curves)

    if enough(float(last)):
        return float(last)
    # Where most runs miss the next sample, no step leaves enough points. The shortest step discards
    # only these runs; a longer one might leave a single point, if chi squared is steep.
    longest = last_where(enough, reached, float(last))  # The number falls as the step grows.
    return max(longest, float(np.nextafter(reached, np.inf)))


def normalised(logarithms: Weights) -> tuple[Weights, float]:
    """Return weights of sum 1 in proportion to exp(logarithms), and log(mean(exp(logarithms))).

    **Raises:** `FloatingPointError` if all logarithms are -inf or NaN, or one is +inf.
    """
    finite = np.where(np.isnan(logarithms), -np.inf, logarithms)
    largest = finite.max(initial=-np.inf)
    if not np.isfinite(largest):
        raise FloatingPointError("no point has a likelihood")
    weights = np.exp(finite - largest)
    return weights / weights.sum(), float(largest + np.log(weights.mean()))


def effective_number(points: Points, weights: Weights) -> float:
    """Return the effective number of weighted points, 1 / (sum of their squared weights), where
    equal points count as one, with the sum of their weights."""
    return 1.0 / float((_distinct(points, weights)[1] ** 2).sum())


def _distinct(
    points: Points, weights: Weights
) -> tuple[Float[np.ndarray, "m p"], Float[np.ndarray, " m"]]:
    distinct, numbers = np.unique(points, axis=0, return_inverse=True)
    # Weights of equal points are added. Some versions of NumPy return the inverse of `unique` as a
    # column, hence `ravel`.
    return distinct, np.bincount(numbers.ravel(), weights, len(distinct))


def resampled(weights: Weights, generator: Generator, count: int | None = None) -> np.ndarray:
    """Return the rising indices of `count` points, by default as many as there are weights, drawn
    with the `weights` as probabilities by systematic resampling."""
    count = len(weights) if count is None else count
    # The sum of the weights may be less than 1 by rounding, hence the minimum.
    ticks = (np.arange(count) + generator.uniform()) / count
    return np.minimum(np.searchsorted(np.cumsum(weights), ticks), len(weights) - 1)


def mutated(
    target: Target, cloud: Cloud, weights: Weights, reached: float, generator: Generator
) -> Cloud:
    """Resample a weighted cloud and move its points, by the rule of Metropolis and Hastings, for
    the likelihood of the first `reached` sample times, a number that may have a fraction.

    Moves alternate between draws from a mixture of normal distributions around the weighted points
    and steps along differences of two of them (C. ter Braak, *A Markov chain Monte Carlo version of
    the genetic algorithm Differential Evolution*, 2006). Both follow a curved cloud, or one in
    several parts.
    """
    mixture = Mixture.around(cloud.points, weights)
    moved = cloud.taken(resampled(weights, generator))
    accepted, number = 0, len(weights)
    for sweep in range(SWEEPS):
        if sweep % 2 == 0:
            # These draws do not depend on the present point, so the acceptance ratio has the ratio
            # of the mixture's densities at the present and the new point as a factor. Logarithms
            # are used, because densities may underflow.
            points = mixture.drawn(number, generator)
            log_ratios = mixture.log_density(moved.points) - mixture.log_density(points)
        else:  # A symmetric step, whose ratio is 1, with logarithm 0.
            # The most efficient length of steps for a normal distribution (ter Braak, 2006).
            pairs = cloud.points[generator.choice(number, (2, number), p=weights)]
            length = 2.38 / math.sqrt(2.0 * cloud.points.shape[1])
            points, log_ratios = moved.points + length * (pairs[0] - pairs[1]), 0.0
        inside = target.holds(points)
        if not inside.any():
            continue
        # New points are run as far as the old ones, whose curves begin with a column for no sample.
        new = evaluated(target, points[inside], moved.curves.shape[1] - 1)
        others = moved.replaced(inside, new)
        before, after = (0.5 * chi_squared_over(c.curves, reached) for c in (moved, others))
        log_ratios = log_ratios + before - after + others.log_priors - moved.log_priors
        accepts = inside & (np.log(generator.uniform(size=number)) < log_ratios)
        moved = moved.replaced(accepts, others.taken(accepts))
        accepted += int(accepts.sum())
        if accepted >= ACCEPTED * number:
            break
    return moved


def fewest_for_covariance(p: int) -> int:
    """Return the smallest number of points for a covariance of p coordinates."""
    return 4 * (p + 1)


@dataclass(frozen=True)
class Mixture:
    """Mixture of normal distributions; `roots` are lower Cholesky factors of their covariances."""

    centres: Points
    roots: Float[np.ndarray, "n p p"]
    weights: Weights

    @staticmethod
    def around(points: Points, weights: Weights, wider: float = 1.0) -> "Mixture":
        """Return a mixture that follows a cloud of n weighted points.

        There is one distribution around each point, with the weight of the point and the covariance
        of the points near it, and a wide one around all points. All standard deviations are
        multiplied by `wider`. Equal points count as one: as neighbours of each other they would
        have no covariance.
        """
        points, weights = _distinct(points, weights)
        count, p = points.shape
        # The covariance of p points or fewer is singular. `RIDGE` would only hide this: in at
        # least one direction, the spread of later points would be that of `RIDGE`.
        if np.count_nonzero(weights) <= p:
            raise np.linalg.LinAlgError(
                f"{np.count_nonzero(weights)} distinct points with a weight"
            )
        # Enough points for a covariance, and so few that they follow a curved region.
        near = min(max(fewest_for_covariance(p), round(2.0 * math.sqrt(count))), count)
        mean = weights @ points
        of_cloud = (weights[:, None] * (points - mean)).T @ (points - mean)
        # Where all points have the same coordinate its variance is zero; 1e-300 replaces it.
        of_cloud += RIDGE * np.diag(np.maximum(np.diag(of_cloud), 1e-300))
        # Scaled coordinates have unit covariance, so that all count equally in distances.
        scaled = np.linalg.solve(np.linalg.cholesky(of_cloud), points.T).T
        order = np.argpartition(((scaled[:, None] - scaled) ** 2).sum(axis=2), near - 1, axis=1)
        close = order[:, :near]
        # A point and all points near it may have weight zero, such as those of failed runs. The
        # small constant then avoids a division by zero.
        shares = weights[close] + 1e-12 / count
        shares = shares / shares.sum(axis=1, keepdims=True)
        offsets = points[close] - (shares[..., None] * points[close]).sum(axis=1, keepdims=True)
        covariances = np.einsum("nk,nki,nkj->nij", shares, offsets, offsets) + NARROWEST * of_cloud
        # The wide distribution reaches parts of the region from which all points have been lost.
        centres = np.concatenate([points, mean[None]])
        roots = np.linalg.cholesky(np.concatenate([covariances, WIDE**2 * of_cloud[None]]))
        return Mixture(centres, wider * roots, np.append((1.0 - OVERALL) * weights, OVERALL))

    def drawn(self, number: int, generator: Generator) -> Float[np.ndarray, "m p"]:
        chosen = generator.choice(len(self.weights), number, p=self.weights)
        normal = generator.standard_normal((number, self.centres.shape[1]))
        return self.centres[chosen] + np.einsum("nij,nj->ni", self.roots[chosen], normal)

    def log_density(self, points: Float[np.ndarray, "m p"]) -> Float[np.ndarray, " m"]:
        from scipy.special import logsumexp

        inverse = np.linalg.inv(self.roots)
        # Logarithm of the weight times the density at the centre, for each distribution; the
        # determinant of a root is the product of its diagonal.
        sizes = np.abs(np.diagonal(self.roots, axis1=1, axis2=2))
        with np.errstate(divide="ignore"):  # of weights of zero
            at_centres = np.log(self.weights) - np.log(sizes).sum(axis=1)
        at_centres = at_centres - 0.5 * points.shape[1] * math.log(2.0 * math.pi)
        # The offset of a point from a centre, scaled by the inverse root, is a difference of two
        # scaled vectors: all those of the points are one product of matrices. Their origin is in
        # the cloud, because differences of large vectors would have rounding errors.
        origin, rows = self.centres[-1], inverse.reshape(-1, points.shape[1])
        scaled_centres = np.einsum("nij,nj->ni", inverse, self.centres - origin)
        densities = []
        # In parts, because the offsets of all points from all centres may take much memory.
        for part in np.split(points, range(TOGETHER, len(points), TOGETHER)):
            scaled = ((part - origin) @ rows.T).reshape(len(part), *scaled_centres.shape)
            offsets = scaled - scaled_centres
            squares = np.einsum("mni,mni->mn", offsets, offsets)
            densities.append(logsumexp(at_centres - 0.5 * squares, axis=1))
        return np.concatenate(densities)
