"""Violations, rank and redundancy of the constraints of a scene at a configuration."""

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

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
    rows = _start_rows_by_numpy(scene, coordinates, state, on_device(t))
    values, rates, jacobian, left = map(
        np.asarray, (rows.values, rows.rates, rows.jacobian, rows.left)
    )
    jacobian = jacobian.reshape(len(rows.all_names), 6 * len(scene.bodies))
    redundant, uncertain = dependent(rows.names, left, {})
    return ConstraintReport(rows.all_names, values, rates, jacobian, redundant, uncertain)


class StartRows(NamedTuple):
    """Constraint rows at an initial state.

    - `all_names`, `values`, `rates`, `jacobian`: of all m rows, as in `ConstraintReport`.
    - `names`, `left`: names, (n,), and normalised Jacobians, (n, s), by the s speeds of the
      coordinates, of the rows that these do not eliminate.
    """

    values: np.ndarray
    rates: np.ndarray
    jacobian: np.ndarray
    all_names: tuple[str, ...]
    names: tuple[str, ...]
    left: np.ndarray


def start_rows(
    scene: Scene, coordinates: AbstractCoordinates, state: State, t: Scalar
) -> StartRows:
    """Return the constraint rows at an initial state; scene and state in packed form.

    Rows are stacked in the order of their names. A dictionary would lose the order, since JAX sorts
    keys; but whether a row depends on the rows before it is a matter of order.
    """
    scene, bodies = unpack(scene), unpack(state.bodies)
    absolute = AbsoluteCoordinates()
    mechanics = absolute.mechanics(scene, absolute.encode(scene, bodies))
    rows = _by_name(constraint_rows(scene, absolute, mechanics.motions, t))
    values = [as_array([row.value])[0] for row in rows.values()]
    rates = [as_array([row_rate(row, mechanics.motions)])[0] for row in rows.values()]
    jacobian = {name: as_array(mechanics.projected(row.jacobian)) for name, row in rows.items()}
    mechanics = coordinates.mechanics(scene, coordinates.encode(scene, bodies))
    remaining = _by_name(constraint_rows(scene, coordinates, mechanics.motions, t))
    left = [
        as_array(mechanics.projected(row.jacobian)) / square_root((jacobian[name] ** 2).sum())
        for name, row in remaining.items()
    ]
    return StartRows(
        _stacked(values),
        _stacked(rates),
        _stacked(list(jacobian.values())),
        tuple(rows),
        tuple(remaining),
        _stacked(left),
    )


def _stacked(rows: list[jax.Array]) -> np.ndarray:
    return library(rows).stack(rows) if rows else np.zeros(0)


def _by_name(rows: ByLabel[Row]) -> dict[str, Row]:
    return {f"{joint}: {label}": row for joint, by in rows.items() for label, row in by.items()}


_start_rows = NativeFunction(start_rows)
_start_rows_by_numpy = HostFirst(start_rows)


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
    per_lane = [
        _start_rows_by_numpy(
            *jax.tree.unflatten(
                structure,
                [a if c is None else c[k] for a, c in zip(leaves, columns, strict=True)],
            )
        )
        for k in range(1 if alike else count)
    ]

    def stacked(parts: Iterable[np.ndarray]) -> np.ndarray:
        array = np.stack(list(parts))
        return np.broadcast_to(array, (count, *array.shape[1:]))

    return per_lane[0]._replace(
        values=stacked(rows.values for rows in per_lane),
        rates=stacked(rows.rates for rows in per_lane),
        jacobian=stacked(rows.jacobian for rows in per_lane),
        left=stacked(rows.left for rows in per_lane),
    )


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
