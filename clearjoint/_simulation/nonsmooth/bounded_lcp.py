"""Linear complementarity problem with bounds, for impulses at contacts.

Find impulses x (N s) between bounds, for which the velocities y = W x + q (m/s) satisfy y >= 0
where x is at its lower bound, y <= 0 where x is at its upper bound, and y = 0 elsewhere. q are the
velocities without impulses, and W is symmetric and positive semidefinite. Each row of the problem
is one direction of a contact. The solution minimises the energy x W x/2 + q x, J.

An iteration has two parts (J. J. More, G. Toraldo, On the solution of large quadratic programming
problems with bound constraints, 1991). A sweep of projected Gauss-Seidel finds the rows at their
bounds. Newton steps then minimise the energy over the other rows. A Newton step that would cross a
bound ends there, and the next Newton step leaves out the row that has met the bound; a full Newton
step reaches the minimum. Neither part raises the energy, so the iteration cannot cycle. It mostly
ends after one or two iterations, also for linearly dependent rows, such as the axial slips at both
ends of a journal, and for a journal whose ends, with a contact each, are close together.
Gauss-Seidel alone would take thousands of sweeps for such a journal.
"""

from collections.abc import Sequence
from functools import reduce

import jax
import jax.numpy as jnp

from ..._math.block_matrices import gram_matrix
from ..._math.linear_solvers import Exact, Rows, inner, product
from ..._math.vectors import Condition, Scalar, add

ITERATIONS = 30
TOLERANCE = 1e-10
"""The iteration ends at this relative residual, or after `ITERATIONS` iterations, many more than
usual problems take. The value is below `.contact_problem.TOLERANCE`, the tolerance of the
alternation between normal and friction impulses, whose turns solve such problems."""
RELATIVE_SHIFT = 1e-11
"""Relative increase of W's diagonal, which makes systems with linearly dependent rows solvable."""
Impulses = Sequence[Scalar]
Search = tuple[Impulses, Sequence[Condition], Condition]
"""Impulses, whether each row is free, and whether the minimum is reached."""


class BoxProblem:
    """A complementarity problem of n rows, with the lower triangle of W, `matrix`, 1/kg, and n
    lower and upper bounds of the impulses, N s, which may be infinite. A row with equal bounds is
    fixed: its impulse is this bound, and its velocity may have any value. A diagonal element that
    is zero, as for a centred journal, whose contact has no direction, counts as 1.

    In the methods, `x` are n impulses, N s, and `start` n velocities without impulses, q, m/s."""

    def __init__(self, matrix: Rows, lower: Sequence[Scalar], upper: Sequence[Scalar]):
        self._bounds = list(zip(lower, upper, strict=True))
        diagonals = [jnp.where(row[-1] > 0.0, row[-1], 1.0) for row in matrix]
        self._diagonal = [number * (1.0 + RELATIVE_SHIFT) for number in diagonals]
        self._matrix = [[*row[:-1], d] for row, d in zip(matrix, self._diagonal, strict=True)]

    def solve(self, start: Sequence[Scalar], least: Scalar) -> tuple[Impulses, Scalar]:
        """Return the n impulses x, N s, that solve the problem, and the residual: the largest
        violation of a condition, divided by the largest magnitude of q among rows that are not
        fixed, or by `least`, m/s, if that is larger. If the residual is above `TOLERANCE`, the
        iteration did not converge."""
        is_not_fixed = [lower < upper for lower, upper in self._bounds]
        scale = jnp.maximum(largest_of(is_not_fixed, start), least)

        def goes(now: tuple[Impulses, Scalar, Scalar]) -> Condition:
            _, residual, count = now
            return (residual > TOLERANCE) & (count < ITERATIONS)

        def go(now: tuple[Impulses, Scalar, Scalar]) -> tuple[Impulses, Scalar, Scalar]:
            x, _, count = now
            x = self._least_inside(self._swept(x, start), start)
            return x, self._residual(x, start) / scale, count + 1

        # Begin with the impulses nearest to zero. In most steps all contacts are open and their
        # impulses fixed at zero, so that the residual is zero and no iteration is made.
        smallest = [jnp.clip(0.0, *bounds) for bounds in self._bounds]
        residual = self._residual(smallest, start) / scale
        begin: tuple[Impulses, Scalar, Scalar] = smallest, residual, jnp.zeros((), int)
        x, residual, _ = jax.lax.while_loop(goes, go, begin)
        return x, residual

    def _row(self, i: int) -> list[Scalar]:
        return [self._matrix[max(i, j)][min(i, j)] for j in range(len(self._matrix))]

    def _clipped(self, i: int, x: Scalar, velocity: Scalar) -> Scalar:
        """Return the impulse of row i, N s, that satisfies the row's conditions while all others
        stay, from its present impulse x, N s, and `velocity`, m/s."""
        return jnp.clip(x - velocity / self._diagonal[i], *self._bounds[i])

    def _swept(self, x: Impulses, start: Sequence[Scalar]) -> Impulses:
        """Return the impulses x after one sweep of projected Gauss-Seidel over all rows."""
        swept = list(x)
        for i in range(len(swept)):
            swept[i] = self._clipped(i, swept[i], add(inner(self._row(i), swept), start[i]))
        return swept

    def _least_inside(self, x: Impulses, start: Sequence[Scalar]) -> Impulses:
        """Return the impulses that minimise the energy over the free rows, by Newton steps from x.
        A row is free unless it is at a bound and its velocity has the sign demanded there."""
        velocities = self._velocities(x, start)
        free: list[Condition] = [
            jnp.logical_not(((a <= lower) & (y >= 0.0)) | ((a >= upper) & (y <= 0.0)))
            for a, y, (lower, upper) in zip(x, velocities, self._bounds, strict=True)
        ]

        def goes(now: Search) -> Condition:
            _, _, is_reached = now
            return jnp.logical_not(is_reached)

        def go(now: Search) -> Search:
            x, free, _ = now
            change = self._to_least(x, free, start)
            # Go along the change until the first row meets a bound, and fix this row. If it were
            # still free, the next change could lead across the same bound, and its step would have
            # no length. This happens with linearly dependent rows: large changes of their impulses
            # can leave the velocities as they are.
            shares = self._shares(x, change)
            share = reduce(jnp.minimum, shares)
            meets = [(part <= share) & (part < 1.0) for part in shares]

            # A row that meets a bound gets exactly this bound, so that later comparisons with the
            # bound do not depend on rounding.
            moved: list[Scalar] = []
            for a, d, meet, bounds in zip(x, change, meets, self._bounds, strict=True):
                bound = jnp.where(d < 0.0, *bounds)
                moved.append(jnp.where(meet, bound, jnp.clip(a + share * d, *bounds)))
            still_free = [f & jnp.logical_not(meet) for f, meet in zip(free, meets, strict=True)]
            # A step of full length reaches the minimum over the rows that are still free.
            return moved, still_free, share >= 1.0

        done = jnp.logical_not(reduce(jnp.logical_or, free))
        return jax.lax.while_loop(goes, go, (list(x), free, done))[0]

    def _to_least(
        self, x: Impulses, free: Sequence[Condition], start: Sequence[Scalar]
    ) -> Impulses:
        """Return the change of the impulses x after which the `free` rows have zero velocity."""
        velocities = self._velocities(x, start)
        # Equations: W change = -velocity for the free rows. Rows that are not free become decoupled
        # equations with the solution zero, so that the matrix has the same size for any free rows.
        matrix = [
            [*(jnp.where(free[i] & free[j], row[j], 0.0) for j in range(i)), row[i]]
            for i, row in enumerate(self._matrix)
        ]
        right = [jnp.where(f, -y, 0.0) for f, y in zip(free, velocities, strict=True)]
        n = len(right)
        full = [[matrix[max(i, j)][min(i, j)] for j in range(n)] for i in range(n)]
        identity = [[float(i == j) for j in range(n)] for i in range(n)]
        # The product with the identity is W itself, in the form that `Exact` solves.
        return Exact().solving(gram_matrix(full, identity))(right)

    def _shares(self, x: Impulses, change: Impulses) -> list[Scalar]:
        """Return for each row the part, 0 to 1, of its `change` that the row's bounds allow."""
        shares: list[Scalar] = []
        for a, d, (lower, upper) in zip(x, change, self._bounds, strict=True):
            # Distance to the bound towards which the impulse moves, and length of the change. Where
            # nothing changes, the divisor 1 avoids 0/0, although the quotient is not used there.
            room, length = jnp.where(d < 0.0, a - lower, upper - a), jnp.abs(d)
            shares.append(jnp.where(length > room, room / jnp.where(d == 0.0, 1.0, length), 1.0))
        return shares

    def _velocities(self, x: Impulses, start: Sequence[Scalar]) -> list[Scalar]:
        return [add(a, b) for a, b in zip(product(self._matrix, x), start, strict=True)]

    def _residual(self, x: Impulses, start: Sequence[Scalar]) -> Scalar:
        """Return the largest violation of the conditions by the impulses x, m/s: the change of a
        row's impulse that would satisfy its conditions, times the diagonal element of W."""
        rows = enumerate(zip(x, self._velocities(x, start), strict=True))
        return largest([(a - self._clipped(i, a, y)) * self._diagonal[i] for i, (a, y) in rows])


def largest(numbers: Sequence[Scalar]) -> Scalar:
    """Return the largest magnitude of some numbers; 0 for an empty list."""
    magnitude: Scalar = 0.0
    for number in numbers:
        magnitude = jnp.maximum(magnitude, jnp.abs(number))
    return magnitude


def largest_of(chosen: Sequence[Condition], numbers: Sequence[Scalar]) -> Scalar:
    return largest([jnp.where(is_one, x, 0.0) for is_one, x in zip(chosen, numbers, strict=True)])
