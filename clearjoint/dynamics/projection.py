"""Projection of positions and velocities onto the constraints, of least kinetic energy."""

import functools
from typing import Any

import jax
import jax.numpy as jnp

from ..math.vectors import Scalar, is_zero
from ..model.joints.base import Row
from ..model.scene import Scene
from .coordinates import AbstractMechanics, Speeds
from .equations_of_motion import constraint_rows, flattened
from .formulation import Formulation
from .multipliers import response, row_rate


def project_positions(scene: Scene, formulation: Formulation, variables: Any, t: Scalar) -> Any:
    """One Newton step of the positions towards Phi = 0, in the metric of the mass matrix."""
    mechanics = formulation.coordinates.mechanics(scene, variables)
    rows = constraint_rows(scene, formulation.coordinates, mechanics.motions, t)
    if not rows:
        return variables
    targets = [-row.value for row in flattened(rows)]
    return mechanics.moved(_correction(formulation, mechanics, flattened(rows), targets))


def project_velocities(scene: Scene, formulation: Formulation, variables: Any, t: Scalar) -> Any:
    """The velocities nearest to the given ones, in the metric of the mass matrix, that satisfy the
    rate of Phi = 0."""
    mechanics = formulation.coordinates.mechanics(scene, variables)
    rows = constraint_rows(scene, formulation.coordinates, mechanics.motions, t)
    if not rows:
        return variables
    targets = [-row_rate(row, mechanics.motions) for row in flattened(rows)]
    return mechanics.kicked(_correction(formulation, mechanics, flattened(rows), targets))


def is_constrained(scene: Scene, formulation: Formulation, variables: Any, t: Scalar) -> bool:
    """Whether any constraint is left to project onto."""

    def rows() -> dict[str, dict[str, Row]]:
        motions = formulation.coordinates.motions(scene, variables)
        return constraint_rows(scene, formulation.coordinates, motions, t)

    return bool(jax.eval_shape(rows))


def off_prescribed(
    scene: Scene, formulation: Formulation, variables: Any, t: Scalar
) -> Scalar | None:
    """The largest value of a constraint that depends on time, m or rad; ``None`` without any."""

    def values() -> list[Scalar]:
        motions = formulation.coordinates.motions(scene, variables)
        rows = flattened(constraint_rows(scene, formulation.coordinates, motions, t))
        return [jnp.abs(row.value) for row in rows if not is_zero(row.time_rate)]

    return functools.reduce(jnp.maximum, values()) if jax.eval_shape(values) else None


def _correction(
    formulation: Formulation, mechanics: AbstractMechanics, rows: list[Row], targets: list[Scalar]
) -> Speeds:
    """The change along the speeds by which each row changes by its target."""
    directions = [mechanics.projected(row.jacobian) for row in rows]
    return response(mechanics, directions, targets, formulation.solver())[0]
