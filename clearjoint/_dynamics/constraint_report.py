"""Values, rank and redundancy of constraint rows, scalar equations Phi = 0, in a state."""

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import compress
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float, PyTree

from .._compilation.xla import HostFirst
from .._fields.checks import (
    checkable,
    nearest,
    require,
    require_finite,
    require_shape,
    require_type,
)
from .._fields.objects import on_device
from .._math.smoothing import where
from .._math.vectors import Scalar, library, square_root, unpack
from .._model.bodies import GROUND, BodyState, State
from .._model.joints.base import ByLabel, Motions, Row
from .._model.joints.constraint_rows import row_rate
from .._model.scene import Scene, require_scene
from .._native import NativeFunction, UnsupportedPrimitiveError
from .absolute_coordinates import AbsoluteCoordinates
from .coordinates import AbstractCoordinates
from .equations_of_motion import constraint_rows
from .multipliers import as_array

RANK_TOLERANCE = 1e-8
"""Distance of a normalised constraint row from the span of the rows before it, below which it
counts as dependent on them: far above rounding errors."""
UNCERTAIN_BELOW = 1e-5
"""Distance below which a row that is not dependent counts as nearly dependent. The equations for
the multipliers contain the square of this distance, so that rounding errors determine the
multipliers: at 1e-6, the angle of a four-bar with a skew hinge is wrong by 1e-3 rad after 1 s."""
FEW = 16
"""Largest number of scenes that NumPy evaluates one by one; for more, native code is compiled."""


@dataclass(frozen=True)
class ConstraintReport:
    """Constraints of a scene in one state: m constraint rows, and v = 6 times the number of bodies.

    - `names`: m strings, each "joint: label", in the scene's order of joints.
    - `values`: (m,), Phi, in m, rad or without unit; `rates`: (m,), their time derivatives.
    - `jacobian`: (m, v), derivatives of the rates by the velocity (m/s, global) and the spin
      (rad/s, body axes) of each body, in the order of `bodies`.
    - `redundant`: names of the rows that depend linearly on rows before them.
    - `uncertain`: names of the rows that nearly depend on rows before them. No run can start with
      such rows, since rounding errors would determine their reactions.

    `redundant` and `uncertain` leave out the rows that the argument `coordinates` of
    `constraint_report` eliminates.
    """

    bodies: tuple[str, ...]
    names: tuple[str, ...]
    values: Float[np.ndarray, " m"]
    rates: Float[np.ndarray, " m"]
    jacobian: Float[np.ndarray, "m v"]
    redundant: tuple[str, ...]
    uncertain: tuple[str, ...]

    def columns(self, bodies: Sequence[str]) -> Float[np.ndarray, "m v"]:
        """Return the columns of `jacobian` that belong to some bodies, six for each."""
        for name in bodies:
            remedy = nearest(name, self.bodies, "correct the name")
            require(name in self.bodies, "bodies", name, f"names of {self.bodies}", remedy)
        return self.jacobian[:, _columns(self.bodies, bodies)]

    def degrees_of_freedom(self) -> int:
        """Return six times the number of bodies minus the number of independent constraint rows."""
        return self.jacobian.shape[1] - len(self.names) + len(self.redundant)


def check_names(scene: Scene, state: State) -> None:
    """Check that `scene` is a `Scene` and `state` a `State` with the same bodies, that the state's
    numbers are finite, and that its Euler parameters have about unit norm."""
    require_scene(scene)
    require_type("state", state, State, "a State", "pass State({name: body_state(...)})")
    same, expected = set(state.bodies) == set(scene.bodies), sorted(scene.bodies)
    remedy = "give each body of the scene one state, under the same name"
    require(same, "state", sorted(state.bodies), f"of the scene's bodies {expected}", remedy)
    for name, body in state.bodies.items():
        for field in ("position", "orientation", "velocity", "spin"):
            require_finite(f"state.bodies[{name!r}].{field}", getattr(body, field))
        # Numbers that JAX traces can't be checked: `checkable` then returns ``None``.
        if (arrays := checkable(body.orientation)) is not None:
            (parameters,) = arrays
            norm, argument = (parameters**2).sum() ** 0.5, f"state.bodies[{name!r}].orientation"
            # The margin is wide: the norm drifts in a run, and rotations do not depend on it.
            is_near = (norm > 0.9) & (norm < 1.1)
            expected = "Euler parameters of about unit norm, scalar part first"
            remedy = "make states with body_state(...), which checks them"
            require(is_near, argument, parameters, expected, remedy)
    for part in ("entry_speeds", "work", "bristles", "memory"):
        shape, remedy = ((3,), "(3,) m") if part == "bristles" else ((), "one number")
        for leaf in jax.tree.leaves(getattr(state, part)):
            require_shape(f"state.{part}", leaf, shape, f"give each as {remedy}")


def constraint_report(
    scene: Scene, state: State, t: Scalar = 0.0, coordinates: AbstractCoordinates | None = None
) -> ConstraintReport:
    """Evaluate the constraints of a scene in a state, and find the redundant ones: those that
    depend linearly on constraints before them, at time `t`, s.

    With `coordinates`, redundancy is determined among the constraint equations that these
    coordinates do not eliminate; by default among all of them.

    >>> report = cj.constraint_report(*cj.mechanisms.bricard())
    >>> report.degrees_of_freedom(), len(report.redundant)
    (1, 1)
    """
    check_names(scene, state)
    require_shape("t", t, (), "pass one time in s")
    coordinates = AbsoluteCoordinates() if coordinates is None else coordinates
    remedy = "pass JointCoordinates(), say, or None"
    require_type("coordinates", coordinates, AbstractCoordinates, "coordinates", remedy)
    rows = start_rows_by_numpy(scene, coordinates, state, on_device(t), with_jacobian=True)
    rows = rows.in_order_of(scene)
    redundant, uncertain = dependent(rows.names, rows.reduced, {})
    assert rows.jacobian is not None
    return ConstraintReport(
        rows.bodies, rows.texts(), rows.values, rows.rates, rows.jacobian, redundant, uncertain
    )


RowName = tuple[str, str]
"""Name of a joint, and label of one of its constraint rows."""


def _text(row: RowName) -> str:
    return ": ".join(row)


def _columns(bodies: Sequence[str], wanted: Iterable[str]) -> list[int]:
    return [6 * bodies.index(name) + k for name in wanted for k in range(6)]


class StartRows(NamedTuple):
    """Constraint rows of a scene in an initial state, as arrays, for the checks before a run.

    - `values`, `rates`: of all m rows, as in `ConstraintReport`; `all_names`: their names.
    - `bodies`: names of the bodies in the order of the columns of `jacobian`.
    - `names`: names of the n rows that the coordinates do not eliminate.
    - `reduced`: (n, speeds of the coordinates), derivatives of these rows' rates by the speeds,
      each row divided by the norm of the same row of `jacobian`.
    - `jacobian`: of all rows, as in `ConstraintReport`; ``None`` unless it was asked for.

    Arrays without rows have the shape (0,). Rows and columns from JAX or native code, which sort
    dictionaries, are in the order of names, until `in_order_of` restores the order of the scene.
    """

    values: np.ndarray
    rates: np.ndarray
    all_names: tuple[RowName, ...]
    bodies: tuple[str, ...]
    names: tuple[RowName, ...]
    reduced: np.ndarray
    jacobian: np.ndarray | None

    def texts(self) -> tuple[str, ...]:
        """Return the names of all rows, each as "joint: label"."""
        return tuple(map(_text, self.all_names))

    def in_order_of(self, scene: Scene) -> "StartRows":
        """Return the rows in the scene's order of joints, and the columns in its order of bodies,
        so that names do not decide which of several dependent rows count as redundant."""
        # Indices of all rows, and indices among those that the coordinates do not eliminate.
        order, reduced_order = scene_order(self.all_names, scene), scene_order(self.names, scene)
        bodies, jacobian = tuple(scene.bodies), self.jacobian
        if jacobian is not None:
            # Without rows, the array has lost its second axis.
            jacobian = np.asarray(jacobian).reshape(len(order), 6 * len(bodies))
            jacobian = jacobian[order][:, _columns(self.bodies, bodies)]
        return StartRows(
            values=np.asarray(self.values)[order],
            rates=np.asarray(self.rates)[order],
            all_names=tuple(self.all_names[k] for k in order),
            bodies=bodies,
            names=tuple(self.names[k] for k in reduced_order),
            reduced=np.asarray(self.reduced)[reduced_order],
            jacobian=jacobian,
        )


def scene_order(names: tuple[RowName, ...], scene: Scene) -> list[int]:
    """Return the indices of rows with given names, sorted by the scene's order of joints."""
    rank = {name: k for k, name in enumerate(scene.joints)}
    return sorted(range(len(names)), key=lambda k: rank[names[k][0]])


def row_residuals(scene: Scene, state: State, t: Scalar) -> StartRows:
    """Return all constraint rows of a scene at the time `t`, s, with values and rates, but without
    Jacobians, so that the time of the computation is proportional to the number of rows."""
    return start_rows_by_numpy(scene, None, state, on_device(t)).in_order_of(scene)


def start_rows(
    scene: Scene,
    coordinates: AbstractCoordinates | None,
    state: State,
    t: Scalar,
    with_jacobian: bool = False,
    motions: Motions | None = None,
) -> StartRows:
    """Return all constraint rows in a state, and the `reduced` rows that `coordinates` do not
    eliminate: none if `coordinates` is ``None``. Scene and state have vectors as arrays (3,). A
    Jacobian takes memory in proportion to the square of the number of bodies. `motions` is the
    result of `free_motions`; ``None``, the default, if it is still to be computed."""
    scene, bodies = unpack(scene), unpack(state.bodies)
    absolute = AbsoluteCoordinates()
    motions = free_motions(scene, bodies) if motions is None else motions
    by_joint = constraint_rows(scene, absolute, motions, t)
    rows = _by_name(by_joint)
    # `as_array` also takes Python numbers, such as a rate of exactly zero.
    values = [as_array([row.value])[0] for row in rows.values()]
    rates = [as_array([row_rate(row, motions)])[0] for row in rows.values()]
    jacobian = None
    if with_jacobian:
        # The speeds of absolute coordinates are the velocities and spins of the bodies.
        mechanics = absolute.mechanics(scene, absolute.encode(scene, bodies))
        jacobian = _stacked([as_array(mechanics.projected(row.jacobian)) for row in rows.values()])
    names, reduced = [], []
    # In a scene of trees, joint coordinates leave no rows, and nothing further is computed.
    if coordinates is not None and not by_joint.keys() <= coordinates.eliminated(scene):
        mechanics = coordinates.mechanics(scene, coordinates.encode(scene, bodies))
        remaining = constraint_rows(scene, coordinates, mechanics.motions, t)
        for name, row in _by_name(remaining).items():
            names.append(name)
            # A row that the coordinates nearly satisfy by themselves stays small (see `_norm`).
            reduced.append(as_array(mechanics.projected(row.jacobian)) / _norm(rows[name]))
    return StartRows(
        values=_stacked(values),
        rates=_stacked(rates),
        all_names=tuple(rows),
        bodies=tuple(scene.bodies),
        names=tuple(names),
        reduced=_stacked(reduced),
        jacobian=jacobian,
    )


def free_motions(scene: Scene, bodies: dict[str, BodyState]) -> Motions:
    """Return the motion of each body by its own state, as if there were no joints, since the state
    may violate the constraints."""
    absolute = AbsoluteCoordinates()
    return absolute.motions(scene, absolute.encode(scene, bodies))


def _norm(row: Row) -> Scalar:
    """Return the norm of a row's Jacobian in absolute coordinates; one if the norm is zero, as in a
    singular position. `start_rows` divides the row's Jacobian in the chosen coordinates by it. If
    these coordinates nearly satisfy the row, the quotient is small: the row counts as dependent.
    """
    wrenches = [wrench for name, wrench in row.jacobian.items() if name != GROUND]
    square = sum(v.dot(v) for wrench in wrenches for v in (wrench.force, wrench.moment))
    return square_root(where(square > 0.0, square, 1.0))


def _stacked(rows: list[jax.Array]) -> np.ndarray:
    return library(rows).stack(rows) if rows else np.zeros(0)


def _by_name(rows: ByLabel[Row]) -> dict[RowName, Row]:
    return {(joint, label): row for joint, by in rows.items() for label, row in by.items()}


# The first evaluates many scenes in compiled native code, the second one scene, by NumPy if it can.
_start_rows = NativeFunction(start_rows)
start_rows_by_numpy = HostFirst(start_rows)


def start_rows_of_lanes(
    scene: Scene, varied: PyTree, states: State, t: Scalar, coordinates: AbstractCoordinates
) -> StartRows:
    """Return the constraint rows of `start_rows` for the N runs of a sweep, with a further first
    axis of length N in each array. `varied` is a PyTree like `scene`, with an array of N values for
    each number that varies and ``None`` for others; `states` have the axis of length N first."""
    count = len(jax.tree.leaves(states)[0])
    first_state = jax.tree.map(lambda leaf: leaf[0], states)
    arguments = scene, coordinates, first_state, np.asarray(t, float)
    # For each leaf of `arguments`, in their order: the array of its N values, or None if the leaf
    # is the same in all runs.
    columns = [
        *jax.tree.structure(scene).flatten_up_to(varied),
        *[None] * len(jax.tree.leaves(coordinates)),
        *[None if (leaf == leaf[:1]).all() else leaf for leaf in jax.tree.leaves(states)],
        None,
    ]
    # Native code, which takes time to compile, evaluates many runs. A few runs are evaluated one by
    # one, and so are those whose user-defined joints use a primitive that native code lacks.
    all_equal = all(column is None for column in columns)
    if count > FEW and not all_equal:
        with suppress(UnsupportedPrimitiveError):
            return _start_rows.rows(arguments, columns)
    leaves, structure = jax.tree.flatten(arguments)

    def of_run(number: int) -> StartRows:
        pairs = zip(leaves, columns, strict=True)
        leaves_of_run = [leaf if column is None else column[number] for leaf, column in pairs]
        return start_rows_by_numpy(*jax.tree.unflatten(structure, leaves_of_run))

    # If all scenes and states are equal, one evaluation serves them all.
    per_run = [of_run(number) for number in range(1 if all_equal else count)]

    def stacked(field: str) -> np.ndarray:
        array = np.stack([getattr(rows, field) for rows in per_run])
        # The single evaluation of equal runs is repeated for each of them.
        return np.broadcast_to(array, (count, *array.shape[1:]))

    arrays = {name: stacked(name) for name in ("values", "rates", "reduced")}
    return per_run[0]._replace(**arrays)


def dependent(
    names: tuple[RowName, ...], rows: np.ndarray, cache: dict[bytes, np.ndarray]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names "joint: label" of the `rows`, (n, s), that depend linearly on rows before
    them, and of the rows that nearly do. `cache` maps the bytes of rows to the result of
    `_distances`, which other scenes of a sweep with equal rows use again; it is changed."""
    key = rows.tobytes()
    if key not in cache:
        cache[key] = _distances(rows)
    apart = cache[key]
    redundant = apart < RANK_TOLERANCE
    uncertain = (apart < UNCERTAIN_BELOW) & ~redundant
    texts = [*map(_text, names)]
    return tuple(compress(texts, redundant)), tuple(compress(texts, uncertain))


def _distances(rows: np.ndarray) -> np.ndarray:
    """Return the distance, (n,), of each row, (n, s), from the span of the independent rows before
    it, by the Gram-Schmidt process."""
    basis, count = np.empty_like(rows), 0
    distances = np.zeros(len(rows))
    for k, row in enumerate(rows):
        normal_part, directions = row, basis[:count]
        for _ in range(2):  # the second pass removes rounding errors of the first
            normal_part = normal_part - (directions @ normal_part) @ directions
        distances[k] = np.linalg.norm(normal_part)
        # A dependent row adds no direction to the span.
        if distances[k] >= RANK_TOLERANCE:
            basis[count] = normal_part / distances[k]
            count += 1
    return distances
