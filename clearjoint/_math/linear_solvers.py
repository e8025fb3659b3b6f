"""Solvers for symmetric positive semidefinite systems of linear equations.

The matrix of a system is S = D X^T, where the rows of D and X are lists of scalars. Operations on
entries that are the Python number zero are omitted. Unrolled scalar arithmetic (`ScalarMatrix`)
solves systems that take few multiplications. Loops over blocks (`.block_matrices`) solve all
others, since the compile time of unrolled code grows faster than its length.
"""

import abc
from collections.abc import Callable, Sequence
from functools import reduce
from itertools import compress

import jax.numpy as jnp
from typing_extensions import override

from .vectors import Scalar, add, is_zero, multiply, subtract

Rows = Sequence[Sequence[Scalar]]
"""Rows of a matrix. Of a symmetric matrix, only the first i + 1 entries of row i are read."""
Solve = Callable[[Sequence[Scalar]], list[Scalar]]
"""Function of the right side of a system of equations, n scalars, that returns the n unknowns."""


def elimination_order(
    nonzero: Sequence[Sequence[int]],
) -> tuple[list[int], list[set[int]], list[list[int]]]:
    """Return an order in which to eliminate the unknowns of a sparse symmetric matrix.

    **Arguments:** `nonzero`: row i tells which of the first i entries are nonzero, by numbers or
    bools that are zero or not.

    **Returns:** the indices of the unknowns in the order of their elimination; for each unknown in
    this order, the set of others with a nonzero entry in its row of the matrix; and for each column
    of the triangular factor, the sorted rows of its nonzero entries below the diagonal. In the sets
    and rows, unknowns are numbered in the order of their elimination.
    """
    neighbours: list[set[int]] = [set() for _ in nonzero]
    for i, row in enumerate(nonzero):
        for j in compress(range(i), row):
            neighbours[i].add(j)
            neighbours[j].add(i)
    order = _least_degree_order(neighbours)
    place = {unknown: k for k, unknown in enumerate(order)}
    reordered = [{place[other] for other in neighbours[unknown]} for unknown in order]
    columns = [{i for i in others if i > j} for j, others in enumerate(reordered)]
    for column in columns:
        if column:
            # Eliminating an unknown couples the later unknowns of its column with each other. It
            # suffices to add them to the column of the next of them, which passes them on.
            following = min(column)
            columns[following] |= column - {following}
    return order, reordered, [sorted(column) for column in columns]


def _least_degree_order(neighbours: Sequence[set[int]]) -> list[int]:
    """Return the indices of unknowns in an order of elimination that reduces fill-in: the next one
    is coupled with the fewest remaining ones (W. F. Tinney, J. W. Walker, Direct solutions of
    sparse network equations, 1967)."""
    remaining = {i: set(others) for i, others in enumerate(neighbours)}
    order = []
    while remaining:
        eliminated = min(remaining, key=lambda i: len(remaining[i]))
        order.append(eliminated)
        # Elimination couples all neighbours of an unknown: the fill-in.
        coupled = remaining.pop(eliminated)
        for i in coupled:
            remaining[i] |= coupled
            remaining[i] -= {i, eliminated}
    return order


class Factorisation:
    """Factorisation L D L^T of a symmetric positive definite matrix, with its unknowns in an
    `elimination_order`, by scalar arithmetic without operations on structural zeros."""

    def __init__(self, matrix: Rows):
        nonzero = [[not is_zero(entry) for entry in row] for row in matrix]
        self._order, _, self._below = elimination_order(nonzero)
        n = len(matrix)
        # The entries left of the diagonal, by column: of L, and of the product L D.
        self._lower: list[dict[int, Scalar]] = [{} for _ in range(n)]
        self._inverse_diagonal: list[Scalar] = []
        scaled: list[dict[int, Scalar]] = [{} for _ in range(n)]

        # The entry of unknowns i and j of the order, from the lower triangle of the matrix.
        def entry(i: int, j: int) -> Scalar:
            row, column = self._order[i], self._order[j]
            return matrix[max(row, column)][min(row, column)]

        # With the pivots d, a_jj = sum_k l_jk^2 d_k + d_j, and for i > j
        # a_ij = sum_k l_ik (l_jk d_k) + l_ij d_j, where k runs from 0 to j - 1.
        for j in range(n):
            pivot = _reduced(entry(j, j), self._lower[j], scaled[j])
            self._inverse_diagonal.append(1.0 / pivot)
            for i in self._below[j]:
                scaled[i][j] = _reduced(entry(i, j), self._lower[i], scaled[j])
                self._lower[i][j] = multiply(scaled[i][j], self._inverse_diagonal[j])

    def solve(self, right: Sequence[Scalar]) -> list[Scalar]:
        # The solution for a right side of structural zeros is zero, and needs no operations.
        if all(map(is_zero, right)):
            return list(right)
        # Solve L z = right, then D L^T x = z.
        z: dict[int, Scalar] = {}
        for i, row in enumerate(self._order):
            z[i] = _reduced(right[row], self._lower[i], z)
        x = {i: multiply(part, self._inverse_diagonal[i]) for i, part in z.items()}
        for i in reversed(x):
            x[i] = _reduced(x[i], {k: self._lower[k][i] for k in self._below[i]}, x)
        by_unknown = dict(zip(self._order, x.values(), strict=True))
        return [by_unknown[i] for i in range(len(right))]


def _reduced(start: Scalar, first: dict[int, Scalar], second: dict[int, Scalar]) -> Scalar:
    """Return `start` minus the products of entries of `first` and `second` with equal keys."""
    for k, a in first.items():
        if k in second:
            start = subtract(start, multiply(a, second[k]))
    return start


class AbstractMatrix(abc.ABC):
    """A symmetric matrix S of a system of `n` linear equations."""

    n: int

    @abc.abstractmethod
    def trace(self) -> Scalar:
        """Return the sum of the diagonal."""

    @abc.abstractmethod
    def solving(self, shift: Scalar = 0.0, sweeps: int = 1) -> Solve:
        """Return the function that solves S x = b. From x = 0, the function computes the iteration
        x <- x + (S + `shift` I)^-1 (b - S x) `sweeps` times. If `shift` is zero, once suffices.
        S + `shift` I must be positive definite, and is factorised once."""


class ScalarMatrix(AbstractMatrix):
    """A matrix whose systems are solved by unrolled scalar arithmetic."""

    def __init__(self, rows: Rows):
        self._rows, self.n = rows, len(rows)

    @override
    def trace(self) -> Scalar:
        return reduce(add, (row[i] for i, row in enumerate(self._rows)), 0.0)

    @override
    def solving(self, shift: Scalar = 0.0, sweeps: int = 1) -> Solve:
        matrix = self._rows
        shifted = [[*row[:i], add(row[i], shift)] for i, row in enumerate(matrix)]
        factorisation = Factorisation(shifted)

        def solution(right: Sequence[Scalar]) -> list[Scalar]:
            # The first iteration, from x = 0, needs no product.
            x = factorisation.solve(right)
            for _ in range(sweeps - 1):
                image = product(matrix, x)
                rest = [subtract(b, s) for b, s in zip(right, image, strict=True)]
                x = [add(a, d) for a, d in zip(x, factorisation.solve(rest), strict=True)]
            return x

        return solution


class AbstractSolver(abc.ABC):
    """Base class of solvers of S x = b, S = D M^-1 D^T: constraint Jacobian D, mass matrix M."""

    def significant(self, row: Sequence[Scalar]) -> list[Scalar]:
        """Return a row of D, with zeros in place of entries that are rounding errors."""
        return list(row)

    @abc.abstractmethod
    def solving(self, matrix: AbstractMatrix) -> Solve:
        """Return the function that solves S x = b for x, given b; `matrix` is S."""


class Exact(AbstractSolver):
    """Direct solver, for nonsingular matrices only."""

    @override
    def solving(self, matrix: AbstractMatrix) -> Solve:
        return matrix.solving()


class LeastNorm(AbstractSolver):
    """Solver that returns the solution of least norm of a singular but consistent system S x = b.

    The iteration x <- x + (S + eps I)^-1 (b - S x) from x = 0 stays in the range of S and converges
    to the solution of least norm. Each iteration multiplies the error by at most eps/(eps + sigma),
    where sigma is the smallest nonzero eigenvalue of S (E. Bayo, A. Avello, Singularity-free
    augmented Lagrangian algorithms, 1994). Unlike an eigenvalue decomposition, it can be
    differentiated where eigenvalues coincide. `relative_shift` is eps over the mean of the diagonal
    of S. Unless sigma is far below this, three iterations (`sweeps`) leave only rounding errors.
    """

    relative_shift = 1e-8
    sweeps = 3
    rounding = 1e-12
    """Largest absolute value of an entry of D that counts as a rounding error. Entries are
    components of unit vectors, or of arms in m. The row of a constraint that the coordinates always
    satisfy consists of such errors, and would make the solution arbitrary."""

    @override
    def significant(self, row: Sequence[Scalar]) -> list[Scalar]:
        return [
            entry if is_zero(entry) else jnp.where(jnp.abs(entry) > self.rounding, entry, 0.0)
            for entry in row
        ]

    @override
    def solving(self, matrix: AbstractMatrix) -> Solve:
        trace = matrix.trace()
        # A shift of zero would leave a matrix of zeros singular; any other serves.
        shift = jnp.where(trace > 0.0, trace * (self.relative_shift / matrix.n), 1.0)
        return matrix.solving(shift, self.sweeps)


def inner(first: Sequence[Scalar], second: Sequence[Scalar]) -> Scalar:
    """Return the inner product of two lists, without operations on structural zeros."""
    return reduce(add, (multiply(a, b) for a, b in zip(first, second, strict=True)), 0.0)


def product(matrix: Rows, vector: Sequence[Scalar]) -> list[Scalar]:
    """Return the product of a vector and a symmetric matrix, whose lower triangle is read."""
    n = len(vector)
    return [inner([matrix[max(i, j)][min(i, j)] for j in range(n)], vector) for i in range(n)]
