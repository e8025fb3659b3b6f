"""Test whether a fit can descend from a wrong guess to the truth, by the length of the record.

The path is the straight line from the guess to the truth, in the parameters' coordinates. If the
misfit of the outputs rises somewhere along this line towards the truth, a local minimum or a ridge
may stop a fit. The slope of the misfit along the path is r^T J d, with the residuals r and their
derivatives J at a point of the path, and the direction d. The slope is a sum over samples: its
cumulative sum is the slope for every length of the record.
"""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

ALL_CORNERS = 3
"""Largest number of parameters for which all corners are tested; for more, eight random ones."""
FLAT = 1e-6
"""Cosine of the angle between residuals and their derivatives below which a path is flat."""


@dataclass(frozen=True)
class WrongGuess:
    """A wrong guess, and the records for which a fit can't descend from it to the truth.

    - `offsets`: (p,) coordinates of the guess minus those of the truth.
    - `blocked`: (T,) whether the misfit rises somewhere on the path to the truth, for the record
      that ends at each of the times.
    - `since`: s, end of the shortest blocked record; infinite if there is none.
    """

    offsets: Float[np.ndarray, " p"]
    blocked: Bool[np.ndarray, " T"]
    since: float


def offsets(uncertainty: Float[np.ndarray, " p"]) -> Iterator[Float[np.ndarray, " p"]]:
    """Yield the offset of each wrong guess from the truth, (p,), in the parameters' coordinates.

    Each parameter is wrong alone, in both directions; then all are wrong together, in all
    combinations of signs for up to three parameters and in eight random ones for more.

    **Arguments:** `uncertainty`: (p,) largest error of each coordinate.
    """
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
    """Return whether the misfit rises towards the truth at a point of a path, (count,).

    Entry k is for the record of the first k + 1 samples. A misfit below the noise doesn't block a
    fit, nor does a flat one: before the first impact the run doesn't depend on the clearance, but
    a longer record does.

    **Arguments:** by output, in units of its noise:

    - `truth`: (count,) values at the truth.
    - `values`: (n,) values at the point. If the run failed early, n < count, and longer records are
      blocked.
    - `slopes`: (n,) derivatives of `values` along the path, away from the truth.
    """
    # A run with a wrong guess may fail early: longer records remain blocked.
    n = min(len(row) for row in values.values())
    residuals = np.stack([values[name][:n] - truth[name][:n] for name in truth])
    along = np.stack([slopes[name][:n] for name in truth])
    slope = np.cumsum((residuals * along).sum(axis=0))
    misfit, size = (np.cumsum((part**2).sum(axis=0)) for part in (residuals, along))
    is_blocked = np.ones(count, bool)
    # Scaled by the norms, the slope is the cosine of an angle: a path is flat by direction, not by
    # size.
    is_blocked[:n] = (slope < -FLAT * np.sqrt(misfit * size)) & (misfit > 1.0)
    return is_blocked
