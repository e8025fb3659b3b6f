"""Projection of positions and velocities onto the constraints, of least kinetic energy."""

from ..math.linear_solvers import AbstractSolver
from ..math.vectors import Scalar
from ..model.joints.base import Row
from .coordinates import AbstractMechanics, MotionVariables, Speeds
from .multipliers import response, row_rate


def projected_positions(
    mechanics: AbstractMechanics, rows: list[Row], solver: AbstractSolver
) -> MotionVariables:
    """One Newton step of the positions towards Phi = 0, in the metric of the mass matrix."""
    targets = [-row.value for row in rows]
    return mechanics.after_displacement(_correction(mechanics, rows, targets, solver))


def projected_velocities(
    mechanics: AbstractMechanics, rows: list[Row], solver: AbstractSolver
) -> MotionVariables:
    """The velocities nearest to the given ones, in the metric of the mass matrix, that satisfy the
    rate of Phi = 0."""
    targets = [-row_rate(row, mechanics.motions) for row in rows]
    return mechanics.after_speed_change(_correction(mechanics, rows, targets, solver))


def _correction(
    mechanics: AbstractMechanics, rows: list[Row], targets: list[Scalar], solver: AbstractSolver
) -> Speeds:
    """The change along the speeds by which each row changes by its target."""
    directions = [mechanics.projected(row.jacobian) for row in rows]
    return response(mechanics, directions, targets, solver)[0]
