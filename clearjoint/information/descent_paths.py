"""Whether a fit finds its way from a wrong guess to the truth, by the length of the record.

Between the guess and the truth lies a straight way through the parameters' coordinates. If the
misfit of the outputs grows somewhere along it towards the truth, a local minimum or a ridge may
hold a fit back that follows slopes. The slope of the misfit along the way is r^T J d, with the
residuals r and their derivatives J there and the way d; cumulated over the samples it tells for
every length of the record at once.
"""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

ALL_CORNERS = 3
"""Number of parameters up to which all corners are looked at; of more, eight drawn ones."""
FLAT = 1e-6
"""Cosine of the angle between residuals and their derivatives below which a way is flat."""


@dataclass(frozen=True)
class Guess:
    """A wrong guess, and how long records may be from which a fit finds its way.

    `offsets`: (p,) coordinates less those of the truth. `closed`: (T,) whether the way is closed
    for a record that ends at each of the times. `since`: s, that of the first which is closed;
    infinite if none is.
    """

    offsets: np.ndarray
    closed: np.ndarray
    since: float


def offsets(uncertainty: np.ndarray) -> Iterator[np.ndarray]:
    """Wrong guesses (p,): each parameter alone both ways, and all of them at once."""
    p = len(uncertainty)
    for k in range(p):
        for sign in (1.0, -1.0):
            yield sign * uncertainty * np.eye(p)[k]
    if 1 < p <= ALL_CORNERS:
        for signs in itertools.product((1.0, -1.0), repeat=p):
            yield uncertainty * signs
    elif p > ALL_CORNERS:
        for signs in np.random.default_rng(0).choice((1.0, -1.0), (2**ALL_CORNERS, p)):
            yield uncertainty * signs


def closed(
    truth: Mapping[str, np.ndarray],
    values: Mapping[str, np.ndarray],
    slopes: Mapping[str, np.ndarray],
    count: int,
) -> np.ndarray:
    """(count,) whether the misfit at one place of a way falls away from the truth there, by the
    length of the record. Misfits below the noise don't count, nor do flat ones: before its first
    impact a run knows nothing of the clearance, which a longer record mends.

    **Arguments:** by output, all in units of noise: `truth` (count,) the values wanted, `values`
    (n,) those at the place, `slopes` (n,) their derivatives along the way, away from the truth. The
    run at the place may have failed early, n < count: the way is closed from there on.
    """
    n = min(len(row) for row in values.values())
    residuals = np.stack([values[name][:n] - truth[name][:n] for name in truth])
    along = np.stack([slopes[name][:n] for name in truth])
    slope = np.cumsum((residuals * along).sum(axis=0))
    misfit, size = (np.cumsum((part**2).sum(axis=0)) for part in (residuals, along))
    found = np.ones(count, bool)
    found[:n] = (slope < -FLAT * np.sqrt(misfit * size)) & (misfit > 1.0)
    return found
