"""Tests of the residuals of a fit, and how sure their Jacobian makes estimates."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..information import fisher_information as information

SINGULAR = 1e-12
"""Least singular value over the largest, with columns of unit length. The data hardly see a
direction that has a smaller one: its variance is reported as if it had this one."""
UNLIKELY = 1e-3
"""Probability of a chi squared below which the noise, the model or the fit is taken as wrong."""
LAGS = 10
"""Lags of the test of whiteness."""


class Direction(NamedTuple):
    """A combination of parameters, as a change of their coordinates.

    `change`: (p,) of the coordinates, the largest by one. `deviation`: standard deviation of the
    factor by which an estimate is off along it.
    """

    change: Float[np.ndarray, " p"]
    deviation: float


def directions(jacobian: Float[np.ndarray, "M p"]) -> list[Direction]:
    """Combinations of parameters, the least seen first, from the Jacobian (M, p) of residuals in
    standard deviations."""
    norms = np.linalg.norm(jacobian, axis=0)
    norms = np.where(norms > 0.0, norms, max(norms.max(), 1.0) * SINGULAR)
    _, sizes, axes = np.linalg.svd(jacobian / norms, full_matrices=False)
    sizes = np.maximum(sizes, SINGULAR * max(sizes[0], 1.0))
    changes = []
    for size, axis in zip(sizes[::-1], axes[::-1], strict=True):
        along = axis / norms
        largest = along[np.argmax(np.abs(along))]
        changes.append(Direction(along / largest, abs(largest) / float(size)))
    return changes


def parameter_covariance(jacobian: Float[np.ndarray, "M p"]) -> Float[np.ndarray, "p p"]:
    """Covariance (p, p) of the coordinates, from the Jacobian (M, p) of residuals in standard
    deviations; large, but finite, for what the data don't see."""
    return information.covariance(jacobian, SINGULAR)


def chi_squared_p(chi_squared: float, degrees_of_freedom: int) -> float:
    """Probability of so large a chi squared if noise and model are right; NaN without freedom."""
    from scipy.special import chdtrc

    return float(chdtrc(degrees_of_freedom, chi_squared)) if degrees_of_freedom > 0 else math.nan


def likely_chi_squared(degrees_of_freedom: int) -> float:
    """The largest chi squared that noise explains; infinite without freedom."""
    from scipy.special import chdtri

    return float(chdtri(degrees_of_freedom, UNLIKELY)) if degrees_of_freedom > 0 else math.inf


def whiteness(residuals: Float[np.ndarray, " M"]) -> float:
    """Probability of so much autocorrelation in white noise; NaN for fewer than 20 residuals.

    G. Ljung and G. Box, *On a measure of lack of fit in time series models* (1978), over 10 lags.
    """
    from scipy.special import chdtrc

    count = len(residuals)
    spread = float(residuals @ residuals)
    if count < 2 * LAGS or spread == 0.0:
        return math.nan
    lags = np.arange(1, LAGS + 1)
    autocorrelations = np.array([residuals[lag:] @ residuals[:-lag] for lag in lags]) / spread
    statistic = count * (count + 2) * np.sum(autocorrelations**2 / (count - lags))
    return float(chdtrc(LAGS, statistic))


def normality(residuals: Float[np.ndarray, " M"]) -> float:
    """Probability of such skewness and kurtosis in normal noise; NaN for fewer than 20 residuals.

    R. D'Agostino and E. Pearson, *Tests for departure from normality* (1973).
    """
    from scipy.stats import normaltest

    if len(residuals) < 2 * LAGS or np.ptp(residuals) == 0.0:
        return math.nan
    return float(normaltest(residuals).pvalue)
