"""Solvers for symmetric positive semidefinite systems of linear equations.

Small systems are given by rows of scalars and are solved by unrolled scalar arithmetic, which is
fast in a stepping loop. The length of the unrolled code, and its compile time, grow with the cube
of the number of rows (over a minute for 30 rows). Larger systems are therefore given by arrays and
solved by JAX's Cholesky factorisation.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import jax.scipy.linalg

from .vectors import Scalar, add, is_zero, multiply, subtract

LARGEST_UNROLLED = 12
"""Largest number of rows of a system that is solved by unrolled arithmetic; see the module."""
Rows = Sequence[Sequence[Scalar]]
"""Rows of a matrix; of a symmetric one, only the entries up to the diagonal are read, so that row i
may have only i + 1 entries."""


class UnrolledFactorisation:
    """Factorisation L D L^T of a symmetric positive definite matrix in scalar arithmetic.

    Entries that are the Python number zero are structural: operations on them are omitted, so that
    a sparse matrix stays sparse except for fill-in.

    **Arguments:** `matrix`: the n rows, of which only the lower triangle is read.
    """

    def __init__(self, matrix: Rows):
        n = len(matrix)
        self._lower: list[list[Scalar]] = [[0.0] * n for _ in range(n)]
        self._inverse_diagonal: list[Scalar] = []
        # The product L D, column by column.
        scaled: list[list[Scalar]] = [[0.0] * n for _ in range(n)]
        # With the pivots d, a_jj = sum_k l_jk^2 d_k + d_j, and for i > j
        # a_ij = sum_k l_ik (l_jk d_k) + l_ij d_j, where k runs from 0 to j - 1.
        for j in range(n):
            pivot = self._reduced(matrix[j][j], self._lower[j], scaled[j][:j])
            self._inverse_diagonal.append(1.0 / pivot)
            for i in range(j + 1, n):
                scaled[i][j] = self._reduced(matrix[i][j], self._lower[i], scaled[j][:j])
                self._lower[i][j] = multiply(scaled[i][j], self._inverse_diagonal[j])

    @staticmethod
    def _reduced(start: Scalar, first: Sequence[Scalar], second: Sequence[Scalar]) -> Scalar:
        """Return `start` minus the inner product of two lists, over the length of the shorter."""
        for a, b in zip(first, second, strict=False):
            start = subtract(start, multiply(a, b))
        return start

    def solve(self, right: Sequence[Scalar]) -> list[Scalar]:
        """Return the solution x of ``matrix @ x = right``; x and `right` are lists of n scalars."""
        # Solve L z = right, then D L^T x = z.
        n = len(right)
        z: list[Scalar] = []
        for i in range(n):
            z.append(self._reduced(right[i], self._lower[i], z))
        x = [multiply(z[i], self._inverse_diagonal[i]) for i in range(n)]
        for i in reversed(range(n)):
            column = [self._lower[k][i] for k in range(i + 1, n)]
            x[i] = self._reduced(x[i], column, x[i + 1 :])
        return x


class OrderedFactorisation:
    """Factorisation of a sparse matrix whose unknowns are reordered to reduce fill-in.

    The next unknown to be eliminated is always one that is coupled with the fewest remaining ones
    (W. F. Tinney, J. W. Walker, Direct solutions of sparse network equations, 1967).

    **Arguments:** `matrix`: as for `UnrolledFactorisation`.
    """

    def __init__(self, matrix: Rows):
        self._order = _least_degree_order(matrix)
        full = [[matrix[max(i, j)][min(i, j)] for j in self._order] for i in self._order]
        self._factorisation = UnrolledFactorisation(full)

    def solve(self, right: Sequence[Scalar]) -> list[Scalar]:
        """Return the solution x of ``matrix @ x = right``; x and `right` are lists of n scalars in
        the original order of the unknowns."""
        solution = self._factorisation.solve([right[i] for i in self._order])
        by_unknown = dict(zip(self._order, solution, strict=True))
        return [by_unknown[i] for i in range(len(right))]


def _least_degree_order(matrix: Rows) -> list[int]:
    """Return the indices of the unknowns of a matrix in their order of elimination."""
    n = len(matrix)
    # Two unknowns are neighbours if their entry of the matrix is not a structural zero.
    neighbours: dict[int, set[int]] = {
        i: {j for j in range(n) if i != j and not is_zero(matrix[max(i, j)][min(i, j)])}
        for i in range(n)
    }
    order = []
    while neighbours:
        eliminated = min(neighbours, key=lambda i: len(neighbours[i]))
        order.append(eliminated)
        # Elimination couples all neighbours of an unknown: the fill-in.
        coupled = neighbours.pop(eliminated)
        for i in coupled:
            neighbours[i] |= coupled
            neighbours[i] -= {i, eliminated}
    return order


class AbstractSolver:
    """Base class of solvers for ``matrix @ x = right``, with rows of scalars or with arrays.

    The matrix is D M^-1 D^T, with the Jacobian D of constraints and a mass matrix M.
    """

    def significant(self, row: Sequence[Scalar]) -> list[Scalar]:
        """Return a row of D, with zeros in place of entries that the solver takes for rounding
        errors.

        This method is called for each row of D before the matrix is computed from the results. By
        default it returns the row unchanged. A solver for singular matrices overrides it.
        """
        return list(row)

    def unrolled(self, matrix: Rows, right: Sequence[Scalar]) -> list[Scalar]:
        """Return the solution, n scalars, for n rows `matrix` and n scalars `right`."""
        raise NotImplementedError

    def dense(self, matrix: jax.Array, right: jax.Array) -> jax.Array:
        """Return the solution, (n,), for arrays `matrix`, (n, n), and `right`, (n,)."""
        raise NotImplementedError


class Exact(AbstractSolver):
    """Direct solver, for nonsingular matrices only."""

    def unrolled(self, matrix: Rows, right: Sequence[Scalar]) -> list[Scalar]:
        """Return the solution by an L D L^T factorisation in scalar arithmetic."""
        return UnrolledFactorisation(matrix).solve(right)

    def dense(self, matrix: jax.Array, right: jax.Array) -> jax.Array:
        """Return the solution by JAX's Cholesky factorisation."""
        return jax.scipy.linalg.cho_solve(jax.scipy.linalg.cho_factor(matrix), right)


class LeastNorm(AbstractSolver):
    """Solver that returns the solution of least norm of a singular but consistent system S x = b.

    The iteration x <- x + (S + eps I)^-1 (b - S x) from x = 0 stays in the range of S and converges
    to the solution of least norm. Each iteration multiplies the error by at most eps/(eps + sigma),
    where sigma is the smallest nonzero eigenvalue of S (E. Bayo, A. Avello, Singularity-free
    augmented Lagrangian algorithms, 1994). Unlike an eigenvalue decomposition, the iteration can be
    differentiated where eigenvalues coincide.

    - `relative_shift`: eps relative to the mean of the diagonal of S.
    - `sweeps`: number of iterations. Unless sigma is far below that mean, three of them reduce the
      error to the size of rounding errors.
    """

    relative_shift = 1e-8
    sweeps = 3
    rounding = 1e-12
    """Largest absolute value of an entry of a row of D that counts as a rounding error. Entries are
    components of unit vectors, or of arms in m. The row of a constraint that the coordinates always
    satisfy consists of such errors, and would make the solution arbitrary."""

    def significant(self, row: Sequence[Scalar]) -> list[Scalar]:
        """Return the row with zeros in place of entries that are rounding errors."""
        return [
            entry if is_zero(entry) else jnp.where(jnp.abs(entry) > self.rounding, entry, 0.0)
            for entry in row
        ]

    def _shift(self, trace: Scalar, n: int) -> Scalar:
        """Return eps for a matrix with n rows and the given trace; 1 for a matrix of zeros."""
        return jnp.where(trace > 0.0, trace * (self.relative_shift / n), 1.0)

    def unrolled(self, matrix: Rows, right: Sequence[Scalar]) -> list[Scalar]:
        """Return the solution by an L D L^T factorisation of S + eps I in scalar arithmetic."""
        trace: Scalar = 0.0
        for i in range(len(matrix)):
            trace = add(trace, matrix[i][i])
        shift = self._shift(trace, len(matrix))
        shifted = [[*matrix[i][:i], matrix[i][i] + shift] for i in range(len(matrix))]
        factorisation = UnrolledFactorisation(shifted)
        # The first iteration, from x = 0, needs no product.
        x = factorisation.solve(right)
        for _ in range(self.sweeps - 1):
            image = product(matrix, x)
            rest = [subtract(b, s) for b, s in zip(right, image, strict=True)]
            x = [add(a, d) for a, d in zip(x, factorisation.solve(rest), strict=True)]
        return x

    def dense(self, matrix: jax.Array, right: jax.Array) -> jax.Array:
        """Return the solution by a Cholesky factorisation of S + eps I."""
        n = matrix.shape[0]
        shift = self._shift(jnp.trace(matrix), n)
        factor = jax.scipy.linalg.cho_factor(matrix + shift * jnp.eye(n))
        x = jnp.zeros(n)
        for _ in range(self.sweeps):
            x = x + jax.scipy.linalg.cho_solve(factor, right - matrix @ x)
        return x


def inner(first: Sequence[Scalar], second: Sequence[Scalar]) -> Scalar:
    """Return the inner product of two lists of n scalars, without operations on structural
    zeros."""
    total: Scalar = 0.0
    for a, b in zip(first, second, strict=True):
        total = add(total, multiply(a, b))
    return total


def product(matrix: Rows, vector: Sequence[Scalar]) -> list[Scalar]:
    """Return the product of a symmetric matrix of n rows and a vector of n scalars."""
    n = len(vector)
    return [inner([matrix[max(i, j)][min(i, j)] for j in range(n)], vector) for i in range(n)]
