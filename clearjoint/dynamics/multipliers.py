"""Lagrange multipliers of constraint rows (eqs 30 and 32), unrolled in scalar form or, for large
systems, in arrays."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp

from ..math.linear_solvers import LARGEST_UNROLLED, AbstractSolver, inner
from ..math.vectors import Scalar, add, is_zero, library, multiply
from ..model.bodies import GROUND
from ..model.joints.base import Motions, Row
from .coordinates import AbstractMechanics, Speeds


def response(
    mechanics: AbstractMechanics,
    directions: Sequence[Speeds],
    targets: Sequence[Scalar],
    solver: AbstractSolver,
) -> tuple[Speeds, list[Scalar]]:
    """Return the change of the rates that changes each row by its target, and the multipliers.

    The change is M^-1 D^T lambda with D M^-1 D^T lambda = targets, where `directions` are the rows
    D = J H. Projections use the same map with speeds or displacements instead of rates: it is the
    smallest correction in the metric of the mass matrix. A row that is structurally zero, such as
    that of a planar loop normal to its plane, is satisfied identically; its multiplier is zero.
    """
    # A zero row would make the matrix singular.
    kept = [k for k, row in enumerate(directions) if not all(map(is_zero, row))]
    multipliers: list[Scalar] = [0.0] * len(directions)
    if not kept:
        return [0.0] * len(directions[0]), multipliers
    rows = [solver.significant(directions[k]) for k in kept]
    aims = [targets[k] for k in kept]
    weighted = [mechanics.solved(row) for row in rows]
    solve = _dense_response if len(rows) > LARGEST_UNROLLED else _unrolled_response
    change, nonzero = solve(rows, weighted, aims, solver)
    for k, multiplier in zip(kept, nonzero, strict=True):
        multipliers[k] = multiplier
    return change, multipliers


def _unrolled_response(
    directions: Sequence[Speeds],
    weighted: Sequence[Speeds],
    targets: Sequence[Scalar],
    solver: AbstractSolver,
) -> tuple[Speeds, list[Scalar]]:
    """Return `response` in scalar form; `weighted` are the rows of D M^-1."""
    # The lower triangle of D M^-1 D^T, which is symmetric.
    schur = [
        [inner(row, column) for column in weighted[: i + 1]] for i, row in enumerate(directions)
    ]
    multipliers = solver.unrolled(schur, targets)
    change: Speeds = [0.0] * len(directions[0])
    for part, multiplier in zip(weighted, multipliers, strict=True):
        change = [add(a, multiply(b, multiplier)) for a, b in zip(change, part, strict=True)]
    return change, multipliers


def _dense_response(
    directions: Sequence[Speeds],
    weighted: Sequence[Speeds],
    targets: Sequence[Scalar],
    solver: AbstractSolver,
) -> tuple[Speeds, list[Scalar]]:
    """Return `response` in arrays, for systems too large to be unrolled."""
    jacobian, inverse = (
        jnp.stack([as_array(row) for row in rows]) for rows in (directions, weighted)
    )
    multipliers = solver.dense(jacobian @ inverse.T, as_array(targets))
    change = multipliers @ inverse
    return list(change), list(multipliers)


def as_array(numbers: Sequence[Scalar]) -> jax.Array:
    """Stack scalars as an array (n,) of floats: of NumPy if the numbers are, else of JAX."""
    numpy = library(numbers)
    return numpy.stack([numpy.asarray(number, dtype=float) for number in numbers])


def row_rate(row: Row, motions: Motions) -> Scalar:
    """Return the first time derivative of a row's value."""
    total = row.time_rate
    for name, pair in row.jacobian.items():
        if name != GROUND:
            motion = motions[name]
            part = add(pair.force.dot(motion.velocity), pair.moment.dot(motion.spin))
            total = add(total, part)
    return total
