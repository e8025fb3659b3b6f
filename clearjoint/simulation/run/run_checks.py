"""What is checked of a scene, a state and JAX before a run is compiled."""

import sys
from collections import Counter
from collections.abc import Callable, Hashable
from functools import reduce
from operator import and_

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import PyTree

from ...compilation.tracing import is_tracing
from ...dynamics.assembly import (
    ACCEPTED_VIOLATION,
    REPRESENTED,
    check_names,
    require_assembled,
    require_certain,
    require_representable,
    round_trip,
)
from ...dynamics.constraint_report import (
    StartRows,
    constraint_report,
    dependent,
    start_rows,
)
from ...dynamics.coordinates import AbstractCoordinates
from ...dynamics.formulation import Formulation
from ...dynamics.journals import FAR_OUTSIDE, contact_depths, require_in_bearings
from ...fields.caching import cached_by_numbers
from ...fields.checks import conditions_of, conditions_of_changes, recheck
from ...fields.conversion import with_arrays
from ...math.vectors import Condition, Scalar
from ...model.bodies import State
from ...model.scene import Scene
from ...native import NativeFunction, UnsupportedPrimitiveError, is_native
from ...native.functions import FlatArguments

BY_NUMPY = 8
"""Starts of one structure that numpy checks, in some milliseconds each, before native code is
compiled that takes microseconds."""
KEPT = 256
"""Starts of one structure of which the dependent constraints are remembered."""


def check_precision(allow_float32: bool) -> None:
    """Check that JAX computes in 64 bits, unless single precision is allowed."""
    if not (jax.config.jax_enable_x64 or allow_float32):  # pyright: ignore
        raise ValueError(
            "JAX is set to 32-bit floats, in which penetrations of micrometres drown: call "
            "clearjoint.configure() first, or pass Settings(allow_float32=True)."
        )


def is_traced(tree: PyTree) -> bool:
    """Whether JAX traces any of these, or everything: under `jax.jit` numbers need not be traced
    for what is computed from them to be. Then no value can be checked."""
    return is_tracing() or any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(tree))


def check_numbers(scene: Scene, state: State) -> None:
    """Check the numbers of a scene, and that a state is one of its."""
    _recheck(scene)
    check_names(scene, state)


def in_domain(check: Callable[[], None]) -> Condition | None:
    """Whether the numbers that JAX traces pass a check; ``None`` if it looks at none.

    Evaluated once, before the first step: the loop of steps is the same as without.
    """
    conditions = conditions_of(check)
    return reduce(jnp.logical_and, conditions) if conditions else None


def check_start(
    scene: Scene, state: State, start_time: Scalar, coordinates: AbstractCoordinates
) -> tuple[str, ...]:
    """Check the numbers of a run, and its state against the constraints; the names of those that
    are redundant."""
    if isinstance(scene, Scene) and isinstance(state, State):
        redundant = starts.redundant(scene, state, start_time, coordinates)
        if redundant is not None:
            return redundant
    check_numbers(scene, state)
    return check_structure(scene, state, start_time, coordinates)


def check_structure(
    scene: Scene, state: State, t: Scalar, coordinates: AbstractCoordinates
) -> tuple[str, ...]:
    """Check the state against the constraints; the names of those that are redundant."""
    if not scene.joints:
        return ()
    require_in_bearings(scene, state)
    report = constraint_report(scene, state, t, coordinates)
    require_assembled(report.names, report.values, report.rates)
    require_certain(report.uncertain)
    require_representable(scene, state, coordinates)
    return report.redundant


_recheck = cached_by_numbers(recheck)


def _beyond_doubt(
    scene: Scene, state: State, t: Scalar, coordinates: AbstractCoordinates
) -> tuple[Condition, StartRows | None, bool]:
    """Whether a start passes every check of `check_start` without a warning, but for what the
    constraints are that depend on each other; what tells these; and whether the checks of the
    scene's own numbers are among them, which those of classes from outside of this package aren't.
    """
    holds: list[Condition] = [*conditions_of(lambda: check_names(scene, state))]
    structure = jax.tree.structure(scene)
    numbers = conditions_of_changes(scene, structure, (True,) * structure.num_leaves)
    holds += [] if numbers is None else numbers
    if not scene.joints:
        return reduce(and_, holds, jnp.asarray(True)), None, numbers is not None
    depths = contact_depths.__wrapped__(scene, state.bodies)
    holds += [
        (depths[name][label] <= limit) & (depths[name][label] <= FAR_OUTSIDE * limit)
        for name, joint in scene.contact_joints().items()
        for label, limit in joint.deepest().items()
    ]
    rows = start_rows(scene, coordinates, state, t)
    holds += [(jnp.abs(part) <= ACCEPTED_VIOLATION).all() for part in (rows.values, rows.rates)]
    variables, held = round_trip.__wrapped__(scene, state, Formulation(coordinates))
    holds.append(jnp.asarray(bool(jax.tree.leaves(variables))))
    for name, body in state.bodies.items():
        given, same = body.orientation, held[name].orientation
        apart = jnp.minimum(jnp.abs(given - same).max(), jnp.abs(given + same).max())
        holds.append(apart < REPRESENTED)
    return reduce(and_, holds), rows, numbers is not None


class _Starts:
    """Native code that tells starts which are beyond doubt. All others are checked one thing after
    the other, so that an error names what is wrong."""

    def __init__(self) -> None:
        self._function = NativeFunction(_beyond_doubt)
        self._seen: Counter[Hashable] = Counter()
        self._distances: dict[Hashable, dict[bytes, np.ndarray]] = {}

    def count(self) -> int:
        """How many programs have been compiled."""
        return self._function.count()

    def redundant(
        self, scene: Scene, state: State, t: Scalar, coordinates: AbstractCoordinates
    ) -> tuple[str, ...] | None:
        """The names of the constraints that are redundant at a start beyond doubt; ``None`` for
        another one, and where no program tells, or none yet."""
        scene, state = with_arrays((scene, state))
        given = FlatArguments.of((scene, state, np.asarray(t, float), coordinates))
        self._seen[given.key] += 1
        if self._seen[given.key] <= BY_NUMPY or not is_native():
            return None
        try:
            fine, rows, with_numbers = self._function.run(given)
        except (UnsupportedPrimitiveError, ValueError):
            self._seen[given.key] = -sys.maxsize
            return None
        if not fine:
            return None
        if not with_numbers:
            _recheck(scene)
        if rows is None:
            return ()
        known = self._distances.setdefault(given.key, {})
        if len(known) > KEPT:
            known.clear()
        redundant, uncertain = dependent(rows.names, rows.left, known)
        return None if uncertain else redundant


starts = _Starts()
