"""Fisher information of independent samples with normal noise about p parameters.

The information is F = J^T J, with the derivatives J (N, p) of N samples, divided by the standard
deviations of their noise. The inverse of F bounds the covariance of every unbiased estimate (Cramér
and Rao), and it is the covariance of least squares for small noise. Computing F would lose half of
the digits, and with them combinations that the data hardly determine. Most functions here therefore
take a root R (r, p) with R^T R = F, such as J itself or the result (p, p) of `root_of`, or a stack
of roots, (..., r, p). `accuracy` is the relative error of the derivatives.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

SMALL_WEIGHT, SMALL_SHARE = 0.02, 0.1
"""The description of a combination omits parameters whose weight has less than `SMALL_WEIGHT` times
the largest magnitude, unless the combination causes more than `SMALL_SHARE` of their variance."""
LEAST_SINGULAR_VALUE = 1e-12
"""Singular values of derivatives, with columns scaled to unit length, are raised to at least this
multiple of the largest, so that the variance of an undetermined combination is finite."""


def root_of(rows: Float[np.ndarray, "N p"]) -> Float[np.ndarray, "p p"]:
    """Return the root (p, p) of the information, by a QR decomposition of another root, `rows`."""
    # With p rows of zeros, the root has p rows also if there are fewer samples than parameters.
    p = rows.shape[1]
    return np.asarray(np.linalg.qr(np.concatenate([np.zeros((p, p)), rows]), mode="r"))


def deviations_together(
    roots: Float[np.ndarray, "*T r p"], accuracy: float
) -> Float[np.ndarray, "*T p"]:
    """Return lower bounds of the parameters' standard deviations if all are estimated.

    A combination of parameters is undetermined if its singular value is at most `accuracy` times
    the largest one, with the columns of the root scaled to unit length. The bound is infinite for a
    parameter whose component in the right singular vector of an undetermined combination has a
    magnitude above the square root of `accuracy`.
    """
    return np.linalg.norm(_parts_together(roots, accuracy), axis=-2)


def correlation_together(
    root: Float[np.ndarray, "p p"], accuracy: float
) -> Float[np.ndarray, "p p"]:
    """Return the correlations of the parameters' estimates if all are estimated; NaN for a
    parameter with an infinite bound in `deviations_together`."""
    parts = _parts_together(root, accuracy)
    determined_parts = np.where(np.isinf(parts).any(axis=0), np.nan, parts)
    # The covariance is the sum over the singular directions, along the first axis.
    return correlation(determined_parts.T @ determined_parts)


def _parts_together(
    roots: Float[np.ndarray, "*T r p"], accuracy: float
) -> Float[np.ndarray, "*T k p"]:
    """Contributions of the k singular directions of each root to the p bounds that
    `deviations_together` returns for the same arguments: each bound is their norm."""
    # Columns of unit length make the test independent of the units of the parameters.
    lengths, values, directions = _equilibrated(roots)
    negligible = _negligible(values, accuracy)[..., None]
    # A parameter is undetermined only if its component in an undetermined direction exceeds the
    # error of that direction. Other parameters have finite bounds, from the determined directions.
    parts = directions / np.where(negligible, 1.0, values[..., None])
    undetermined = np.where(np.abs(directions) > np.sqrt(accuracy), np.inf, 0.0)
    parts = np.where(negligible, undetermined, parts)
    return parts / np.where(lengths > 0.0, lengths, 1.0)[..., None, :]


def rank(roots: Float[np.ndarray, "*T r p"], accuracy: float) -> np.ndarray:
    """Return, for each root, the number of independent combinations of parameters that the data
    determine: those whose singular value is above `accuracy` times the largest."""
    return (~_negligible(_equilibrated(roots)[1], accuracy)).sum(axis=-1)


def condition(roots: Float[np.ndarray, "*T r p"]) -> np.ndarray:
    """Return the condition number of each root with columns of unit length; infinite or, by
    rounding, very large for a singular root, and NaN if the root is zero."""
    values = _equilibrated(roots)[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        return values[..., 0] / values[..., -1]


def covariance(rows: Float[np.ndarray, "N p"]) -> Float[np.ndarray, "p p"]:
    """Return the covariance of the parameters' estimates, the inverse of F with a root `rows`."""
    lengths, values, directions = floored(rows)
    # F = R^T R with R = diag(values) directions diag(lengths), where `directions` is orthogonal.
    # The inverse of F is therefore H^T H, with H = diag(1 / values) directions diag(1 / lengths).
    inverse_root = (directions / values[:, None]) / lengths
    return inverse_root.T @ inverse_root


def floored(
    rows: Float[np.ndarray, "N p"],
) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " k"], Float[np.ndarray, "k p"]]:
    """Return the column norms of `rows` and, after scaling the columns to unit length, the singular
    values and the right singular vectors. Norms and singular values can be divisors.

    Singular values are raised to at least `LEAST_SINGULAR_VALUE` times the larger of 1 and the
    largest of them. A norm of zero is replaced by `LEAST_SINGULAR_VALUE` times the larger of 1 and
    the largest norm.
    """
    lengths, values, directions = _equilibrated(rows)
    values = np.maximum(values, LEAST_SINGULAR_VALUE * max(values[0], 1.0))
    least = LEAST_SINGULAR_VALUE * max(lengths.max(), 1.0)
    return np.where(lengths > 0.0, lengths, least), values, directions


def correlation(covariances: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p p"]:
    """Return the correlations of estimates; NaN for zero variances, zero or NaN for infinite."""
    deviations = np.sqrt(np.diag(covariances))
    with np.errstate(invalid="ignore"):
        return covariances / np.outer(deviations, deviations)


@dataclass(frozen=True)
class Combination:
    """A weighted sum of the parameters' coordinates.

    - `weights`: weights of the coordinates, scaled so that the largest magnitude is 1.
    - `standard_deviation`: of an estimate of the sum; infinite if the data don't determine it.
    - `shares`: share of each parameter's variance that the uncertainty of this sum causes; zero if
      this variance is infinite. If the data don't determine the sum, all are NaN or infinite.
    """

    weights: Float[np.ndarray, " p"]
    standard_deviation: float
    shares: Float[np.ndarray, " p"]

    def described(self, names: Sequence[str]) -> str:
        """Return the sum as text, such as "log K + 2 log c", without negligible terms, and with all
        signs reversed if the weight of the largest magnitude is negative."""
        order = np.argsort(-np.abs(self.weights), kind="stable")
        signed = self.weights * np.sign(self.weights[order[0]])
        text = ""
        for k in order.tolist():
            # An infinite share does not count: it is that of a determined parameter in a sum that
            # is not determined.
            if abs(signed[k]) >= SMALL_WEIGHT or SMALL_SHARE < self.shares[k] < np.inf:
                size = f"{abs(signed[k]):.2g} "
                joint = (" - " if signed[k] < 0.0 else " + ") if text else ""
                text += f"{joint}{size.removeprefix('1 ')}{names[k]}"
        return text


def combinations(root: Float[np.ndarray, "p p"], accuracy: float) -> tuple[Combination, ...]:
    """Return p combinations of the coordinates with independent estimates, the most accurate first:
    the eigenvectors of the information."""
    # The columns are not scaled here, because combinations are in the parameters' coordinates. A
    # small singular value means missing information only if scaled columns are deficient too.
    _, values, directions = np.linalg.svd(root)
    deficient = rank(root, accuracy) < len(values)
    negligible = _negligible(values, accuracy if deficient else np.finfo(float).eps)
    with np.errstate(divide="ignore", invalid="ignore"):
        deviations = np.where(negligible, np.inf, 1.0 / values)
        variances = deviations_together(root, accuracy) ** 2
        sums = []
        for direction, deviation in zip(directions, deviations, strict=True):
            largest = np.abs(direction).max()
            shares = (direction * deviation) ** 2 / variances
            sums.append(Combination(direction / largest, float(deviation / largest), shares))
    return tuple(sums)


def _equilibrated(
    roots: Float[np.ndarray, "*T r p"],
) -> tuple[Float[np.ndarray, "*T p"], Float[np.ndarray, "*T k"], Float[np.ndarray, "*T k p"]]:
    """Return the column norms of `roots` and, after scaling the columns to unit length, the k
    singular values, the largest first, and the right singular vectors in rows."""
    lengths = np.linalg.norm(roots, axis=-2)
    scaled = roots / np.where(lengths > 0.0, lengths, 1.0)[..., None, :]
    _, values, directions = np.linalg.svd(scaled, full_matrices=False)
    return lengths, values, directions


def _negligible(values: Float[np.ndarray, "*T k"], accuracy: float) -> Bool[np.ndarray, "*T k"]:
    """For each singular value, the largest first: whether it is zero, or too small relative to the
    largest for the data to determine its combination of parameters."""
    return (values <= accuracy * values[..., :1]) | (values == 0.0)
