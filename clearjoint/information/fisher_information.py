"""What independent samples with normal noise tell about parameters: Fisher information.

Of p parameters, F = J^T J with the derivatives J (rows, p) of all samples in units of their noise.
Its inverse bounds the covariance of every unbiased estimate (Cramér and Rao), and is that of least
squares when the noise is small. Kept is a root of it, R (p, p) with R^T R = F, by orthogonal
transformations of J: F itself would lose half of the digits, and with them combinations that the
data hardly see. All functions take stacks of roots, (..., p, p).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

SMALL_WEIGHT, SMALL_SHARE = 0.02, 0.1
"""A combination's description leaves out parameters whose weight is below this share of the largest
one, unless more than this share of their variance comes from it."""


def root_of(rows: np.ndarray) -> np.ndarray:
    """The root (p, p) of the information of rows (N, p)."""
    p = rows.shape[1]
    return np.asarray(np.linalg.qr(np.concatenate([np.zeros((p, p)), rows]), mode="r"))


def roots_over(rows: np.ndarray, ends: Sequence[int]) -> np.ndarray:
    """Roots (T, p, p) of the first rows of (N, p), up to each of T rising ends."""
    root, start = np.zeros((rows.shape[1],) * 2), 0
    roots = []
    for end in ends:
        root = root_of(np.concatenate([root, rows[start:end]]))
        roots.append(root)
        start = end
    return np.array(roots)


def together(roots: np.ndarray, accuracy: float) -> np.ndarray:
    """Bounds (..., p) of the parameters' standard deviations, all of them estimated together.

    Infinite where the rank is deficient: where a singular value, with each parameter's column
    brought to unit length, is below `accuracy` (the relative error of the derivatives) times the
    largest, the data say nothing about that direction nor about a parameter in it.
    """
    lengths, values, directions = _equilibrated(roots)
    blind = _blind(values, accuracy)[..., None]
    parts = directions / np.where(blind, 1.0, values[..., None])
    parts = np.where(blind, np.where(np.abs(directions) > np.sqrt(accuracy), np.inf, 0.0), parts)
    return np.linalg.norm(parts, axis=-2) / np.where(lengths > 0.0, lengths, 1.0)


def alone(roots: np.ndarray) -> np.ndarray:
    """Bounds (..., p) of each parameter's standard deviation, all others known."""
    with np.errstate(divide="ignore"):
        return 1.0 / np.linalg.norm(roots, axis=-2)


def rank(roots: np.ndarray, accuracy: float) -> np.ndarray:
    """How many directions the data see, (...)."""
    return (~_blind(_equilibrated(roots)[1], accuracy)).sum(axis=-1)


def condition(roots: np.ndarray) -> np.ndarray:
    """Ratio of the largest singular value to the smallest, each parameter's column brought to unit
    length, (...): that of the derivatives, the square root of that of F."""
    values = _equilibrated(roots)[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        return values[..., 0] / values[..., -1]


def covariance(root: np.ndarray) -> np.ndarray:
    """The inverse of the information, (p, p); NaN if it has none."""
    lengths, values, directions = _equilibrated(root)
    with np.errstate(divide="ignore", invalid="ignore"):
        half = (directions / values[:, None]) / lengths
        return half.T @ half


def correlation(root: np.ndarray) -> np.ndarray:
    """Correlations (p, p) of estimates; NaN where the information has no inverse."""
    found = covariance(root)
    deviations = np.sqrt(np.diag(found))
    with np.errstate(invalid="ignore"):
        return found / np.outer(deviations, deviations)


@dataclass(frozen=True)
class Combination:
    """A sum of the parameters' coordinates, weighted.

    `weights`: (p,), the largest of size one. `standard_deviation`: the bound of that of the sum,
    infinite where the data don't see it. `shares`: (p,) of each parameter's variance that comes
    from not knowing this sum; NaN where that is infinite.
    """

    weights: np.ndarray
    standard_deviation: float
    shares: np.ndarray

    def described(self, names: Sequence[str]) -> str:
        """In words, such as "log K + 2 log c"."""
        order = np.argsort(-np.abs(self.weights), kind="stable")
        signed = self.weights * np.sign(self.weights[order[0]])
        text = ""
        for k in order.tolist():
            if abs(signed[k]) >= SMALL_WEIGHT or self.shares[k] > SMALL_SHARE:
                size = f"{abs(signed[k]):.2g} "
                joint = (" - " if signed[k] < 0.0 else " + ") if text else ""
                text += f"{joint}{size.removeprefix('1 ')}{names[k]}"
        return text


def combinations(root: np.ndarray, accuracy: float) -> tuple[Combination, ...]:
    """Combinations of the coordinates whose estimates are independent, from the one that the data
    see best to the worst: eigenvectors of the information."""
    _, values, directions = np.linalg.svd(root)
    deficient = rank(root, accuracy) < len(values)
    blind = _blind(values, accuracy if deficient else np.finfo(float).eps)
    with np.errstate(divide="ignore", invalid="ignore"):
        deviations = np.where(blind, np.inf, 1.0 / values)
        variances = together(root, accuracy) ** 2
        found = []
        for direction, deviation in zip(directions, deviations, strict=True):
            largest = np.abs(direction).max()
            shares = (direction * deviation) ** 2 / variances
            found.append(Combination(direction / largest, float(deviation / largest), shares))
    return tuple(found)


def _equilibrated(roots: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lengths (..., p) of the columns, and singular values and directions of the roots with columns
    of unit length."""
    lengths = np.linalg.norm(roots, axis=-2)
    scaled = roots / np.where(lengths > 0.0, lengths, 1.0)[..., None, :]
    _, values, directions = np.linalg.svd(scaled)
    return lengths, values, directions


def _blind(values: np.ndarray, accuracy: float) -> np.ndarray:
    """Which singular values, falling along the last axis, are as good as zero."""
    return (values <= accuracy * values[..., :1]) | (values == 0.0)
