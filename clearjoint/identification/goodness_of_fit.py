"""What residuals and their Jacobian tell of estimates. Standard textbook formulas."""

import math
from typing import NamedTuple

import numpy as np
from scipy import stats

SINGULAR = 1e-12
"""Singular value over the largest, of columns of unit length, below which a direction is not seen:
its variance is reported as if it had this one."""
UNLIKELY = 1e-3
"""Probability of chi squared below which noise or model are wrong, or the fit is."""
LAGS = 10
"""Lags of the test of whiteness."""


class Direction(NamedTuple):
    """A combination of parameters: how the coordinates (p,) change along it, the largest by one,
    and the standard deviation of how far."""

    change: np.ndarray
    deviation: float


def directions(jacobian: np.ndarray) -> list[Direction]:
    """Combinations of parameters, the least seen first, from the Jacobian (M, p) of residuals in
    standard deviations."""
    norms = np.linalg.norm(jacobian, axis=0)
    norms = np.where(norms > 0.0, norms, max(norms.max(), 1.0) * SINGULAR)
    _, sizes, axes = np.linalg.svd(jacobian / norms, full_matrices=False)
    sizes = np.maximum(sizes, SINGULAR * max(sizes[0], 1.0))
    found = []
    for size, axis in zip(sizes[::-1], axes[::-1], strict=True):
        along = axis / norms
        largest = along[np.argmax(np.abs(along))]
        found.append(Direction(along / largest, abs(largest) / float(size)))
    return found


def covariance(jacobian: np.ndarray) -> np.ndarray:
    """Covariance (p, p) of the coordinates: the inverse of the Fisher information."""
    rows = [found.deviation * found.change for found in directions(jacobian)]
    return sum(np.outer(row, row) for row in rows) + np.zeros((jacobian.shape[1],) * 2)


def correlation(covariances: np.ndarray) -> np.ndarray:
    """Correlation (p, p) of a covariance."""
    deviations = np.sqrt(np.diag(covariances))
    return covariances / np.outer(deviations, deviations)


def chi_squared_p(chi_squared: float, freedom: int) -> float:
    """Probability of so large a chi squared if noise and model are right; NaN without freedom."""
    return float(stats.chi2.sf(chi_squared, freedom)) if freedom > 0 else math.nan


def whiteness(residuals: np.ndarray) -> float:
    """Probability of so much autocorrelation in white noise; NaN for fewer than 20 residuals.

    G. Ljung and G. Box, *On a measure of lack of fit in time series models* (1978), over 10 lags.
    """
    count = len(residuals)
    spread = float(residuals @ residuals)
    if count < 2 * LAGS or spread == 0.0:
        return math.nan
    lags = np.arange(1, LAGS + 1)
    found = np.array([residuals[lag:] @ residuals[:-lag] for lag in lags]) / spread
    statistic = count * (count + 2) * np.sum(found**2 / (count - lags))
    return float(stats.chi2.sf(statistic, LAGS))


def normality(residuals: np.ndarray) -> float:
    """Probability of such skewness and kurtosis in normal noise; NaN for fewer than 20 residuals.

    R. D'Agostino and E. Pearson, *Tests for departure from normality* (1973).
    """
    if len(residuals) < 2 * LAGS or np.ptp(residuals) == 0.0:
        return math.nan
    return float(stats.normaltest(residuals).pvalue)
