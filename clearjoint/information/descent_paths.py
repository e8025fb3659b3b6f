"""Whether a fit can descend from a wrong guess to the truth, by the length of the record.

The path looked at is the straight line from the guess to the truth, in the parameters' coordinates.
If the misfit of the outputs rises somewhere along it towards the truth, a local minimum or a ridge
may hold a fit back, since fits follow slopes. The slope of the misfit along the path is r^T J d,
with the residuals r and their derivatives J at a place of the path, and its direction d. A sum over
samples, it is cumulated over them, and so known for every length of the record at once.
"""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

ALL_CORNERS = 3
"""Number of parameters up to which all corners are looked at; of more, eight drawn ones."""
FLAT = 1e-6
"""Cosine of the angle between residuals and their derivatives below which a path is flat."""


@dataclass(frozen=True)
class WrongGuess:
    """A guess off the truth, and the records with which a fit can't descend from it to the truth.

    - `offsets`: (p,) coordinates of the guess less those of the truth.
    - `blocked`: (T,) whether the misfit rises somewhere on the path to the truth, for the record
      that ends at each of the times.
    - `since`: s, the end of the shortest record that is blocked; infinite if none is.
    """

    offsets: Float[np.ndarray, " p"]
    blocked: Bool[np.ndarray, " T"]
    since: float


def offsets(uncertainty: Float[np.ndarray, " p"]) -> Iterator[Float[np.ndarray, " p"]]:
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


def blocked(
    truth: Mapping[str, np.ndarray],
    values: Mapping[str, np.ndarray],
    slopes: Mapping[str, np.ndarray],
    count: int,
) -> np.ndarray:
    """Whether the misfit rises towards the truth at one place of a path, (count,) by the length of
    the record.

    A misfit below the noise blocks nothing, nor does a flat one: before its first impact a run
    knows nothing of the clearance, and a longer record does.

    **Arguments:** by output, in units of its noise:

    - `truth`: (count,) values at the truth.
    - `values`: (n,) values at the place. If the run there failed early, n < count, and longer
      records are blocked.
    - `slopes`: (n,) derivatives of `values` along the path, away from the truth.
    """
    n = min(len(row) for row in values.values())
    residuals = np.stack([values[name][:n] - truth[name][:n] for name in truth])
    along = np.stack([slopes[name][:n] for name in truth])
    slope = np.cumsum((residuals * along).sum(axis=0))
    misfit, size = (np.cumsum((part**2).sum(axis=0)) for part in (residuals, along))
    is_blocked = np.ones(count, bool)
    is_blocked[:n] = (slope < -FLAT * np.sqrt(misfit * size)) & (misfit > 1.0)
    return is_blocked
