"""Violations, rank and redundancy of the constraints of a scene at a configuration."""

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
"""Distance below which a row is neither clearly independent nor dependent. The equations of the
multipliers contain its square, so rounding determines them: at 1e-6 the angle of a four-bar with a
skew hinge is wrong by 1e-3 after a second."""
FEW = 16
"""Largest number of scenes whose constraints NumPy evaluates; for more, native code is compiled."""


@dataclass(frozen=True)
class ConstraintReport:
    """Constraints at one configuration.

    - `names`: each row as "joint: label".
    - `values` and `rates`: (m,), Phi in m or 1, and its rate per second.
    - `jacobian`: (m, v), by velocities and body spins; v is six times the number of bodies.
    - `redundant`: names of the rows that depend on the rows before them.
    - `uncertain`: names of the rows that nearly do; no run can use them.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, " m"]
    rates: Float[np.ndarray, " m"]
    jacobian: Float[np.ndarray, "m v"]
    redundant: tuple[str, ...]
    uncertain: tuple[str, ...]

    def degrees_of_freedom(self) -> int:
        """Return six times the number of bodies minus the rank of the constraints."""
        return self.jacobian.shape[1] - len(self.names) + len(self.redundant)


def constraint_report(
    scene: Scene, state: State, t: Scalar = 0.0, coordinates: AbstractCoordinates | None = None
) -> ConstraintReport:
    """Evaluate the constraints of a scene at a state, and find the redundant ones.

    **Arguments:** `t`: s, for constraints that depend on time; `coordinates`: if given, redundancy
    is determined among the rows that these coordinates do not eliminate, otherwise among all rows,
    in their order.

    >>> report = cj.constraint_report(*cj.mechanisms.bricard())
    >>> report.degrees_of_freedom(), len(report.redundant)
    (1, 1)
    """
    coordinates = AbsoluteCoordinates() if coordinates is None else coordinates
    values = _constraints_first_on_host(scene, coordinates, state, on_device(t))
    return _report(values, len(scene.bodies))


class StartRows(NamedTuple):
    """Constraint rows for the checks before a run.

    - `values`, `rates`: (m,), as those of `ConstraintReport`.
    - `names`, `left`: names, (n,), and normalised Jacobians, (n, s), of the rows that the
      coordinates do not eliminate.
    """

    values: np.ndarray
    rates: np.ndarray
    names: tuple[str, ...]
    left: np.ndarray


def start_rows(
    scene: Scene, coordinates: AbstractCoordinates, state: State, t: Scalar
) -> StartRows:
    """Return the constraint rows at an initial state; scene and state in packed form.

    Rows are stacked in the order of `names`. A dictionary would lose the order, since JAX sorts
    keys; but whether a row depends on the rows before it is a matter of order.
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
    """Return `start_rows` of many scenes and states; each array with the axis of scenes first.

    **Arguments:** `varied`: the scene with all values of each varied number, axis of scenes first,
    and ``None`` for the numbers that `scene` has for all; `states`: all initial states, likewise.
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
    parts = zip(*((rows.values, rows.rates, rows.left) for rows in found), strict=True)
    values, rates, left = (
        np.broadcast_to(stacked, (count, *stacked.shape[1:])) for stacked in map(np.stack, parts)
    )
    return StartRows(values, rates, found[0].names, left)


class ConstraintRows(NamedTuple):
    """Constraint rows as arrays: values and rates (), Jacobian (v,) by velocities and spins.

    `remaining`: Jacobians (s,) by the s speeds of the coordinates, of the rows that these do not
    eliminate.
    """

    values: ByLabel[jax.Array]
    rates: ByLabel[jax.Array]
    jacobian: ByLabel[jax.Array]
    remaining: ByLabel[jax.Array]


def _report(arrays: ConstraintRows, bodies: int) -> ConstraintReport:
    """Return the report of the rows, with redundant ones determined."""
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
    """Return the names of normalised rows that depend on the rows before them, and of rows that
    nearly do.

    `known` caches the distances of rows by their bytes: scenes of a sweep often have equal rows.
    """
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
    """Return the entries of a dictionary by joint and label, with keys "joint: label"."""
    return {f"{joint}: {label}": row for joint, rows in tree.items() for label, row in rows.items()}


def constraints(
    scene: Scene, coordinates: AbstractCoordinates, state: State, t: Scalar
) -> ConstraintRows:
    """Return the constraint rows of a scene and state in packed form."""
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


def _each(rows: ByLabel[Row], function: Callable[[Row], jax.Array]) -> ByLabel[jax.Array]:
    return {
        name: {label: function(row) for label, row in family.items()}
        for name, family in rows.items()
    }


def _distances(rows: np.ndarray) -> np.ndarray:
    """Return the distance of each row from the span of the earlier ones, by Gram-Schmidt."""
    basis: list[np.ndarray] = []
    distances = np.zeros(len(rows))
    for k, row in enumerate(rows):
        rest = row
        for _ in range(2):  # the second pass removes rounding errors of the first
            for direction in basis:
                rest = rest - (rest @ direction) * direction
        distances[k] = np.linalg.norm(rest)
        if distances[k] >= RANK_TOLERANCE:
            basis.append(rest / distances[k])
    return distances
