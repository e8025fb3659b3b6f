"""Level sets of chi squared: points that fit about as well as the best, and new points in the set.

A point is the coordinates of p parameters. Its curve of chi squared is cumulative over the record:
chi squared over the first k times is that of all samples up to the k-th of the T sample times.
The level set of several points contains each point whose chi squared exceeds the smallest by no
more than a given excess. It shrinks as more of the record is used.
"""

import numpy as np
from jaxtyping import Float, Int

HALVINGS = 40
"""Number of bisections by which `reached` finds the fraction of its result."""
SPLIT = 1e-12
"""Smallest variance of points along a principal axis, relative to the variances of the coordinates.
Smaller variances are raised to this limit, because distances along an axis are divided by the
square root of the variance."""


def reached(curves: np.ndarray, keep: int, excess: float) -> float:
    """Return the number of sample times up to which the level set has at least `keep` points.

    The number, from 0 to T, may be a fraction, see `finite_level`. Just beyond it, fewer than
    `keep` points fit about as well as the best; it is T if this happens nowhere.

    **Arguments:** `curves`: (n, T + 1) chi squared of n points, cumulated over the first 0 to T
    sample times; `keep`: a number of points, at most n; `excess`: largest difference between chi
    squared of a point in the set and the smallest chi squared.
    """
    last = curves.shape[1] - 1
    beyond = np.flatnonzero(_gap(curves, keep) > excess)
    if not beyond.size:
        return float(last)
    # Somewhere between this number of times and the next, the gap begins to exceed the excess.
    last_full, low, high = int(beyond[0]) - 1, 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if _gap(finite_level(curves, last_full + middle), keep) > excess:
            high = middle
        else:
            low = middle
    return last_full + low


def finite_level(curves: Float[np.ndarray, "n T"], count: float) -> Float[np.ndarray, " n"]:
    """Return chi squared of n points, (n,), over the first `count` times.

    `curves`: (n, T + 1) chi squared over the first 0 to T times, all finite; values at a fractional
    `count` are interpolated linearly.
    """
    last_full = min(int(count), curves.shape[1] - 2)
    part = count - last_full
    return (1.0 - part) * curves[:, last_full] + part * curves[:, last_full + 1]


def _gap(values: np.ndarray, keep: int) -> np.ndarray:
    """Return the `keep`-th smallest value over n points less the smallest value, (...).

    If this difference is at most the excess of a level set, at least `keep` points are in the set.

    **Arguments:** `values`: (n, ...) chi squared of n points.
    """
    return np.partition(values, keep - 1, axis=0)[keep - 1] - values.min(axis=0)


def far_apart(points: Float[np.ndarray, "n p"], number: int) -> Int[np.ndarray, " k"]:
    """Return indices (k,) of at most `number` points that are far apart, beginning with the first.

    The next point is always the one whose distance from the nearest point chosen before is largest.
    Distances are in standard deviations of all points (n, p), n > 1, along their principal axes.
    """
    distances = _principal_distances(points)
    chosen = [0]
    while len(chosen) < min(number, len(points)):
        chosen.append(int(distances[chosen].min(axis=0).argmax()))
    return np.array(chosen)


def drawn_among(
    points: Float[np.ndarray, "n p"],
    number: int,
    neighbours: int,
    bounds: tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]],
    generator: np.random.Generator,
) -> Float[np.ndarray, "new p"]:
    """Draw new points (number, p) in the region that the points (n, p) fill.

    Each is drawn from a normal distribution around one of the points, with the covariance of that
    point's `neighbours` nearest points, so that new points follow a curved or disconnected region.
    New points beyond the `bounds`, low (p,) and high (p,), are reflected at them; very distant ones
    are put on a bound.

    **Arguments:** `points`: two or more; `number`: number of new points; `neighbours`: number of
    neighbours including the point itself, two or more.
    """
    neighbours = min(neighbours, len(points))
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


def _principal_distances(points: Float[np.ndarray, "n p"]) -> Float[np.ndarray, "n n"]:
    """Return the distances (n, n) between points (n, p).

    They are in standard deviations of all points along their principal axes.
    """
    sizes = points.std(axis=0)
    scaled = points / np.where(sizes > 0.0, sizes, 1.0)
    variances, axes = np.linalg.eigh(np.atleast_2d(np.cov(scaled.T)))
    principal = scaled @ axes / np.sqrt(np.maximum(variances, SPLIT))
    return np.linalg.norm(principal[:, None] - principal, axis=2)
