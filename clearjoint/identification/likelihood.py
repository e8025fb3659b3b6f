"""How chi squared behaves around a minimum: comparison with the quadratic model behind the
covariance, and confidence intervals where that model fails.

Nothing here runs a scene: chi squared and local searches come in as functions
(`clearjoint.identification.checking` makes them of runs).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np
from jaxtyping import Bool, Float

from .screening.level_sets import among, apart

STEPS = (-4.0, -2.0, -1.0, 1.0, 2.0, 4.0)
"""Standard errors by which test points lie off the minimum along each direction."""
DRAWN = 8
"""Test points drawn at random, for each parameter."""
LESS, MORE, FLOOR = 1.5, 2.0, 0.5
"""Chi squared agrees with the quadratic model if its rise is at most so many times less, or more,
than the predicted one, give or take the floor. The limit is closer for less: behind a rise that
slackens there may be another minimum."""
MANY = 0.1
"""Share of the test points that must differ for the samples so far to lie past the horizon."""
RISE = NormalDist().inv_cdf(0.975) ** 2
"""Rise of chi squared over its minimum at the ends of a 95 % interval of one parameter, 3.84."""
WIDENINGS = (1.0, 2.0, 4.0)
"""Factors on the standard errors of the normal distributions from which points are drawn."""
KEPT = 32
"""Points with the smallest chi squared among which the next round draws, at least."""
WORTH = 3.0
"""Rise of chi squared, over that at the ends of an interval, up to which points are kept beyond
these."""
DESCENTS = 6
"""Local searches of a round."""
SETTLED = 0.05
"""Growth of the intervals in a round, over their width, below which they have settled."""


def displacements(
    covariance: Float[np.ndarray, "p p"],
    limits: Float[np.ndarray, " p"],
    generator: np.random.Generator,
) -> Float[np.ndarray, "n p"]:
    """Displacements (n, p) from a minimum at which to test its quadratic model.

    They lie ±1, ±2 and ±4 standard errors along each parameter, where the model predicts the
    smallest chi squared for that value of the parameter, and along each eigenvector of the
    covariance in units of the standard errors; and some are drawn from the covariance, as it is and
    with twice the standard errors. None is longer than the `limits` (p,) in any coordinate.
    """
    errors = np.sqrt(np.diag(covariance))
    axes = [covariance / errors]
    if len(errors) > 1:
        variances, vectors = np.linalg.eigh(covariance / np.outer(errors, errors))
        axes.append(errors[:, None] * vectors * np.sqrt(np.maximum(variances, 0.0)))
    along = np.concatenate([np.multiply.outer(STEPS, row) for axis in axes for row in axis.T])
    normal = generator.standard_normal((DRAWN * len(errors), len(errors))) @ _root(covariance).T
    normal[1::2] *= 2.0
    return within(np.concatenate([along, normal]), limits)


def within(
    offsets: Float[np.ndarray, "n p"], limits: Float[np.ndarray, " p"]
) -> Float[np.ndarray, "m p"]:
    """Offsets (n, p) shortened to the limits (p,); those of no length are left out."""
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(offsets == 0.0, 1.0, limits / np.abs(offsets))
    shortened = offsets * np.minimum(shares.min(axis=1), 1.0)[:, None]
    return shortened[np.abs(shortened).max(axis=1) > 0.0]


def _root(covariance: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p p"]:
    """A root R of a covariance R R^T, which may be singular."""
    errors = np.sqrt(np.diag(covariance))
    variances, vectors = np.linalg.eigh(covariance / np.outer(errors, errors))
    return errors[:, None] * vectors * np.sqrt(np.maximum(variances, 0.0))


@dataclass(frozen=True)
class QuadraticTest:
    """Chi squared at points around a minimum beside what the quadratic model predicts.

    - `predicted`: (n,) rise over the minimum by the model, the square of the distance in standard
      errors.
    - `found`: (n,) rise in runs.
    - `horizon`: s, time of the first sample from which on the rise differs at a tenth of the points
      or more; infinite if the model holds to the end.
    """

    predicted: Float[np.ndarray, " n"]
    found: Float[np.ndarray, " n"]
    horizon: float

    @property
    def differing(self) -> Bool[np.ndarray, " n"]:
        """(n,) whether the rise is not the predicted one, by a factor of 1.5 less or of 2 more."""
        return _differing(self.predicted, self.found)

    @property
    def passed(self) -> bool:
        """Whether the rise is the predicted one at all points."""
        return not self.differing.any()


def _differing(predicted: np.ndarray, found: np.ndarray) -> np.ndarray:
    low, high = predicted / LESS - FLOOR, predicted * MORE + FLOOR
    return ~((found >= low) & (found <= high))


def tested(
    residuals: Float[np.ndarray, "S T"],
    jacobian: Float[np.ndarray, "S T p"],
    offsets: Float[np.ndarray, "n p"],
    moved: Float[np.ndarray, "n S T"],
    times: Float[np.ndarray, " T"],
    near: Bool[np.ndarray, " n"],
) -> QuadraticTest:
    """Compare runs at points around a minimum with the quadratic model.

    **Arguments:** `residuals` of S series at T `times`, s, and their `jacobian` at the minimum;
    `offsets`: of the points; `moved`: the residuals there; `near`: which of the points are so near
    on the scales of the parameters that the motion, and not the scale, bends chi squared there.
    """
    linear = np.einsum("stp,np->nst", jacobian, offsets)
    predicted = np.cumsum((linear**2).sum(axis=1), axis=1)
    found = np.cumsum((moved**2 - residuals**2).sum(axis=1), axis=1)
    # Up to a time before the last, residuals have a slope at the minimum of the whole record.
    slope = np.cumsum(2.0 * (residuals * linear).sum(axis=1), axis=1)
    differing = _differing(predicted, found - slope)[near]
    late = np.flatnonzero(differing.sum(axis=0) >= max(MANY * len(offsets), 1.0))
    return QuadraticTest(
        predicted[:, -1],
        found[:, -1],
        float(times[late[0]]) if late.size else math.inf,
    )


@dataclass(frozen=True)
class LocalMinimum:
    """A minimum that a local search found: coordinates (p,), chi squared, and covariance (p, p)."""

    coordinates: Float[np.ndarray, " p"]
    chi_squared: float
    covariance: Float[np.ndarray, "p p"]


@dataclass(frozen=True)
class Exploration:
    """Points around a minimum, and the minima that local searches found from the lowest of them.

    `points` (n, p) with their `chi_squared` (n,); `rounds` of drawing; `settled`: whether the last
    round widened no interval by more than a twentieth.
    """

    points: Float[np.ndarray, "n p"]
    chi_squared: Float[np.ndarray, " n"]
    minima: tuple[LocalMinimum, ...]
    rounds: int
    settled: bool

    @property
    def lowest(self) -> float:
        """The smallest chi squared of all points and minima."""
        return min(float(self.chi_squared.min()), *(one.chi_squared for one in self.minima))

    def intervals(self) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]:
        """Lower and upper ends (p,) of the 95 % intervals: they hold every point whose chi squared
        is at most 3.84 above the lowest, and the interval of each minimum by its own covariance,
        the narrower the higher that minimum."""
        held = self.chi_squared <= self.lowest + RISE
        lows, highs = [self.points[held]], [self.points[held]]
        for one in self.minima:
            left = RISE - (one.chi_squared - self.lowest)
            if left >= 0.0:
                half = np.sqrt(left * np.diag(one.covariance))
                lows.append((one.coordinates - half)[None])
                highs.append((one.coordinates + half)[None])
        return np.concatenate(lows).min(axis=0), np.concatenate(highs).max(axis=0)


def explore(
    chi_squared: Callable[[Float[np.ndarray, "n p"]], Float[np.ndarray, " n"]],
    descend: Callable[[Float[np.ndarray, " p"]], LocalMinimum],
    minimum: LocalMinimum,
    covariances: Sequence[Float[np.ndarray, "p p"]],
    limits: Float[np.ndarray, " p"],
    number: int,
    rounds: int,
    likely: float,
    generator: np.random.Generator,
) -> Exploration:
    """Search the surroundings of a minimum for all points with a chi squared about as small.

    The first round draws `number` points from normal distributions with the given covariances,
    each with its standard errors once, twice and four times as large. Each further round draws half
    as many among the lowest points so far, and as many again around a minimum that has turned out
    lower. After every round, local searches start from some of
    the lowest points that lie apart from each other and from the minima found before. It ends when
    the intervals have settled and noise explains the lowest chi squared, or after so many rounds.

    **Arguments:** `chi_squared` at points; `descend`: a local search from a point; `limits` (p,):
    how far points may lie from the minimum; `likely`: the largest chi squared that noise explains.
    """
    p = len(minimum.coordinates)
    bounds = minimum.coordinates - limits, minimum.coordinates + limits

    def around(centre: np.ndarray, covariances: Sequence[np.ndarray], count: int) -> np.ndarray:
        roots = [w * _root(one) for one in covariances for w in WIDENINGS]
        normal = generator.standard_normal((count, p))
        offsets = np.stack([roots[k % len(roots)] @ row for k, row in enumerate(normal)])
        return centre + within(offsets, limits)

    fresh = around(minimum.coordinates, covariances, number)
    points, values = minimum.coordinates[None], np.array([minimum.chi_squared])
    minima, best, before = [minimum], minimum, None
    for count in range(1, rounds + 1):
        points = np.concatenate([points, fresh])
        values = np.concatenate([values, chi_squared(fresh)])
        order = np.argsort(values, kind="stable")
        low_enough = int((values <= values.min() + WORTH * RISE).sum())
        kept = points[order[: min(max(KEPT, low_enough), number // 2)]]
        candidates = [x for x in kept if not any(inside(one, x) for one in minima)]
        several = len(candidates) > 1
        chosen = apart(np.array(candidates), DESCENTS) if several else range(len(candidates))
        found = [descend(candidates[k]) for k in chosen]
        now = Exploration(points, values, (*minima, *found), count, True)
        low, high = now.intervals()
        held = [one for one in found if one.chi_squared <= now.lowest + RISE]
        new = [a for a in held if not any(inside(b, a.coordinates) for b in minima)]
        minima += found
        lower = min(minima, key=lambda one: one.chi_squared)
        moved = best.chi_squared - lower.chi_squared
        best = lower
        if before is not None and not new and now.lowest <= likely:
            grown = np.maximum(before[0] - low, high - before[1]) / (high - low)
            if (grown < SETTLED).all():
                return now
        before = low, high
        near = [one.coordinates for one in minima if one.chi_squared <= now.lowest + WORTH * RISE]
        kept = np.concatenate([kept, np.array(near).reshape(-1, p)])
        fresh = among(kept, number // 2, 2 * (p + 1), bounds, generator)
        if moved > RISE or now.lowest > likely:  # the first points lay around another minimum
            again = around(best.coordinates, [best.covariance, *covariances[1:]], number // 2)
            fresh = np.concatenate([fresh, again])
    return replace(now, settled=False)


def inside(minimum: LocalMinimum, point: Float[np.ndarray, " p"]) -> bool:
    """Whether a point is so near a minimum that a search from it would end there."""
    offset = point - minimum.coordinates
    errors = np.sqrt(np.diag(minimum.covariance))
    scaled = minimum.covariance / np.outer(errors, errors)
    return float((offset / errors) @ np.linalg.pinv(scaled) @ (offset / errors)) < 1.0
