"""Points that data do not tell from the best one, and new points among them.

A chi squared that is cumulated over the record sets a level for every part of it. As the part
grows, the set of the points within a given excess of the best shrinks.
"""

import numpy as np
from jaxtyping import Float, Int

HALVINGS = 40
SPLIT = 1e-12
"""Smallest variance, over those of the coordinates, that counts as any."""


def reached(curves: np.ndarray, keep: int, excess: float) -> float:
    """Number of times, with a part of the last, up to which at least `keep` of the points have a
    chi squared at most `excess` above the best, from its curves (n, T + 1) at 0 to T times."""
    last = curves.shape[1] - 1
    beyond = np.flatnonzero(_gap(curves, keep) > excess)
    if not beyond.size:
        return float(last)
    whole, low, high = int(beyond[0]) - 1, 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if _gap(level(curves, whole + middle), keep) > excess:
            high = middle
        else:
            low = middle
    return whole + low


def level(curves: Float[np.ndarray, "n T"], count: float) -> Float[np.ndarray, " n"]:
    """Chi squared (n,) at a number of times, linear within one."""
    whole = min(int(count), curves.shape[1] - 2)
    part = count - whole
    return (1.0 - part) * curves[:, whole] + part * curves[:, whole + 1]


def _gap(values: np.ndarray, keep: int) -> np.ndarray:
    """The `keep`-th smallest along the first axis, less the smallest."""
    return np.partition(values, keep - 1, axis=0)[keep - 1] - values.min(axis=0)


def apart(points: Float[np.ndarray, "n p"], number: int) -> Int[np.ndarray, " k"]:
    """Indices of the first of the points (n, p) and of others, each as far as possible from those
    before, in standard deviations of all."""
    distances = _distances(points)
    chosen = [0]
    while len(chosen) < min(number, len(points)):
        chosen.append(int(distances[chosen].min(axis=0).argmax()))
    return np.array(chosen)


def among(
    points: Float[np.ndarray, "n p"],
    number: int,
    neighbours: int,
    bounds: tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]],
    generator: np.random.Generator,
) -> Float[np.ndarray, "new p"]:
    """New points (number, p): each drawn from a normal distribution round one of the points (n, p),
    with the covariance of its neighbours, and reflected at the bounds (p,).

    So they follow a set that is curved, or in pieces.
    """
    neighbours = min(neighbours, len(points))
    near = np.argsort(_distances(points), axis=1)[:, :neighbours]
    around = generator.integers(0, len(points), number)
    cloud = points[near[around]]
    offsets = cloud - cloud.mean(axis=1, keepdims=True)
    weights = generator.standard_normal((number, cloud.shape[1], 1)) / np.sqrt(neighbours - 1)
    normal = points[around] + (weights * offsets).sum(axis=1)
    low, high = bounds
    reflected = high - np.abs(high - (low + np.abs(normal - low)))
    return np.clip(reflected, low, high)


def _distances(points: Float[np.ndarray, "n p"]) -> Float[np.ndarray, "n n"]:
    """Distances (n, n) of points (n, p), in standard deviations."""
    sizes = points.std(axis=0)
    scaled = points / np.where(sizes > 0.0, sizes, 1.0)
    variances, axes = np.linalg.eigh(np.atleast_2d(np.cov(scaled.T)))
    principal = scaled @ axes / np.sqrt(np.maximum(variances, SPLIT))
    return np.linalg.norm(principal[:, None] - principal, axis=2)
