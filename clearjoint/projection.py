"""Projection of positions and velocities onto the constraints, of least kinetic energy."""

from typing import Any

from .coordinates import row_rate
from .dynamics import Formulation, constraint_rows, flattened
from .scene import Scene
from .vectors import Scalar


def project_positions(scene: Scene, formulation: Formulation, variables: Any, t: Scalar) -> Any:
    """One Newton step of the positions towards Phi = 0, in the metric of the mass matrix."""
    motions = formulation.coordinates.motions(scene, variables)
    rows = flattened(constraint_rows(scene, motions, t))
    change, _ = formulation.coordinates.response(
        scene, motions, rows, [-row.value for row in rows], formulation.solver()
    )
    return formulation.coordinates.moved(scene, variables, change)


def project_velocities(scene: Scene, formulation: Formulation, variables: Any, t: Scalar) -> Any:
    """The velocities nearest to the given ones, in the metric of the mass matrix, that satisfy the
    rate of Phi = 0."""
    motions = formulation.coordinates.motions(scene, variables)
    rows = flattened(constraint_rows(scene, motions, t))
    change, _ = formulation.coordinates.response(
        scene, motions, rows, [-row_rate(row, motions) for row in rows], formulation.solver()
    )
    return formulation.coordinates.kicked(variables, change)
