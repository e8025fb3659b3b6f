"""Separate minima of chi squared, the modes of a posterior, found from its points."""

import numpy as np
from jaxtyping import Float, Int

RISE = 3.84
"""Smallest rise of chi squared between two minima that count as separate: the rise at the ends of a
95 % interval of one parameter."""
NEAREST = 10
"""Smallest number of nearest points that are the neighbours of a point."""
SMALLEST = 0.01
"""Share of the points below which a mode joins the nearest larger one."""


def modes(
    points: Float[np.ndarray, "n p"], chi_squared: Float[np.ndarray, " n"]
) -> Int[np.ndarray, " n"]:
    """Return for each point the number of its mode, (n,), from 0 for that with the most points.

    A mode is a group of points around one minimum of chi squared. The neighbours of a point are the
    ten points nearest to it, or four for each parameter if that is more. From the lowest chi
    squared upwards, each point joins a group of its neighbours, that with the lowest minimum, or
    begins a new one. Other groups of its neighbours join it too if chi squared rises by less than
    3.84 from their minimum to this point (F. Chazal et al., *Persistence-based clustering in
    Riemannian manifolds*, 2013). A minimum with fewer points than neighbours may not be found.

    **Arguments:** `points`: (n, p) coordinates, some of which may be equal; `chi_squared`: (n,) at
    the points.
    """
    # Resampling has made copies of points, which would take the places of neighbours.
    distinct, first, copies = np.unique(points, axis=0, return_index=True, return_inverse=True)
    values, number = chi_squared[first], len(distinct)
    distances = _distances(distinct)
    near = np.argsort(distances, axis=1, kind="stable")[:, : max(NEAREST, 4 * points.shape[1]) + 1]
    neighbour = np.zeros((number, number), bool)
    np.put_along_axis(neighbour, near, True, axis=1)
    neighbour |= neighbour.T  # Two points are neighbours if either is near the other.
    group = np.full(number, -1)  # Index of the lowest point of each point's group.
    for point in np.argsort(values, kind="stable"):
        # Groups of the neighbours with a lower chi squared; the others have no group yet, index -1.
        around = {int(one) for one in group[neighbour[point]] if one >= 0}
        if not around:
            group[point] = point
            continue
        lowest = min(around, key=lambda one: values[one])
        group[point] = lowest
        for other in around - {lowest}:
            if values[point] - values[other] < RISE:
                group[group == other] = lowest
    # Groups with few points join the group of the nearest point in a large one. The largest group
    # is large even if all are small.
    # Some versions of NumPy return the inverse of `unique` as a column, hence `ravel`.
    sizes = np.bincount(group[copies.ravel()], minlength=number)
    large = sizes >= min(SMALLEST * len(points), sizes.max())
    for small in np.flatnonzero((sizes > 0) & ~large):
        members = group == small
        others = large[group]
        closest = np.where(others, distances[members].min(axis=0), np.inf).argmin()
        group[members] = group[closest]
    # Numbers of the modes, in the order of their number of points.
    found, numbers, sizes = np.unique(
        group[copies.ravel()], return_inverse=True, return_counts=True
    )
    rank = np.empty(len(found), int)
    rank[np.argsort(-sizes, kind="stable")] = np.arange(len(found))
    return rank[numbers.ravel()]


def _distances(points: Float[np.ndarray, "n p"]) -> Float[np.ndarray, "n n"]:
    """Return distances (n, n) between points (n, p), with coordinates in their standard
    deviations."""
    sizes = points.std(axis=0)
    scaled = points / np.where(sizes > 0.0, sizes, 1.0)
    return np.linalg.norm(scaled[:, None] - scaled, axis=2)
