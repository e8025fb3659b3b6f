"""Minima of chi squared that the data do not tell apart.

Late in a record a small change of parameters moves impacts, and chi squared has minima beside each
other. Noise decides which is the lowest. So a fit that knows of several has to say so, and its
intervals have to hold all of them.
"""

import math
from collections.abc import Sequence

import numpy as np
from scipy import stats

from . import goodness_of_fit as statistics
from .residuals import Evaluated

CONFIDENCE = 0.95
DEVIATIONS = float(stats.norm.ppf(0.5 + 0.5 * CONFIDENCE))


def intervals(best: Evaluated, others: Sequence[Evaluated]) -> tuple[np.ndarray, np.ndarray]:
    """Ends (p,) of the intervals of confidence of coordinates.

    Of one minimum, as of a normal distribution. A parameter's interval is where the least chi
    squared is no more than that allows above the best; so further minima add theirs, the narrower
    the higher they are.
    """
    lows, highs = [], []
    for one in (best, *others):
        left = DEVIATIONS**2 - (one.chi_squared - best.chi_squared)
        if left >= 0.0:
            half = math.sqrt(left) * np.sqrt(np.diag(statistics.covariance(one.jacobian)))
            lows.append(one.coordinates - half)
            highs.append(one.coordinates + half)
    return np.min(lows, axis=0), np.max(highs, axis=0)


def rivals(best: Evaluated, others: Sequence[Evaluated]) -> list[Evaluated]:
    """Minima that the data do not tell from the best, though it excludes them by its own interval,
    the lowest first; each once."""
    allowed = float(stats.chi2.ppf(CONFIDENCE, len(best.coordinates)))
    found = [best]
    for one in sorted(others, key=lambda other: other.chi_squared):
        if one.chi_squared - best.chi_squared <= allowed and all(_apart(k, one) for k in found):
            found.append(one)
    return found[1:]


def _apart(one: Evaluated, other: Evaluated) -> bool:
    reach = DEVIATIONS * np.sqrt(np.diag(statistics.covariance(one.jacobian)))
    return bool(np.any(np.abs(other.coordinates - one.coordinates) > reach))
