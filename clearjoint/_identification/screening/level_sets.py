"""Level sets of chi squared: points that fit about as well as the best, and new points in the set.

A point's curve of chi squared is cumulative over the record: column k is chi squared of all samples
up to the k-th of the T sample times. The level set contains each point whose chi squared exceeds
the smallest by no more than a given excess. It shrinks as more of the record is used.
"""

import numpy as np
from jaxtyping import Float, Int

HALVINGS = 40
"""Number of bisections by which `reached` finds the fraction of its result."""
SPLIT = 1e-12
"""Smallest variance of points along a principal axis, relative to the variances of the coordinates.
Distances along an axis are divided by the square root of the variance."""


def reached(curves: np.ndarray, keep: int, excess: float) -> float:
    """Return the number of sample times up to which the level set has at least `keep` points.

    The number may be a fraction, see `finite_level`. Just beyond it, fewer than `keep` points fit
    about as well as the best; it is T if this happens nowhere.
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
    """Return chi squared over the first `count` times, linearly interpolated for a fractional
    `count`."""
    last_full = min(int(count), curves.shape[1] - 2)
    part = count - last_full
    return (1.0 - part) * curves[:, last_full] + part * curves[:, last_full + 1]


def _gap(values: np.ndarray, keep: int) -> np.ndarray:
    """The `keep`-th smallest value over n points less the smallest."""
    return np.partition(values, keep - 1, axis=0)[keep - 1] - values.min(axis=0)


def far_apart(points: Float[np.ndarray, "n p"], number: int) -> Int[np.ndarray, " k"]:
    """Return indices of at most `number` points that are far apart, beginning with the first.

    The next point is always the one whose distance from the nearest point chosen before is largest.
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
    """Draw new points in the region that two or more points fill.

    Each is drawn from a normal distribution around one of the points, with the covariance of that
    point's `neighbours` nearest points (itself included), so that new points follow a curved or
    disconnected region.
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
    """Distances between points, in standard deviations of all points along their principal axes."""
    sizes = points.std(axis=0)
    scaled = points / np.where(sizes > 0.0, sizes, 1.0)
    variances, axes = np.linalg.eigh(np.atleast_2d(np.cov(scaled.T)))
    principal = scaled @ axes / np.sqrt(np.maximum(variances, SPLIT))
    return np.linalg.norm(principal[:, None] - principal, axis=2)
