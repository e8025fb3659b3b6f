"""What the constraints of a scene are like at a configuration: violations, rank, redundancy."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..math.vectors import Scalar, unpack
from ..model.bodies import State
from ..model.joints.base import Row
from ..model.scene import Scene
from .absolute_coordinates import AbsoluteCoordinates
from .coordinates import AbstractCoordinates
from .equations_of_motion import constraint_rows
from .multipliers import row_rate, stacked

RANK_TOLERANCE = 1e-8
"""Distance of a normalised row from the span of the others below which it counts as dependent."""
UNCERTAIN_BELOW = 1e-5
"""Distance below which it is neither: the multipliers' equations have the square of it, and
rounding decides. At 1e-6 the angle of a four-bar with a skew hinge is off by 1e-3 in a second."""
TOGETHER = 256
"""Scenes whose constraints are evaluated at once; of fewer, the last is repeated."""


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
    found = _constraints_compiled(scene, coordinates, state, jnp.asarray(t, dtype=float))
    return _report(_Evaluated(*found), len(scene.bodies), {})


def constraint_reports(
    scene: Scene, varied: Any, states: Any, t: Any, coordinates: AbstractCoordinates
) -> Iterator[ConstraintReport]:
    """`constraint_report` of many scenes and states that differ in numbers, one after the other.

    **Arguments:** `varied`: the scene with what varies of it, all values in front, ``None`` for the
    rest, which `scene` has; `states`: all initial states in front.
    """
    count, known = len(jax.tree.leaves(states)[0]), {}
    padded = np.minimum(np.arange(-(-count // TOGETHER) * TOGETHER), count - 1)
    for block in padded.reshape(-1, TOGETHER):
        here = jax.tree.map(lambda leaf, block=block: leaf[block], (varied, states))
        found = jax.device_get(
            _constraints_together(scene, coordinates, *here, jnp.asarray(t, dtype=float))
        )
        for k in range(min(TOGETHER, count - block[0])):
            lane = _Evaluated(*jax.tree.map(lambda leaf, k=k: leaf[k], found))
            yield _report(lane, len(scene.bodies), known)


class _Evaluated(NamedTuple):
    """Constraints by joint and label; `remaining`: the rows that the coordinates leave."""

    values: dict[str, dict[str, Any]]
    rates: dict[str, dict[str, Any]]
    jacobian: dict[str, dict[str, Any]]
    remaining: dict[str, dict[str, Any]]


def _report(
    found: _Evaluated, bodies: int, known: dict[bytes, dict[str, float]]
) -> ConstraintReport:
    """What was evaluated, and its rank; `known` are the distances of rows seen before."""
    rows = _by_name(found.jacobian)
    names, matrix = tuple(rows), np.array([*rows.values()]).reshape(len(rows), 6 * bodies)
    scale = dict(zip(names, np.linalg.norm(matrix, axis=1), strict=True))
    left = {name: np.asarray(row) / scale[name] for name, row in _by_name(found.remaining).items()}
    key = b"".join(row.tobytes() for row in left.values())
    if key not in known:
        known[key] = _distances(left)
    apart = known[key]
    redundant = tuple(name for name, d in apart.items() if d < RANK_TOLERANCE)
    uncertain = tuple(n for n, d in apart.items() if RANK_TOLERANCE <= d < UNCERTAIN_BELOW)
    values, rates = (
        np.array([float(value) for value in _by_name(tree).values()])
        for tree in (found.values, found.rates)
    )
    return ConstraintReport(names, values, rates, matrix, redundant, uncertain)


def _by_name(tree: dict[str, dict[str, Any]]) -> dict[str, Any]:
    return {f"{joint}: {label}": row for joint, rows in tree.items() for label, row in rows.items()}


def _constraints(
    scene: Scene, coordinates: AbstractCoordinates, state: State, t: Scalar
) -> tuple[Any, Any, Any, Any]:
    scene, bodies = unpack(scene), unpack(state.bodies)
    absolute = AbsoluteCoordinates()
    mechanics = absolute.mechanics(scene, absolute.encode(scene, bodies))
    rows = constraint_rows(scene, absolute, mechanics.motions, t)
    values = _each(rows, lambda row: jnp.asarray(row.value))
    rates = _each(rows, lambda row: jnp.asarray(row_rate(row, mechanics.motions)))
    jacobian = _each(rows, lambda row: stacked(mechanics.projected(row.jacobian)))
    mechanics = coordinates.mechanics(scene, coordinates.encode(scene, bodies))
    rows = constraint_rows(scene, coordinates, mechanics.motions, t)
    remaining = _each(rows, lambda row: stacked(mechanics.projected(row.jacobian)))
    return values, rates, jacobian, remaining


_constraints_compiled = eqx.filter_jit(_constraints)


@eqx.filter_jit
def _constraints_together(
    scene: Scene, coordinates: AbstractCoordinates, varied: Any, states: Any, t: Scalar
) -> tuple[Any, Any, Any, Any]:
    def one(varied: Any, state: State) -> tuple[Any, Any, Any, Any]:
        return _constraints(eqx.combine(varied, scene), coordinates, state, t)

    return jax.vmap(one)(varied, states)


def _each(rows: dict[str, dict[str, Row]], of: Callable[[Row], Any]) -> dict[str, dict[str, Any]]:
    return {
        name: {label: of(row) for label, row in family.items()} for name, family in rows.items()
    }


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
