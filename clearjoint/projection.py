"""Projection of positions and velocities onto the constraints, of least kinetic energy."""

from collections.abc import Callable
from typing import Any

import jax

from .coordinates import Motions, Speeds, response, row_rate
from .dynamics import Formulation, constraint_rows, flattened
from .joints.base import Row
from .scene import Scene
from .vectors import Scalar


def project_positions(scene: Scene, formulation: Formulation, variables: Any, t: Scalar) -> Any:
    """One Newton step of the positions towards Phi = 0, in the metric of the mass matrix."""
    change = _correction(scene, formulation, variables, t, lambda row, _: -row.value)
    if change is None:
        return variables
    return formulation.coordinates.moved(scene, variables, change)


def project_velocities(scene: Scene, formulation: Formulation, variables: Any, t: Scalar) -> Any:
    """The velocities nearest to the given ones, in the metric of the mass matrix, that satisfy the
    rate of Phi = 0."""
    change = _correction(
        scene, formulation, variables, t, lambda row, motions: -row_rate(row, motions)
    )
    if change is None:
        return variables
    return formulation.coordinates.kicked(scene, variables, change)


def is_constrained(scene: Scene, formulation: Formulation, variables: Any, t: Scalar) -> bool:
    """Whether any constraint is left to project onto."""

    def rows() -> dict[str, dict[str, Row]]:
        motions = formulation.coordinates.motions(scene, variables)
        return constraint_rows(scene, formulation.coordinates, motions, t)

    return bool(jax.eval_shape(rows))


def _correction(
    scene: Scene,
    formulation: Formulation,
    variables: Any,
    t: Scalar,
    target: Callable[[Row, Motions], Scalar],
) -> Speeds | None:
    """The change along the speeds by which each row changes by its target."""
    mechanics = formulation.coordinates.mechanics(scene, variables)
    rows = flattened(constraint_rows(scene, formulation.coordinates, mechanics.motions, t))
    if not rows:
        return None
    directions = [mechanics.projected(row.jacobian) for row in rows]
    targets = [target(row, mechanics.motions) for row in rows]
    return response(mechanics, directions, targets, formulation.solver())[0]
