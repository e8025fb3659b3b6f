"""Fisher information of independent samples with normal noise about parameters.

For p parameters the information is F = J^T J, with the derivatives J (N, p) of N samples, divided
by the standard deviations of their noise. The inverse of F bounds the covariance of every unbiased
estimate (Cramér and Rao), and it is the covariance of least squares for small noise. Computing F
would lose half of the digits, and with them combinations that the data hardly determine. Most
functions here therefore take a root R (p, p) with R^T R = F, which follows from a QR decomposition
of J. An argument `roots` may be a stack (..., r, p) of roots, each with any number r >= p of rows.
Parameters are given by coordinates, their values on scales such as a logarithm.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

SMALL_WEIGHT, SMALL_SHARE = 0.02, 0.1
"""The description of a combination omits parameters whose absolute weight is less than
`SMALL_WEIGHT` times the largest one, unless the combination contributes more than `SMALL_SHARE` of
their variance."""
LEAST_SINGULAR_VALUE = 1e-12
"""Smallest singular value of derivatives relative to the largest, with columns scaled to unit
length, in `covariance` and `floored`. Smaller ones are raised to this value, so that the variance
of an undetermined combination of parameters stays finite."""


def root_of(rows: Float[np.ndarray, "N p"]) -> Float[np.ndarray, "p p"]:
    """Return a root R (p, p) of the information, with R^T R = J^T J.

    **Arguments:** `rows`: derivatives J (N, p).
    """
    # With p rows of zeros, the root has p rows also if there are fewer samples than parameters.
    p = rows.shape[1]
    return np.asarray(np.linalg.qr(np.concatenate([np.zeros((p, p)), rows]), mode="r"))


def deviations_together(
    roots: Float[np.ndarray, "*T r p"], accuracy: float
) -> Float[np.ndarray, "*T p"]:
    """Return lower bounds (..., p) of the parameters' standard deviations if all are estimated.

    A combination of parameters is undetermined if its singular value is at most `accuracy` times
    the largest one, with the columns of the root scaled to unit length. The bound is infinite for a
    parameter whose component in the right singular vector of such a combination has a magnitude
    above the square root of `accuracy`.

    **Arguments:** `roots`: roots (..., r, p) of the information; `accuracy`: relative error of the
    derivatives.
    """
    return np.linalg.norm(_parts_together(roots, accuracy), axis=-2)


def correlation_together(
    root: Float[np.ndarray, "p p"], accuracy: float
) -> Float[np.ndarray, "p p"]:
    """Return the correlations (p, p) of the parameters' estimates if all are estimated.

    Those of a parameter with an infinite bound in `deviations_together` are NaN.

    **Arguments:** `root`: root (p, p) of the information; `accuracy`: as for `deviations_together`.
    """
    parts = _parts_together(root, accuracy)
    half = np.where(np.isinf(parts).any(axis=0), np.nan, parts)
    return correlation(half.T @ half)


def _parts_together(
    roots: Float[np.ndarray, "*T r p"], accuracy: float
) -> Float[np.ndarray, "*T k p"]:
    """Return the contributions (..., k, p) of k = min(r, p) singular directions to the bounds.

    The bound of a parameter in `deviations_together` is the norm of its k contributions.

    **Arguments:** as for `deviations_together`.
    """
    # Columns of unit length make the test independent of the units of the parameters.
    lengths, values, directions = _equilibrated(roots)
    negligible = _negligible(values, accuracy)[..., None]
    # A parameter is undetermined only if its component in an undetermined direction exceeds the
    # error of that direction. Other parameters have finite bounds, from the determined directions.
    parts = directions / np.where(negligible, 1.0, values[..., None])
    parts = np.where(
        negligible, np.where(np.abs(directions) > np.sqrt(accuracy), np.inf, 0.0), parts
    )
    return parts / np.where(lengths > 0.0, lengths, 1.0)[..., None, :]


def rank(roots: Float[np.ndarray, "*T r p"], accuracy: float) -> np.ndarray:
    """Return the number (...) of independent combinations of parameters that the data determine.

    **Arguments:** as for `deviations_together`.
    """
    return (~_negligible(_equilibrated(roots)[1], accuracy)).sum(axis=-1)


def condition(roots: Float[np.ndarray, "*T r p"]) -> np.ndarray:
    """Return the condition number (...) of the derivatives J with columns of unit length.

    If it is large, the data hardly determine some combination of the parameters. It is infinite
    (with rounding errors, very large) for a singular J, and NaN if J is zero. The condition number
    of F with its diagonal scaled to one is the square of this number.
    """
    values = _equilibrated(roots)[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        return values[..., 0] / values[..., -1]


def covariance(rows: Float[np.ndarray, "N p"]) -> Float[np.ndarray, "p p"]:
    """Return the covariance (p, p) of estimates of the parameters, the inverse of F.

    Variances of combinations that the data don't determine are large but finite.

    **Arguments:** `rows`: derivatives (N, p), or a root (p, p).
    """
    lengths, values, directions = floored(rows)
    half = (directions / values[:, None]) / lengths
    return half.T @ half


def floored(
    rows: Float[np.ndarray, "N p"],
) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " k"], Float[np.ndarray, "k p"]]:
    """Return the result of `_equilibrated` without numbers that are zero or negligible.

    The largest singular value is at least 1, unless all columns are zero. If they are, the lower
    limit of singular values is relative to 1. A column of zeros gets the length
    `LEAST_SINGULAR_VALUE` times that of the longest column, or times 1 if all are shorter than 1.
    """
    lengths, values, directions = _equilibrated(rows)
    values = np.maximum(values, LEAST_SINGULAR_VALUE * max(values[0], 1.0))
    least = LEAST_SINGULAR_VALUE * max(lengths.max(), 1.0)
    return np.where(lengths > 0.0, lengths, least), values, directions


def correlation(covariances: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p p"]:
    """Return the correlations (p, p) of estimates from their covariance (p, p).

    Correlations with an estimate of zero variance are NaN; those with an estimate of infinite
    variance are zero or NaN.
    """
    deviations = np.sqrt(np.diag(covariances))
    with np.errstate(invalid="ignore"):
        return covariances / np.outer(deviations, deviations)


@dataclass(frozen=True)
class Combination:
    """A weighted sum of the parameters' coordinates.

    - `weights`: (p,), scaled so that the largest absolute value is 1.
    - `standard_deviation`: lower bound of the sum's standard deviation; infinite if the data don't
      determine the sum.
    - `shares`: (p,) share of each parameter's variance that the uncertainty of this sum causes. If
      the data don't determine the sum, they are NaN or infinite; otherwise, a parameter of infinite
      variance has the share zero.
    """

    weights: Float[np.ndarray, " p"]
    standard_deviation: float
    shares: Float[np.ndarray, " p"]

    def described(self, names: Sequence[str]) -> str:
        """Return the sum as text, such as "log K + 2 log c", without negligible terms.

        All signs are reversed if the weight of largest absolute value is negative.

        **Arguments:** `names`: labels of the p coordinates.
        """
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
    """Return p combinations of the coordinates with independent estimates, the most accurate first.

    They are the eigenvectors of the information. The last ones are the simultaneous changes of
    several parameters that the data determine least or not at all.

    **Arguments:** `root`: root (p, p) of the information; `accuracy`: relative error of the
    derivatives.
    """
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
    """Return the norms of the columns of roots (..., r, p), and a singular value decomposition of
    the roots with their columns scaled to unit length.

    **Returns:** norms (..., p), singular values (..., k), the largest first, and right singular
    vectors (..., k, p), for k = min(r, p).
    """
    lengths = np.linalg.norm(roots, axis=-2)
    scaled = roots / np.where(lengths > 0.0, lengths, 1.0)[..., None, :]
    _, values, directions = np.linalg.svd(scaled, full_matrices=False)
    return lengths, values, directions


def _negligible(values: Float[np.ndarray, "*T k"], accuracy: float) -> Bool[np.ndarray, "*T k"]:
    """Return whether singular values are negligible, (..., k).

    The data don't determine a combination of parameters whose singular value is negligible.

    **Arguments:** `values`: (..., k) singular values, the largest first; `accuracy`: relative error
    of the derivatives.
    """
    return (values <= accuracy * values[..., :1]) | (values == 0.0)
