"""What the constraints of a scene are like at a configuration: violations, rank, redundancy."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .absolute import AbsoluteCoordinates
from .bodies import State
from .coordinates import AbstractCoordinates, row_rate, stacked
from .dynamics import constraint_rows, flattened
from .joints.base import Row
from .scene import Scene
from .vectors import Scalar, unpack

RANK_TOLERANCE = 1e-8
"""Distance of a normalised row from the span of the others below which it counts as dependent."""
UNCERTAIN_BELOW = 1e-5
"""Distance below which it is neither: the multipliers' equations have the square of it, and
rounding decides. At 1e-6 the angle of a four-bar with a skew hinge is off by 1e-3 in a second."""


@dataclass(frozen=True)
class ConstraintReport:
    """Constraints at one configuration.

    - `names`: each row as "joint: label".
    - `values` and `rates`: (m,) Phi and its rate, m or 1, and per second.
    - `jacobian`: (m, 6 bodies) with respect to velocities and body spins.
    - `redundant`: names of the rows that depend on those before them.
    - `uncertain`: names of those that nearly do; no run can use them.
    """

    names: tuple[str, ...]
    values: np.ndarray
    rates: np.ndarray
    jacobian: np.ndarray
    redundant: tuple[str, ...]
    uncertain: tuple[str, ...]

    def degrees_of_freedom(self) -> int:
        """Six a body less the rank of the constraints."""
        return self.jacobian.shape[1] - len(self.names) + len(self.redundant)


def constraint_report(
    scene: Scene, state: State, t: Any = 0.0, coordinates: AbstractCoordinates | None = None
) -> ConstraintReport:
    """Evaluate the constraints of a scene, and find those that are redundant there.

    **Arguments:** `coordinates`: take the joints that these eliminate as given, and look for
    redundancy among the rows that remain. Otherwise among all, in their order.
    """
    coordinates = AbsoluteCoordinates() if coordinates is None else coordinates
    values, rates, jacobian, remaining = _constraints(
        scene, coordinates, state, jnp.asarray(t, dtype=float)
    )
    names = tuple(f"{joint}: {label}" for joint, family in values.items() for label in family)
    matrix = np.asarray(jacobian).reshape(len(names), 6 * len(scene.bodies))
    scale = {name: np.linalg.norm(row) for name, row in zip(names, matrix, strict=True)}
    left = {
        f"{joint}: {label}": np.asarray(row)
        for joint, family in remaining.items()
        for label, row in family.items()
    }
    apart = _distances({name: row / scale[name] for name, row in left.items()})
    redundant = tuple(name for name, d in apart.items() if d < RANK_TOLERANCE)
    uncertain = tuple(n for n, d in apart.items() if RANK_TOLERANCE <= d < UNCERTAIN_BELOW)
    return ConstraintReport(names, _flat(values), _flat(rates), matrix, redundant, uncertain)


@eqx.filter_jit
def _constraints(
    scene: Scene, coordinates: AbstractCoordinates, state: State, t: Scalar
) -> tuple[Any, Any, Any, Any]:
    scene, bodies = unpack(scene), unpack(state.bodies)
    absolute = AbsoluteCoordinates()
    mechanics = absolute.mechanics(scene, absolute.encode(scene, bodies))
    rows = constraint_rows(scene, absolute, mechanics.motions, t)
    values = _each(rows, lambda row: jnp.asarray(row.value))
    rates = _each(rows, lambda row: jnp.asarray(row_rate(row, mechanics.motions)))
    flat = [stacked(mechanics.projected(row.jacobian)) for row in flattened(rows)]
    jacobian = jnp.stack(flat) if flat else jnp.zeros((0, 6 * len(scene.bodies)))
    mechanics = coordinates.mechanics(scene, coordinates.encode(scene, bodies))
    rows = constraint_rows(scene, coordinates, mechanics.motions, t)
    remaining = _each(rows, lambda row: stacked(mechanics.projected(row.jacobian)))
    return values, rates, jacobian, remaining


def _each(rows: dict[str, dict[str, Row]], of: Callable[[Row], Any]) -> dict[str, dict[str, Any]]:
    return {
        name: {label: of(row) for label, row in family.items()} for name, family in rows.items()
    }


def _flat(tree: dict[str, dict[str, Any]]) -> np.ndarray:
    return np.array([float(leaf) for family in tree.values() for leaf in family.values()])


def _distances(rows: dict[str, np.ndarray]) -> dict[str, float]:
    """How far each row is from the span of the earlier ones, by orthogonalising one after the
    other."""
    basis: list[np.ndarray] = []
    found = {}
    for name, row in rows.items():
        rest = row
        for _ in range(2):
            for direction in basis:
                rest = rest - (rest @ direction) * direction
        found[name] = float(np.linalg.norm(rest))
        if found[name] >= RANK_TOLERANCE:
            basis.append(rest / found[name])
    return found
