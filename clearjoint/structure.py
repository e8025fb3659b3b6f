"""What the constraints of a scene are like at a configuration: violations, rank, redundancy."""

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .bodies import State
from .coordinates import row_rate
from .dynamics import Formulation, constraint_rows
from .joints.base import Row
from .scene import Scene
from .vectors import Scalar, Vector, pack, unpack

RANK_TOLERANCE = 1e-8


@dataclass(frozen=True)
class ConstraintReport:
    """Constraints at one configuration.

    - `names`: each row as "joint: label".
    - `values` and `rates`: (m,) Phi and its rate, m or 1, and per second.
    - `jacobian`: (m, 6 bodies) with respect to velocities and body spins.
    - `redundant`: names of the rows that depend on those before them.
    """

    names: tuple[str, ...]
    values: np.ndarray
    rates: np.ndarray
    jacobian: np.ndarray
    redundant: tuple[str, ...]

    def degrees_of_freedom(self) -> int:
        """Six a body less the rank of the constraints."""
        return self.jacobian.shape[1] - len(self.names) + len(self.redundant)


def constraint_report(
    scene: Scene, state: State, t: Any = 0.0, formulation: Formulation | None = None
) -> ConstraintReport:
    """Evaluate the constraints of a scene, and find those that are redundant there."""
    formulation = Formulation() if formulation is None else formulation
    values, rates, jacobian = _constraints(scene, formulation, state, jnp.asarray(t, dtype=float))
    names = tuple(f"{joint}: {label}" for joint, family in values.items() for label in family)
    matrix = np.asarray(jacobian).reshape(len(names), 6 * len(scene.bodies))
    dependent = _dependent_rows(matrix)
    return ConstraintReport(
        names, _flat(values), _flat(rates), matrix, tuple(names[k] for k in dependent)
    )


@eqx.filter_jit
def _constraints(
    scene: Scene, formulation: Formulation, state: State, t: Scalar
) -> tuple[Any, Any, Any]:
    scene, state = unpack(scene), unpack(state)
    variables = formulation.coordinates.encode(scene, state.bodies)
    motions = formulation.coordinates.motions(scene, variables)
    rows = constraint_rows(scene, motions, t)
    values = {
        name: {label: jnp.asarray(row.value) for label, row in family.items()}
        for name, family in rows.items()
    }
    rates = {
        name: {label: jnp.asarray(row_rate(row, motions)) for label, row in family.items()}
        for name, family in rows.items()
    }
    flat = [_dense(row, scene) for family in rows.values() for row in family.values()]
    return values, rates, jnp.stack(flat) if flat else jnp.zeros((0, 6 * len(scene.bodies)))


def _dense(row: Row, scene: Scene) -> Any:
    zero = pack(Vector(0.0, 0.0, 0.0))
    parts = []
    for name in scene.bodies:
        pair = row.jacobian.get(name)
        parts += [zero, zero] if pair is None else [pack(pair.force), pack(pair.moment)]
    return jnp.concatenate(parts)


def _flat(tree: dict[str, dict[str, Any]]) -> np.ndarray:
    return np.array([float(leaf) for family in tree.values() for leaf in family.values()])


def _dependent_rows(matrix: np.ndarray) -> list[int]:
    """Rows that are combinations of earlier ones, by orthogonalising one after the other."""
    basis: list[np.ndarray] = []
    dependent = []
    for index, row in enumerate(matrix):
        size = float(np.linalg.norm(row))
        rest = row / size if size > 0 else row
        for _ in range(2):
            for direction in basis:
                rest = rest - (rest @ direction) * direction
        length = float(np.linalg.norm(rest))
        if length < RANK_TOLERANCE:
            dependent.append(index)
        else:
            basis.append(rest / length)
    return dependent
