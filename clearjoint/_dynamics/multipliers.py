"""Lagrange multipliers of constraint rows (eqs 30 and 32 of P. Flores et al., Spatial revolute
joints with clearances for dynamic analysis of multi-body systems, 2006)."""

from collections.abc import Mapping, Sequence

import jax

from .._math.block_matrices import gram_matrix
from .._math.linear_solvers import AbstractSolver, inner
from .._math.smoothing import where
from .._math.vectors import Matrix, Scalar, add, is_zero, library, multiply, square_root, subtract
from .._model.bodies import GROUND, Body
from .._model.joints.base import Row
from .coordinates import AbstractMechanics, Speeds


class ConstraintEquations:
    """Equations for the multipliers of constraint rows, factorised once for all right sides.

    With the mass matrix M and the rows D (`directions`, a list for each row, with a number for each
    speed), the multipliers lambda that change the rows, D u', by given targets solve D M^-1 D^T
    lambda = targets.

    A row of exact zeros is left out, and its multiplier is zero. An example is the row that closes
    a planar loop in the direction normal to its plane, since the coordinates always satisfy it.
    `weights` multiply the rows and their targets (see `row_weights`); ``None`` if the result of the
    `solver` does not depend on such factors.

    `compliances` belong to the last rows, and make these elastic: such a row changes by its target
    less its compliance times its multiplier. With the compliance 1/a, the row of a joint's position
    has the effect of an armature a.
    """

    def __init__(
        self,
        mechanics: AbstractMechanics,
        directions: Sequence[Speeds],
        solver: AbstractSolver,
        weights: Sequence[Scalar] | None = None,
        compliances: Sequence[Scalar] = (),
    ):
        self._rows, self._speeds = len(directions), len(directions[0])
        # `multiply` by the Python number one takes no operation.
        self._weights = [1.0] * self._rows if weights is None else weights
        self._directions, self._compliances = directions, compliances
        # A zero row would make the matrix singular: only the others are active.
        self._active = [k for k, row in enumerate(directions) if not all(map(is_zero, row))]
        # A solver for singular matrices replaces entries that are rounding errors by zeros.
        rows = [solver.significant(directions[k]) for k in self._active]
        active_weights = [self._weights[k] for k in self._active]
        pairs = zip(active_weights, rows, strict=True)
        rows = [[multiply(weight, part) for part in row] for weight, row in pairs]
        # The rows of D M^-1.
        self._solved_rows = [mechanics.solved(row) for row in rows]
        # Compliances are added to the diagonal of D M^-1 D^T, the product of the factors D M^-1 and
        # D. Both factors get a further column for each compliance, with its square root in the row
        # to which the compliance belongs, and zeros in the others.
        first_elastic = self._rows - len(compliances)
        further_columns = [
            [
                multiply(self._weights[k], square_root(compliance))
                if k == first_elastic + j
                else 0.0
                for j, compliance in enumerate(compliances)
            ]
            for k in self._active
        ]
        factors = [
            [[*row, *further] for row, further in zip(factor, further_columns, strict=True)]
            for factor in (rows, self._solved_rows)
        ]
        # Without active rows there is nothing to solve: `list` returns the empty right side.
        self._solve = solver.solving(gram_matrix(*factors)) if rows else list

    def corrected(self, targets: Sequence[Scalar], rates: Speeds) -> tuple[Speeds, list[Scalar]]:
        """Return the `rates` of the speeds, changed as little as possible in the metric of M, such
        that each row's product with the new rates is its target; and the rows' multipliers."""
        multipliers: list[Scalar] = [0.0] * self._rows
        rigid = [0.0] * (self._rows - len(self._compliances))
        # A body may have much less inertia by itself than the armature of its joint: its rate
        # without the multiplier is then large, and the change cancels most of it. The second pass
        # corrects what rounding errors leave.
        for _ in range(2 if self._compliances else 1):
            # What each row still lacks: target - row . rates - compliance multiplier.
            yielding = map(multiply, [*rigid, *self._compliances], multipliers)
            lacking = [
                subtract(target - inner(row, rates), part)
                for target, row, part in zip(targets, self._directions, yielding, strict=True)
            ]
            change, further = self.response(lacking)
            rates = [add(a, b) for a, b in zip(rates, change, strict=True)]
            multipliers = [add(a, b) for a, b in zip(multipliers, further, strict=True)]
        return rates, multipliers

    def response(self, targets: Sequence[Scalar]) -> tuple[Speeds, list[Scalar]]:
        """Return the smallest change of rates, speeds or positions, in the metric of M, that
        changes each row by its target: M^-1 D^T lambda; and the multipliers lambda."""
        # Multipliers of the weighted active rows. Those of rows of zeros stay zero.
        weighted = self._solve([multiply(self._weights[k], targets[k]) for k in self._active])
        change: Speeds = [0.0] * self._speeds
        for row, multiplier in zip(self._solved_rows, weighted, strict=True):
            change = [add(a, multiply(b, multiplier)) for a, b in zip(change, row, strict=True)]
        multipliers: list[Scalar] = [0.0] * self._rows
        # A weighted row has the multiplier of the row itself divided by the weight.
        for k, multiplier in zip(self._active, weighted, strict=True):
            multipliers[k] = multiply(self._weights[k], multiplier)
        return change, multipliers


def row_weights(bodies: Mapping[str, Body], rows: Sequence[Row]) -> list[Scalar]:
    """Return the weight of each constraint row: the square root of the mass, kg, or moment of
    inertia, kg m^2, that its multiplier would accelerate if all bodies were free.

    Weighted rows all have the same unit. Without weights, the norm of the multipliers, which the
    solver for redundant constraints minimises, would add forces to moments, and in a mechanism with
    links of a millimetre, this solver would take the equations of translation for rounding errors.
    """
    weights = []
    for row in rows:
        total: Scalar = 0.0
        for name, wrench in row.jacobian.items():
            if name != GROUND:
                # The sum of these terms is J M^-1 J^T, for the row's Jacobian J and the matrix M of
                # masses and inertias: the inverse of the mass that the multiplier accelerates.
                by_force = wrench.force.dot(wrench.force) / bodies[name].mass
                by_moment = wrench.moment.dot(wrench.moment) / _mean_inertia(bodies[name])
                total = add(total, add(by_force, by_moment))
        # A row may vanish in a singular position; its multiplier is zero with any weight.
        weights.append(1.0 / square_root(where(total > 0.0, total, 1.0)))
    return weights


def _mean_inertia(body: Body) -> Scalar:
    """Return the mean of a body's principal moments of inertia, kg m^2, for the weights of rows."""
    inertia = body.inertia
    if isinstance(inertia, Matrix):
        return (inertia.row_x.x + inertia.row_y.y + inertia.row_z.z) / 3.0
    return (inertia.x + inertia.y + inertia.z) / 3.0


def as_array(numbers: Sequence[Scalar]) -> jax.Array:
    """Return scalars as an array of floats: of JAX if any scalar is of JAX, otherwise of NumPy."""
    numpy = library(numbers)
    return numpy.stack([numpy.asarray(number, dtype=float) for number in numbers])
