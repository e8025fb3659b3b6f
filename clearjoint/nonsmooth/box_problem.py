"""The linear complementarity problem with bounds: impulses between bounds, each with a velocity.

Find x between bounds with y = W x + q such that y >= 0 where x is at its lower bound, y <= 0 at its
upper one, and y = 0 between. Newton's method on y = 0 or x = bound, which of the two each row
obeys by the last iterate (M. Hintermueller, K. Ito, K. Kunisch, The primal-dual active set strategy
as a semismooth Newton method, 2003). It ends with the exact solution of the last choice, mostly
after two or three iterations, also for two bases so close together that projected Gauss-Seidel
takes thousands of sweeps. A sweep of Gauss-Seidel before each iteration keeps more than two rows
from cycling.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp

from ..coordinates import stacked
from ..linear import LARGEST_UNROLLED, Exact, Rows, inner, product
from ..vectors import Scalar, add

ITERATIONS = 30
RELATIVE_TOLERANCE = 1e-10
"""Of the residual, against the largest velocity."""
RELATIVE_SHIFT = 1e-11
"""Of the diagonal, which makes rows that depend on each other solvable."""

Impulses = list[Scalar]


class BoxProblem:
    """W by its lower triangle and bounds; a row whose bounds are equal is at rest there.

    A diagonal that vanishes, as of a contact without a normal, is taken as 1.
    """

    def __init__(self, matrix: Rows, lower: Sequence[Scalar], upper: Sequence[Scalar]):
        self._lower, self._upper = lower, upper
        self._diagonal = [
            jnp.where(row[i] > 0.0, row[i], 1.0) * (1.0 + RELATIVE_SHIFT)
            for i, row in enumerate(matrix)
        ]
        self._matrix = [
            [*row[:i], diagonal]
            for i, (row, diagonal) in enumerate(zip(matrix, self._diagonal, strict=True))
        ]

    def solve(self, start: Sequence[Scalar]) -> tuple[Impulses, Scalar]:
        """The x for q, given as `start`, and the residual: the largest violation, in the unit of
        q."""
        tolerance = RELATIVE_TOLERANCE * largest(start)

        def goes(now: tuple[Impulses, Scalar, Scalar]) -> Scalar:
            _, residual, count = now
            return (residual > tolerance) & (count < ITERATIONS)

        def go(now: tuple[Impulses, Scalar, Scalar]) -> tuple[Impulses, Scalar, Scalar]:
            x = self._newton(self._swept(now[0], start), start)
            return x, self._residual(x, start), now[2] + 1

        nothing = [jnp.clip(0.0, *bounds) for bounds in zip(self._lower, self._upper, strict=True)]
        begin = nothing, self._residual(nothing, start), jnp.zeros((), int)
        x, residual, _ = jax.lax.while_loop(goes, go, begin)
        return x, residual

    def _row(self, i: int) -> list[Scalar]:
        return [self._matrix[max(i, j)][min(i, j)] for j in range(len(self._matrix))]

    def _clipped(self, i: int, x: Scalar, velocity: Scalar) -> Scalar:
        return jnp.clip(x - velocity / self._diagonal[i], self._lower[i], self._upper[i])

    def _swept(self, x: Impulses, start: Sequence[Scalar]) -> Impulses:
        """One sweep of projected Gauss-Seidel."""
        x = list(x)
        for i in range(len(x)):
            x[i] = self._clipped(i, x[i], add(inner(self._row(i), x), start[i]))
        return x

    def _newton(self, x: Impulses, start: Sequence[Scalar]) -> Impulses:
        """Rows that would leave their bounds are held there, the others have no velocity."""
        wishes = [
            a - add(image, b) / d
            for a, image, b, d in zip(
                x, product(self._matrix, x), start, self._diagonal, strict=True
            )
        ]
        low = [wish <= bound for wish, bound in zip(wishes, self._lower, strict=True)]
        high = [wish >= bound for wish, bound in zip(wishes, self._upper, strict=True)]
        held = [
            jnp.where(a, lower, jnp.where(b, upper, 0.0))
            for a, b, lower, upper in zip(low, high, self._lower, self._upper, strict=True)
        ]
        free = [~(a | b) for a, b in zip(low, high, strict=True)]
        image = product(self._matrix, held)
        matrix = [
            [*(jnp.where(free[i] & free[j], row[j], 0.0) for j in range(i)), row[i]]
            for i, row in enumerate(self._matrix)
        ]
        right = [
            jnp.where(f, -add(part, b), diagonal * bound)
            for f, part, b, diagonal, bound in zip(
                free, image, start, self._diagonal, held, strict=True
            )
        ]
        return _solved(matrix, right)

    def _residual(self, x: Impulses, start: Sequence[Scalar]) -> Scalar:
        image = product(self._matrix, x)
        return largest(
            [
                (x[i] - self._clipped(i, x[i], add(image[i], start[i]))) * self._diagonal[i]
                for i in range(len(x))
            ]
        )


def largest(numbers: Sequence[Scalar]) -> Scalar:
    """The largest magnitude of some numbers."""
    found: Scalar = 0.0
    for number in numbers:
        found = jnp.maximum(found, jnp.abs(number))
    return found


def _solved(matrix: Rows, right: Sequence[Scalar]) -> Impulses:
    n = len(right)
    if n <= LARGEST_UNROLLED:
        return Exact().unrolled(matrix, right)
    full = [stacked([matrix[max(i, j)][min(i, j)] for j in range(n)]) for i in range(n)]
    return list(Exact().dense(jnp.stack(full), stacked(right)))
