"""Statistics of a fit: tests of its residuals, uncertain directions, and competing minima."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .._information.fisher_information import floored
from .residuals import RunMisfit

UNLIKELY = 1e-3
"""p-value of chi squared below which the noise, the model or the fit is considered wrong."""
LAGS = 10
"""Number of lags, in samples, whose autocorrelations enter the test of whiteness."""
CONFIDENCE = 0.95
"""Level of confidence intervals."""
DEVIATIONS = NormalDist().inv_cdf(0.5 + 0.5 * CONFIDENCE)
"""Half the width of a confidence interval in standard deviations."""
RISE = DEVIATIONS**2
"""Rise of chi squared over its minimum at the ends of a 95 % interval of one parameter, 3.84."""

FEWEST_FREEDOM = 2.0
"""Smallest number of degrees of freedom in `student_factor`, which replaces smaller numbers."""


class Direction(NamedTuple):
    """A direction in the coordinates, and the uncertainty of estimates along it.

    - `change`: (p,) change of the coordinates; the entry with the largest absolute value is 1.
    - `deviation`: standard deviation of the estimates, in multiples of `change`.
    """

    change: Float[np.ndarray, " p"]
    deviation: float


def directions(jacobian: Float[np.ndarray, "M p"]) -> list[Direction]:
    """Return p directions along which the errors of the estimates are independent.

    The directions are the principal axes of these errors in scaled coordinates: the unit of each
    coordinate is the standard error that its parameter would have if all others were known. The
    axes are sorted by the error in these units, the largest first; `Direction.deviation` is not in
    these units and need not decrease. If `jacobian` is that of M < p residuals there are only M
    directions. A direction without effect on the residuals gets a very large, finite deviation.
    """
    norms, singular_values, axes = floored(jacobian)
    found = []
    # The largest errors are those of the smallest singular values, which come last.
    for singular_value, axis in zip(singular_values[::-1], axes[::-1], strict=True):
        change = axis / norms  # From scaled coordinates, whose unit is 1 / norm.
        largest = change[np.argmax(np.abs(change))]
        # The standard deviation along the unit vector `axis` is 1 / singular value.
        found.append(Direction(change / largest, abs(largest) / float(singular_value)))
    return found


def chi_squared_p(chi_squared: float, degrees_of_freedom: int) -> float:
    """Return the probability that noise alone gives more; NaN without degrees of freedom."""
    from scipy.special import chdtrc

    return float(chdtrc(degrees_of_freedom, chi_squared)) if degrees_of_freedom > 0 else math.nan


def chi_squared_exceeded(probability: float, degrees_of_freedom: int) -> float:
    """Return the chi squared that noise alone exceeds with a `probability`; infinite without
    degrees of freedom."""
    from scipy.special import chdtri

    return float(chdtri(degrees_of_freedom, probability)) if degrees_of_freedom > 0 else math.inf


def whiteness(residuals: Float[np.ndarray, " M"]) -> float:
    """Return the p-value of the Ljung-Box test (1978) for whiteness of residuals, with the first 10
    autocorrelations; NaN for M < 20, and if all residuals are zero."""
    from scipy.special import chdtrc

    count = len(residuals)
    spread = float(residuals @ residuals)
    if count < 2 * LAGS or spread == 0.0:
        return math.nan
    lags = np.arange(1, LAGS + 1)
    autocorrelations = np.array([residuals[lag:] @ residuals[:-lag] for lag in lags]) / spread
    statistic = count * (count + 2) * np.sum(autocorrelations**2 / (count - lags))
    return float(chdtrc(LAGS, statistic))


@dataclass(frozen=True)
class CorrelatedNoise:
    """Stationary noise of M samples at equal intervals. `autocovariances` are those of two samples
    that are 0 to M - 1 intervals apart."""

    autocovariances: Float[np.ndarray, " M"]

    @property
    def variance(self) -> float:
        return float(self.autocovariances[0])

    @property
    def effective(self) -> float:
        """Number of independent samples that tell the variance as accurately as these M samples."""
        # For normal noise, correlation multiplies the variance of an estimated variance by one plus
        # twice the sum of the squared autocorrelations (M. Bartlett).
        autocorrelations = self.autocovariances[1:] / self.autocovariances[0]
        count = len(self.autocovariances)
        return float(count) / (1.0 + 2.0 * float(np.sum(autocorrelations**2)))

    def gradient_covariance(self, rows: Float[np.ndarray, "M p"]) -> Float[np.ndarray, "p p"]:
        """Return J^T R J, J = `rows`: the covariance of a fit's gradient J^T r, if that of the
        residuals r is R, (M, M)."""
        from scipy.linalg import matmul_toeplitz

        return rows.T @ matmul_toeplitz(self.autocovariances, rows)


def correlated_noise(residuals: Float[np.ndarray, " M"]) -> CorrelatedNoise:
    """Return an autoregressive process, fitted by Burg's method to residuals that are not all zero.

    The order of the process, its number of coefficients, minimises Akaike's corrected criterion (C.
    Hurvich and C. Tsai, *Regression and time series model selection in small samples*, 1989).
    """
    count = len(residuals)
    # Errors of predicting each sample from those before it, and from those after it.
    forward = backward = residuals
    weights = np.ones(1)  # x_k + w_1 x_(k-1) + ... is the part that cannot be predicted.
    variance = float(residuals @ residuals) / count  # of this part
    estimated = [variance]  # Autocovariances from lag 0 on.
    best, least = (weights, 1), math.inf
    # The largest order is the usual 10 log10(M), or M/4 for short records.
    for order in range(min(int(10.0 * math.log10(count)), count // 4) + 1):
        criterion = count * math.log(variance) + count * (count + order) / (count - order - 2)
        if criterion < least:
            best, least = (weights, order + 1), criterion
        # From here on, everything is raised to the next order by Levinson's recursion. Pairs of
        # errors one lag farther apart determine the reflection coefficient.
        forward, backward = forward[1:], backward[:-1]
        squares = float(forward @ forward + backward @ backward)
        if squares == 0.0:  # The prediction is exact, so no higher order is better.
            break
        reflection = -2.0 * float(forward @ backward) / squares
        # The earlier autocovariances, without lag 0, in reverse order: from the largest lag down.
        estimated.append(-reflection * variance - float(weights[1:] @ np.array(estimated[:0:-1])))
        padded = np.append(weights, 0.0)
        weights = padded + reflection * padded[::-1]
        forward, backward = forward + reflection * backward, backward + reflection * forward
        variance *= max(1.0 - reflection**2, np.finfo(float).eps)
    weights, known = best
    autocovariances = np.zeros(count)
    autocovariances[:known] = estimated[:known]
    # At larger lags, each autocovariance follows from those before it (Yule-Walker equations). That
    # of white noise, with one known autocovariance, is zero.
    if known > 1:
        for lag in range(known, count):
            autocovariances[lag] = -weights[1:] @ autocovariances[lag - 1 : lag - known : -1]
    return CorrelatedNoise(autocovariances)


def student_factor(effective: float) -> float:
    """Return the ratio of the widths of 95 % intervals by Student's distribution and by the normal
    distribution. The degrees of freedom are the `effective` number of independent samples from
    which the variance is estimated, but at least `FEWEST_FREEDOM`."""
    from scipy.special import stdtrit

    return float(stdtrit(max(effective, FEWEST_FREEDOM), 0.5 + 0.5 * CONFIDENCE)) / DEVIATIONS


def normality(residuals: Float[np.ndarray, " M"]) -> float:
    """Return the p-value of the test for normality, by skewness and kurtosis, of R. D'Agostino and
    E. Pearson, *Tests for departure from normality* (1973); NaN for M < 20 or equal residuals."""
    from scipy.stats import normaltest

    if len(residuals) < 2 * LAGS or np.ptp(residuals) == 0.0:
        return math.nan
    return float(normaltest(residuals).pvalue)


def competing_minima(best: RunMisfit, others: Sequence[RunMisfit]) -> list[RunMisfit]:
    """Return those of the `others` that fit the data about as well as the `best` minimum of chi
    squared, the lowest first, without minima near a lower one. `Fit.rivals` has the conditions."""
    rise = chi_squared_exceeded(1.0 - CONFIDENCE, len(best.coordinates))
    # Without the first, the best minimum itself.
    return distinct([best, *others], best.chi_squared + rise, _apart)[1:]


def distinct(
    minima: Iterable[RunMisfit], limit: float, apart: Callable[[RunMisfit, RunMisfit], bool]
) -> list[RunMisfit]:
    """Return the minima with a chi squared up to `limit`, the lowest first. A minimum is left out
    unless ``apart(lower, minimum)`` is true for every lower one that is returned."""
    chosen: list[RunMisfit] = []
    for minimum in sorted(minima, key=lambda minimum: minimum.chi_squared):
        if minimum.chi_squared <= limit and all(apart(lower, minimum) for lower in chosen):
            chosen.append(minimum)
    return chosen


def _apart(lower: RunMisfit, other: RunMisfit) -> bool:
    """Whether `other` is outside the 95 % interval of at least one parameter around `lower`."""
    half = DEVIATIONS * np.sqrt(np.diag(lower.covariance))
    return bool(np.any(np.abs(other.coordinates - lower.coordinates) > half))
