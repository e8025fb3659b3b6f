"""What the constraints of a scene are like at a configuration: violations, rank, redundancy."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import jax
import numpy as np
from jaxtyping import Float, PyTree

from ..compilation import HostFirst
from ..fields.conversion import on_device
from ..math.vectors import Scalar, library, square_root, unpack
from ..model.bodies import State
from ..model.joints.base import ByLabel, Row
from ..model.scene import Scene
from ..native import NativeFunction, UnsupportedPrimitiveError
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
FEW = 16
"""Scenes whose constraints numpy evaluates; for more of them, native code is compiled."""


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

    >>> report = cj.constraint_report(*cj.mechanisms.bricard())
    >>> report.degrees_of_freedom(), len(report.redundant)
    (1, 1)
    """
    coordinates = AbsoluteCoordinates() if coordinates is None else coordinates
    values = _constraints_first_on_host(scene, coordinates, state, on_device(t))
    return _report(values, len(scene.bodies))


class StartRows(NamedTuple):
    """What decides of m constraints whether a run can start.

    - `values`, `rates`: (m,), as of `ConstraintReport`.
    - `names`: of those that the coordinates leave, and `left`, (n, s), their normalised rows.
    """

    values: np.ndarray
    rates: np.ndarray
    names: tuple[str, ...]
    left: np.ndarray


def start_rows(
    scene: Scene, coordinates: AbstractCoordinates, state: State, t: Scalar
) -> StartRows:
    """The constraints at a start, of scene and state in packed form.

    The names stand beside the rows: JAX sorts dictionaries, and which rows depend on those before
    them is a question of their order.
    """
    rows = constraints(scene, coordinates, state, t)
    jacobian, remaining = by_name(rows.jacobian), by_name(rows.remaining)
    left = [row / square_root((jacobian[name] ** 2).sum()) for name, row in remaining.items()]
    values, rates = (_stacked(list(by_name(tree).values())) for tree in (rows.values, rows.rates))
    return StartRows(values, rates, tuple(remaining), _stacked(left))


def _stacked(rows: list[jax.Array]) -> np.ndarray:
    return library(rows).stack(rows) if rows else np.zeros(0)


def start_rows_of_lanes(
    scene: Scene, varied: PyTree, states: State, t: Scalar, coordinates: AbstractCoordinates
) -> StartRows:
    """`start_rows` of many scenes and states that differ in numbers, these in front of each array.

    **Arguments:** `varied`: the scene with what varies of it, all values in front, ``None`` for the
    rest, which `scene` has; `states`: all initial states in front.
    """
    scenes = jax.tree.structure(scene).flatten_up_to(varied)
    starts = [None if (leaf == leaf[:1]).all() else leaf for leaf in jax.tree.leaves(states)]
    count, first = len(jax.tree.leaves(states)[0]), jax.tree.map(lambda leaf: leaf[0], states)
    columns = [*scenes, *[None] * len(jax.tree.leaves(coordinates)), *starts, None]
    arguments = scene, coordinates, first, np.asarray(t, float)
    alike = all(column is None for column in columns)
    if count > FEW and not alike:
        with suppress(UnsupportedPrimitiveError):
            return _start_rows.rows(arguments, columns)
    leaves, structure = jax.tree.flatten(arguments)
    found = [
        _start_rows_by_numpy(
            *jax.tree.unflatten(
                structure,
                [a if c is None else c[k] for a, c in zip(leaves, columns, strict=True)],
            )
        )
        for k in range(1 if alike else count)
    ]
    parts = zip(*((one.values, one.rates, one.left) for one in found), strict=True)
    values, rates, left = (
        np.broadcast_to(stacked, (count, *stacked.shape[1:])) for stacked in map(np.stack, parts)
    )
    return StartRows(values, rates, found[0].names, left)


class ConstraintRows(NamedTuple):
    """Constraint rows as arrays: values and rates (), Jacobian (v,).

    `remaining`: Jacobians (s,) by the s speeds of the coordinates, of the rows that these leave.
    """

    values: ByLabel[jax.Array]
    rates: ByLabel[jax.Array]
    jacobian: ByLabel[jax.Array]
    remaining: ByLabel[jax.Array]


def _report(arrays: ConstraintRows, bodies: int) -> ConstraintReport:
    """The rows with their rank."""
    rows = by_name(arrays.jacobian)
    names, matrix = tuple(rows), np.array([*rows.values()]).reshape(len(rows), 6 * bodies)
    scale = dict(zip(names, np.linalg.norm(matrix, axis=1), strict=True))
    remaining = by_name(arrays.remaining)
    left = np.array([np.asarray(row) / scale[name] for name, row in remaining.items()])
    redundant, uncertain = dependent(tuple(remaining), left, {})
    values, rates = (
        np.array([float(value) for value in by_name(tree).values()])
        for tree in (arrays.values, arrays.rates)
    )
    return ConstraintReport(names, values, rates, matrix, redundant, uncertain)


def dependent(
    names: tuple[str, ...], rows: np.ndarray, known: dict[bytes, np.ndarray]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The names of those normalised rows that depend on the ones before them, and of those that
    nearly do; `known` are the distances of rows seen before, and gets those of these."""
    key = rows.tobytes()
    if key not in known:
        known[key] = _distances(rows)
    apart = known[key]
    redundant = apart < RANK_TOLERANCE
    uncertain = (apart < UNCERTAIN_BELOW) & ~redundant
    return _chosen(names, redundant), _chosen(names, uncertain)


def _chosen(names: tuple[str, ...], chosen: np.ndarray) -> tuple[str, ...]:
    return tuple(name for name, is_chosen in zip(names, chosen, strict=True) if is_chosen)


def by_name(tree: ByLabel[T]) -> dict[str, T]:
    """What belongs to rows, by their names."""
    return {f"{joint}: {label}": row for joint, rows in tree.items() for label, row in rows.items()}


def constraints(
    scene: Scene, coordinates: AbstractCoordinates, state: State, t: Scalar
) -> ConstraintRows:
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
    return ConstraintRows(values, rates, jacobian, remaining)


_constraints_first_on_host = HostFirst(constraints)


_start_rows = NativeFunction(start_rows)
_start_rows_by_numpy = HostFirst(start_rows)


def _each(rows: ByLabel[Row], of: Callable[[Row], jax.Array]) -> ByLabel[jax.Array]:
    return {
        name: {label: of(row) for label, row in family.items()} for name, family in rows.items()
    }


def _distances(rows: np.ndarray) -> np.ndarray:
    """How far each row is from the span of the earlier ones, by orthogonalising one after the
    other."""
    basis: list[np.ndarray] = []
    distances = np.zeros(len(rows))
    for k, row in enumerate(rows):
        rest = row
        for _ in range(2):
            for direction in basis:
                rest = rest - (rest @ direction) * direction
        distances[k] = np.linalg.norm(rest)
        if distances[k] >= RANK_TOLERANCE:
            basis.append(rest / distances[k])
    return distances
