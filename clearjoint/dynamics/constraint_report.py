"""What the constraints of a scene are like at a configuration: violations, rank, redundancy."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float, PyTree

from ..compilation import Compiled, HostFirst
from ..fields.conversion import on_device
from ..math.vectors import Scalar, unpack
from ..model.bodies import State
from ..model.joints.base import ByLabel, Row
from ..model.scene import Scene
from .absolute_coordinates import AbsoluteCoordinates
from .coordinates import AbstractCoordinates
from .equations_of_motion import constraint_rows
from .multipliers import as_array, row_rate

T = TypeVar("T")

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
    - `jacobian`: (m, v) by velocities and body spins; v is six times the number of bodies.
    - `redundant`: names of the rows that depend on those before them.
    - `uncertain`: names of those that nearly do; no run can use them.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, " m"]
    rates: Float[np.ndarray, " m"]
    jacobian: Float[np.ndarray, "m v"]
    redundant: tuple[str, ...]
    uncertain: tuple[str, ...]

    def degrees_of_freedom(self) -> int:
        """Six a body less the rank of the constraints."""
        return self.jacobian.shape[1] - len(self.names) + len(self.redundant)


def constraint_report(
    scene: Scene, state: State, t: Scalar = 0.0, coordinates: AbstractCoordinates | None = None
) -> ConstraintReport:
    """Evaluate the constraints of a scene, and find those that are redundant there.

    **Arguments:** `coordinates`: take the joints that these eliminate as given, and look for
    redundancy among the rows that remain. Otherwise among all, in their order.

    >>> report = cj.constraint_report(*cj.bricard())
    >>> report.degrees_of_freedom(), len(report.redundant)
    (1, 1)
    """
    coordinates = AbsoluteCoordinates() if coordinates is None else coordinates
    values = _constraints_first_on_host(scene, coordinates, state, on_device(t))
    return _report(values, len(scene.bodies), {})


def constraint_reports(
    scene: Scene, varied: PyTree, states: State, t: Scalar, coordinates: AbstractCoordinates
) -> Iterator[ConstraintReport]:
    """`constraint_report` of many scenes and states that differ in numbers, one after the other.

    **Arguments:** `varied`: the scene with what varies of it, all values in front, ``None`` for the
    rest, which `scene` has; `states`: all initial states in front.
    """
    count, known = len(jax.tree.leaves(states)[0]), {}
    padded = np.minimum(np.arange(-(-count // TOGETHER) * TOGETHER), count - 1)
    for block in padded.reshape(-1, TOGETHER):
        numbers, starts = jax.tree.map(lambda leaf, block=block: leaf[block], (varied, states))
        time = on_device(t)
        block_values = jax.device_get(
            _constraints_together(scene, coordinates, numbers, starts, time)
        )
        for k in range(min(TOGETHER, count - block[0])):
            lane = jax.tree.map(lambda leaf, k=k: leaf[k], block_values)
            yield _report(lane, len(scene.bodies), known)


class Rows(NamedTuple):
    """Constraint rows as arrays: values and rates (), Jacobian (v,).

    `remaining`: Jacobians (s,) by the s speeds of the coordinates, of the rows that these leave.
    """

    values: ByLabel[jax.Array]
    rates: ByLabel[jax.Array]
    jacobian: ByLabel[jax.Array]
    remaining: ByLabel[jax.Array]


def _report(arrays: Rows, bodies: int, known: dict[bytes, dict[str, float]]) -> ConstraintReport:
    """The rows with their rank; `known` are the distances of rows seen before, and gets theirs."""
    rows = by_name(arrays.jacobian)
    names, matrix = tuple(rows), np.array([*rows.values()]).reshape(len(rows), 6 * bodies)
    scale = dict(zip(names, np.linalg.norm(matrix, axis=1), strict=True))
    left = {name: np.asarray(row) / scale[name] for name, row in by_name(arrays.remaining).items()}
    redundant, uncertain = dependent(left, known)
    values, rates = (
        np.array([float(value) for value in by_name(tree).values()])
        for tree in (arrays.values, arrays.rates)
    )
    return ConstraintReport(names, values, rates, matrix, redundant, uncertain)


def dependent(
    rows: dict[str, np.ndarray], known: dict[bytes, dict[str, float]]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The names of those normalised rows that depend on the ones before them, and of those that
    nearly do; `known` are the distances of rows seen before, and gets those of these."""
    key = b"".join(row.tobytes() for row in rows.values())
    if key not in known:
        known[key] = _distances(rows)
    apart = known[key]
    redundant = tuple(name for name, d in apart.items() if d < RANK_TOLERANCE)
    uncertain = tuple(n for n, d in apart.items() if RANK_TOLERANCE <= d < UNCERTAIN_BELOW)
    return redundant, uncertain


def by_name(tree: ByLabel[T]) -> dict[str, T]:
    """What belongs to rows, by their names."""
    return {f"{joint}: {label}": row for joint, rows in tree.items() for label, row in rows.items()}


def constraints(scene: Scene, coordinates: AbstractCoordinates, state: State, t: Scalar) -> Rows:
    """The constraints of a scene and state in packed form."""
    scene, bodies = unpack(scene), unpack(state.bodies)
    absolute = AbsoluteCoordinates()
    mechanics = absolute.mechanics(scene, absolute.encode(scene, bodies))
    rows = constraint_rows(scene, absolute, mechanics.motions, t)
    values = _each(rows, lambda row: as_array([row.value])[0])
    rates = _each(rows, lambda row: as_array([row_rate(row, mechanics.motions)])[0])
    jacobian = _each(rows, lambda row: as_array(mechanics.projected(row.jacobian)))
    mechanics = coordinates.mechanics(scene, coordinates.encode(scene, bodies))
    rows = constraint_rows(scene, coordinates, mechanics.motions, t)
    remaining = _each(rows, lambda row: as_array(mechanics.projected(row.jacobian)))
    return Rows(values, rates, jacobian, remaining)


_constraints_first_on_host = HostFirst(constraints)


@partial(Compiled, effort="least")
def _constraints_together(
    scene: Scene, coordinates: AbstractCoordinates, varied: PyTree, states: State, t: Scalar
) -> Rows:
    def one(varied: PyTree, state: State) -> Rows:
        return constraints(eqx.combine(varied, scene), coordinates, state, t)

    return jax.vmap(one)(varied, states)


def _each(rows: ByLabel[Row], of: Callable[[Row], jax.Array]) -> ByLabel[jax.Array]:
    return {
        name: {label: of(row) for label, row in family.items()} for name, family in rows.items()
    }


def _distances(rows: dict[str, np.ndarray]) -> dict[str, float]:
    """How far each row is from the span of the earlier ones, by orthogonalising one after the
    other."""
    basis: list[np.ndarray] = []
    distances = {}
    for name, row in rows.items():
        rest = row
        for _ in range(2):
            for direction in basis:
                rest = rest - (rest @ direction) * direction
        distances[name] = float(np.linalg.norm(rest))
        if distances[name] >= RANK_TOLERANCE:
            basis.append(rest / distances[name])
    return distances
