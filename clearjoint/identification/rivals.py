"""Several minima of chi squared between which the data can't decide.

Late in a record a small change of parameters moves impacts, so that chi squared has many minima
beside each other, and noise decides which is the lowest. A fit that knows of several says so, and
its confidence intervals cover all of them.
"""

import math
from collections.abc import Sequence
from statistics import NormalDist

import numpy as np
from jaxtyping import Float

from . import goodness_of_fit as statistics
from .residuals import RunMisfit

CONFIDENCE = 0.95
DEVIATIONS = NormalDist().inv_cdf(0.5 + 0.5 * CONFIDENCE)


def intervals(
    best: RunMisfit, others: Sequence[RunMisfit]
) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]:
    """Lower and upper ends (p,) of the coordinates' confidence intervals.

    A parameter's interval holds the values for which chi squared, minimised over the other
    parameters, exceeds that of the best minimum by no more than normal noise allows. Each minimum
    contributes an interval round itself, the narrower the larger its chi squared.
    """
    lows, highs = [], []
    for one in (best, *others):
        left = DEVIATIONS**2 - (one.chi_squared - best.chi_squared)
        if left >= 0.0:
            half = math.sqrt(left) * np.sqrt(np.diag(statistics.parameter_covariance(one.jacobian)))
            lows.append(one.coordinates - half)
            highs.append(one.coordinates + half)
    return np.min(lows, axis=0), np.max(highs, axis=0)


def rivals(best: RunMisfit, others: Sequence[RunMisfit]) -> list[RunMisfit]:
    """Minima whose chi squared noise allows beside the best one's, though they lie outside its own
    interval: each once, the smallest chi squared first."""
    from scipy.special import chdtri

    limit = float(chdtri(len(best.coordinates), 1.0 - CONFIDENCE))
    minima = [best]
    for one in sorted(others, key=lambda other: other.chi_squared):
        if one.chi_squared - best.chi_squared <= limit and all(_apart(k, one) for k in minima):
            minima.append(one)
    return minima[1:]


def _apart(one: RunMisfit, other: RunMisfit) -> bool:
    reach = DEVIATIONS * np.sqrt(np.diag(statistics.parameter_covariance(one.jacobian)))
    return bool(np.any(np.abs(other.coordinates - one.coordinates) > reach))
