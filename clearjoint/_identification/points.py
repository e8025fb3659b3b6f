"""Points and their curves of chi squared, for screenings, explorations and posteriors.

A curve of chi squared is cumulative over the record: column k is chi squared of all samples up to
the k-th of the T sample times, and column 0 is zero.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int
from numpy.random import Generator

Point = Float[np.ndarray, " p"]
"""Coordinates of all p parameters, or another number for each of them."""
Points = Float[np.ndarray, "n p"]
Box = tuple[Point, Point]
"""Lower end and upper end of each coordinate."""
Covariance = Float[np.ndarray, "p p"]
"""Covariance of the coordinates."""
NEIGHBOURS = 2
"""New points around a point are drawn with the covariance of this multiple of p + 1 nearest points.
A covariance of p coordinates needs at least p + 1 points; more points make it less random."""
SPLIT = 1e-12
"""Smallest variance along a principal axis of points whose coordinates are scaled to unit variance;
smaller ones are replaced by it, so that its square root can divide distances."""


def filled(
    low: Point, high: Point, number: int, generator: Generator
) -> Float[np.ndarray, "{number} p"]:
    """Return `number` points that fill the box from `low` to `high` evenly, a Latin hypercube."""
    from scipy.stats import qmc

    return low + (high - low) * qmc.LatinHypercube(len(low), rng=generator).random(number)


def chi_squared_over(curves: Float[np.ndarray, "n T"], count: float) -> Float[np.ndarray, " n"]:
    """Return chi squared over the first `count` times, from the curves of n points. If `count` is
    not whole, its fraction multiplies the rise of chi squared at the next time. The result is
    infinite for a run that misses a sample at one of the times used."""
    full = min(int(count), curves.shape[1] - 1)
    part = count - full
    if part == 0.0:
        return curves[:, full]
    with np.errstate(invalid="ignore"):  # Infinity less infinity, after a run has failed.
        rise = part * (curves[:, full + 1] - curves[:, full])
    return np.where(np.isinf(curves[:, full + 1]), np.inf, curves[:, full] + rise)


def last_where(holds: Callable[[float], bool], low: float, high: float) -> float:
    """Return, by bisection, the last float at which the condition `holds` is true. The condition is
    true at `low`, false at `high`, and changes once between them."""
    # Until no float is between the ends: a step of a posterior may be as short as 1e-30, because
    # the logarithm of a prior that is 1e15 times narrower than the box varies by 1e30 over the box.
    while low < (middle := 0.5 * (low + high)) < high:
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def reached(curves: np.ndarray, keep: int, excess: float) -> float:
    """Return the largest number of sample times over which at least `keep` of the points with these
    `curves`, (n, T), have a chi squared at most `excess` above the smallest. The number may have a
    fraction, at which `chi_squared_over` interpolates."""

    def gap(values: np.ndarray) -> np.ndarray:
        # By how much the `keep`-th smallest chi squared exceeds the smallest.
        return np.partition(values, keep - 1, axis=0)[keep - 1] - values.min(axis=0)

    beyond = np.flatnonzero(gap(curves) > excess)
    if not beyond.size:
        return float(curves.shape[1] - 1)

    def fits(count: float) -> bool:
        return bool(gap(chi_squared_over(curves, count)) <= excess)

    return last_where(fits, float(beyond[0]) - 1.0, float(beyond[0]))


def far_apart(points: Points, number: int) -> Int[np.ndarray, " k"]:
    """Return indices of at most `number` points that are far apart: the first point, then, one by
    one, the point whose distance from the nearest chosen point is largest."""
    distances = _principal_distances(points)
    chosen = [0]
    while len(chosen) < min(number, len(points)):
        chosen.append(int(distances[chosen].min(axis=0).argmax()))
    return np.array(chosen)


def drawn_among(
    points: Points, number: int, bounds: Box, generator: Generator
) -> Float[np.ndarray, "new p"]:
    """Draw `number` new points in the region that two or more points fill.

    Each new point is drawn from a normal distribution around one of the points, with the covariance
    of the points nearest to this one, so that new points follow a curved or disconnected region.
    New points outside the `bounds` are reflected at them.
    """
    neighbours = min(NEIGHBOURS * (points.shape[1] + 1), len(points))
    near = np.argsort(_principal_distances(points), axis=1)[:, :neighbours]
    around = generator.integers(0, len(points), number)
    cloud = points[near[around]]
    offsets = cloud - cloud.mean(axis=1, keepdims=True)
    # A sum of the neighbours' offsets with these weights has their covariance, without a matrix.
    weights = generator.standard_normal((number, cloud.shape[1], 1)) / np.sqrt(neighbours - 1)
    normal = points[around] + (weights * offsets).sum(axis=1)
    low, high = bounds
    # Reflected at the lower bound, then at the upper one; very distant points stay at a bound.
    reflected = high - np.abs(high - (low + np.abs(normal - low)))
    return np.clip(reflected, low, high)


def _principal_distances(points: Points) -> Float[np.ndarray, "n n"]:
    """Return the distances between points that are scaled to unit variance on principal axes."""
    sizes = points.std(axis=0)
    scaled = points / np.where(sizes > 0.0, sizes, 1.0)
    variances, axes = np.linalg.eigh(np.atleast_2d(np.cov(scaled.T)))
    principal = scaled @ axes / np.sqrt(np.maximum(variances, SPLIT))
    return np.linalg.norm(principal[:, None] - principal, axis=2)
