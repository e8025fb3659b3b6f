"""Checks of a scene, an initial state, settings and JAX's precision before a run.

A start is a scene with an initial state, a start time and coordinates. Most checks of starts run in
Python. For scenes that are run many times, a compiled native program does the same checks faster.
Starts have the same structure if they differ only in their numbers.
"""

import sys
from collections import Counter
from collections.abc import Callable, Hashable
from dataclasses import replace
from functools import reduce
from operator import and_
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import PyTree

from ..._compilation.xla import HostFirst, is_tracing
from ..._dynamics import assembly, constraint_report
from ..._dynamics.constraint_report import check_names
from ..._dynamics.coordinates import AbstractCoordinates, MotionVariables
from ..._dynamics.journals import FAR_OUTSIDE, FAST_APPROACH, require_in_bearings, starting_contacts
from ..._fields.caching import cached_by_numbers
from ..._fields.cautions import number_issued, warns
from ..._fields.checks import conditions_of, recheck, recheck_changes, require
from ..._fields.leaves import with_leaves
from ..._fields.objects import array_leaves, on_device
from ..._math.vectors import Condition, ConstantFolded, Scalar, unpack
from ..._model.bodies import State
from ..._model.joints.base import ByLabel
from ..._model.scene import Scene
from ..._native import NativeFunction, UnsupportedPrimitiveError, is_native
from ..._native.functions import FlatArguments, flattened, folded, of_leaves
from ..._native.machine_code import RecentPrograms
from ..step.dense_output import require_dense
from ..step.discontinuities import require_declared
from ..step.method import Scheme
from ..step.settings import Settings

BY_NUMPY = 16
"""Number of starts of the same structure that are checked in Python, before a native program is
compiled, which checks each in microseconds. Compiling takes as long as thirty checks of a pendulum,
or fourteen of a chain of thirty joints."""
KEPT = 256
"""Largest number of starts of one structure whose redundant constraints are cached."""


def check_precision(allow_float32: bool) -> None:
    if not (jax.config.jax_enable_x64 or allow_float32):  # pyright: ignore
        raise ValueError(
            "JAX is set to 32-bit floats, which cannot resolve penetrations of micrometres: call "
            "clearjoint.configure() first, or pass Settings(allow_float32=True)."
        )


def is_traced(tree: PyTree) -> bool:
    """Return whether JAX traces a leaf of a PyTree. Inside a transformation, the result is ``True``
    for every PyTree: under `jax.jit`, results of computations with known numbers are traced too."""
    return is_tracing() or any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(tree))


def check_numbers(scene: Scene, state: State) -> None:
    """Check that the numbers of a scene satisfy the conditions of its constructors, and that a
    state has exactly the scene's bodies and finite numbers, with Euler parameters of about unit
    norm, or raise a `ValueError`. Traced numbers raise no error; see `in_domain`."""
    _recheck(scene)
    check_names(scene, state)


def in_domain(check: Callable[[], None]) -> Condition | None:
    """Return whether traced numbers pass a `check`; ``None`` if it meets none. A run that is traced
    cannot raise errors, so its program evaluates this condition before the first step."""
    conditions = conditions_of(check)
    return reduce(jnp.logical_and, conditions) if conditions else None


def check_start(
    scene: Scene,
    state: State,
    start_time: Scalar,
    coordinates: AbstractCoordinates,
    flat: FlatArguments | None = None,
) -> tuple[str, ...]:
    """Check all numbers of a scene and a state (see `check_numbers`), and the state against the
    constraints at `start_time`, s (see `check_structure`), and return the names of the redundant
    constraints. `flat`: scene and state, flattened by `flattened_arrays`, if they already are."""
    if not (isinstance(scene, Scene) and isinstance(state, State)):
        check_numbers(scene, state)  # raises the error
    arguments = flat_start(scene, state, start_time, coordinates, flat)
    key = arguments.key, arguments.numbers
    redundant = starts.passed.recent(key)
    # ``None``: no such start has passed recently. A start without redundant constraints has ().
    if redundant is None:
        before = number_issued()
        # The native check is fast, but cannot say why a start fails. A start that fails is
        # therefore checked again in Python, which raises the error.
        redundant = starts.redundant(arguments)
        if redundant is None:
            check_numbers(scene, state)
            redundant = check_structure(scene, state, start_time, coordinates)
        # A start that leads to a warning must do so at each call, so it does not count as passed.
        # Where warnings are suppressed, it is unknown whether it leads to one.
        if warns() and number_issued() == before:
            starts.passed.add(key, redundant)
    return redundant


def check_structure(
    scene: Scene, state: State, t: Scalar, coordinates: AbstractCoordinates
) -> tuple[str, ...]:
    """Check an initial state against the constraints of a scene, if it has joints, at a time t, s,
    and return the names of the redundant constraints.

    **Raises:** `ValueError` if the state violates a constraint, if a fixed or prismatic joint holds
    an orientation 90 degrees or more from the declared one, if a contact is deeper than its joint
    allows, as for a journal far outside its bearing, if it cannot be decided which constraints are
    redundant, or if the coordinates cannot represent the state or have no variable.

    **Warns:** `UnusualValueWarning` for a contact that is deeper than the fraction `FAR_OUTSIDE` of
    the depth that its joint allows, and for a closed contact that approaches without entry speed.
    """
    if not scene.joints:
        return ()
    start = start_values(scene, state, on_device(t), coordinates)
    require_in_bearings(scene, start.depths, start.approaches)
    rows = start.rows.in_order_of(scene)
    assembly.require_assembled(tuple(map(": ".join, rows.all_names)), rows.values, rows.rates)
    assembly.require_oriented(scene, start.cosines)
    redundant, uncertain = constraint_report.dependent(rows.names, rows.reduced, {})
    assembly.require_certain(uncertain)
    assembly.require_representable(state, coordinates, start.variables, start.orientations)
    return redundant


def derivative_scheme(
    scene: Scene, state: State, settings: Settings, start_time: float = 0.0
) -> Scheme:
    """Check the arguments of a run with derivatives, and return its method and formulation.

    **Raises:** `ValueError` for an invalid scene or state; for settings that derivatives do not
    support, such as a solver other than an explicit Runge-Kutta method, or a `landing_tolerance` of
    ``None``; if JAX computes in 32 bits; and for an element with undeclared `breakpoints`.

    **Warns:** `UnusualValueWarning`, as `check_structure`.
    """
    settings.require_double()
    check_precision(False)
    lands = settings.landing_tolerance is not None
    remedy = "derivatives are right only if steps end at the onset and the end of contacts"
    require(lands, "landing_tolerance", None, "a penetration in m", remedy)
    redundant = check_start(scene, state, start_time, settings.coordinates)
    require_declared(scene)
    # Redundant constraints need another solution of the equations of motion.
    scheme = Scheme.on_host(settings, bool(redundant))
    require_dense(scheme.method.solver)
    # Only runs with tangents have this tolerance: the factor by which errors of tangents may be
    # larger than those of the variables.
    tolerance = np.asarray(settings.derivative_tolerance, float)
    return replace(scheme, method=replace(scheme.method, derivative_tolerance=tolerance))


_recheck = cached_by_numbers(recheck)
"""Check all numbers in a scene, unless a scene equal to it has passed the check recently."""


class StartValues(NamedTuple):
    """What the checks of a start compare with their limits: depths, m, and rates of approach, m/s,
    of contacts; the constraint equations' `rows`; by joint, `cosines` of the angles from declared
    orientations; `variables`, the state in the coordinates; and by body, `orientations`, the Euler
    parameters that these variables represent."""

    depths: ByLabel[Scalar]
    approaches: ByLabel[Scalar]
    rows: constraint_report.StartRows
    cosines: dict[str, Scalar]
    variables: MotionVariables
    orientations: dict[str, np.ndarray]


# NumPy computes this function if it can, since a compilation takes longer than a single call.
@HostFirst
def start_values(
    scene: Scene, state: State, t: Scalar, coordinates: AbstractCoordinates
) -> StartValues:
    scene, state = unpack(scene), replace(state, bodies=unpack(state.bodies))
    motions = constraint_report.free_motions(scene, state.bodies)
    depths, approaches = starting_contacts(scene, motions, state.entry_speeds)
    rows = constraint_report.start_rows(scene, coordinates, state, t, motions=motions)
    cosines = assembly.cosines_of_turns.__wrapped__(scene, state.bodies)
    variables, orientations = assembly.round_trip.__wrapped__(scene, state, coordinates)
    return StartValues(depths, approaches, rows, cosines, variables, orientations)


def _passes(
    folded_scene: ConstantFolded, state: State, t: Scalar, coordinates: AbstractCoordinates
) -> tuple[Condition, tuple[tuple[constraint_report.RowName, ...], np.ndarray]]:
    """Evaluate the checks of `check_start` as conditions on arrays, so that they can be compiled.

    **Returns:** whether the start passes all checks except those of redundancy and of the scene's
    numbers, and no check would warn; and the fields `names` and `reduced` of `StartRows`.
    """
    scene = folded_scene.tree
    holds: list[Condition] = [*conditions_of(lambda: check_names(scene, state))]
    # Without joints there are no constraints and no contacts to check.
    if not scene.joints:
        return reduce(and_, holds, jnp.asarray(True)), ((), np.zeros(0))
    # `start_values` itself computes known numbers by NumPy. Here JAX traces, so the function inside
    # of its wrapper is called.
    start = start_values.__wrapped__(unpack(folded_scene), state, t, coordinates)
    # `require_in_bearings` raises an error beyond the limit, and issues a warning beyond the small
    # fraction `FAR_OUTSIDE` of it. A start that passes leads to neither. The first bound is the
    # stricter one only if the limit is negative, for numbers that a scene can't have.
    holds += [
        (start.depths[name][label] <= limit) & (start.depths[name][label] <= FAR_OUTSIDE * limit)
        for name, joint in scene.contact_joints().items()
        for label, limit in joint.deepest().items()
    ]
    rates = [rate for family in start.approaches.values() for rate in family.values()]
    holds += [jnp.asarray(rate) <= FAST_APPROACH for rate in rates]
    # A scene without variables is invalid, because nothing could move.
    holds += [_assembled(state, start), jnp.asarray(bool(jax.tree.leaves(start.variables)))]
    names, reduced = start.rows.names, start.rows.reduced
    return reduce(and_, holds), (names, reduced)


def assembled(scene: Scene, state: State, t: Scalar, coordinates: AbstractCoordinates) -> Condition:
    """Return whether a state satisfies the constraints of a scene and their time derivatives, at a
    time t, s, and whether the coordinates of a run can represent the state. Compiled programs,
    which can't raise errors, use this instead of `check_structure`."""
    return _assembled(state, start_values.__wrapped__(scene, state, t, coordinates))


def _assembled(state: State, start: StartValues) -> Condition:
    # Native code has no `all` of an array without elements, as in a scene without constraints.
    residuals = [part for part in (start.rows.values, start.rows.rates) if part.size]
    holds = [(jnp.abs(part) <= assembly.ACCEPTED_VIOLATION).all() for part in residuals]
    # As in `require_oriented`, fixed and prismatic joints hold their orientation.
    holds += [cosine > 0.0 for cosine in start.cosines.values()]
    for name, body in state.bodies.items():
        # As in `require_representable`, only orientations are compared: with an axis reversed, a
        # state may satisfy all constraints, but its orientation after the conversion is another.
        p, q = body.orientation, start.orientations[name]
        # Both signs of Euler parameters are the same orientation.
        apart = jnp.minimum(jnp.abs(p - q).max(), jnp.abs(p + q).max())
        holds.append(apart < assembly.REPRESENTED)
    return reduce(and_, holds, jnp.asarray(True))


def flat_start(
    scene: Scene,
    state: State,
    t: Scalar,
    coordinates: AbstractCoordinates,
    flat: FlatArguments | None = None,
) -> FlatArguments:
    if flat is None:
        flat = flattened_arrays(scene, state)
    rest = FlatArguments.of((np.asarray(t, float), coordinates))
    return FlatArguments.joined((*flat.parts, *rest.parts))


def flattened_arrays(scene: Scene, state: State) -> FlatArguments:
    # Scene and state are flattened once, which for thirty joints takes a millisecond.
    return FlatArguments.joined((_with_arrays(scene), _with_arrays(state)))


def _with_arrays(tree: PyTree) -> FlatArguments:
    leaves, structure = jax.tree.flatten(tree)
    arrays = array_leaves(leaves, structure)
    if arrays is not leaves:
        tree = with_leaves(tree, arrays, structure)
    return of_leaves(tree, arrays, structure)


class _Starts:
    """Fast checks of starts by native programs, of which there is one for each structure."""

    def __init__(self) -> None:
        self._function = NativeFunction(_passes)
        # Number of starts so far, by structure; far below zero where native code cannot be used.
        self._seen: Counter[Hashable] = Counter()
        # Caches of the function `dependent`, by structure.
        self._distances: dict[Hashable, dict[bytes, np.ndarray]] = {}
        # Redundant constraints of recent starts that have passed all checks without a warning.
        self.passed: RecentPrograms[tuple[str, ...]] = RecentPrograms()
        # The latest scene of each structure whose numbers have passed their checks.
        self._scenes: RecentPrograms[FlatArguments] = RecentPrograms()

    def redundant(self, arguments: FlatArguments) -> tuple[str, ...] | None:
        """Return the names of the redundant constraints of a start that passes all checks. Return
        ``None`` if a condition of `_passes` fails, if redundancy is uncertain, or without a native
        program: the caller must then check in Python. `arguments`: the result of `flat_start`.
        Raise a `ValueError` for numbers that the scene can't have."""
        # The scene, also flattened. The program takes its exact zeros and ones as constants.
        scene, unfolded = arguments.arguments[0], arguments.parts[0]
        arguments = FlatArguments.joined((flattened(folded(unfolded)), *arguments.parts[1:]))
        self._seen[arguments.key] += 1
        if not is_native():
            return None
        # Another process may have saved the program. That is looked up only once.
        if self._seen[arguments.key] == 1:
            self._function.load(arguments)
        # Compiling takes longer than the checks of a few starts, so the first ones of a structure
        # are left to Python, unless a saved program has been loaded.
        if self._seen[arguments.key] <= BY_NUMPY and not self._function.is_made(arguments):
            return None
        try:
            passes, (names, reduced) = self._function.run(arguments)
        except (UnsupportedPrimitiveError, ValueError):
            # Native code has no rule for an operation of the checks, or a check fails for any
            # numbers, for instance if a body lacks a state. Never try this structure again.
            self._seen[arguments.key] = -sys.maxsize
            return None
        if not passes:
            return None
        # The native program leaves out the checks of the scene's numbers.
        self._recheck(scene, unfolded)
        # A constraint is redundant if its row of `reduced`, the derivatives of the constraint
        # equations, is near the span of the rows before it. The distances are cached by `reduced`.
        # Without a limit, the cache would grow with each start whose constraints differ.
        distances = self._distances.setdefault(arguments.key, {})
        if len(distances) >= KEPT:
            distances.clear()
        # Of rows that depend on each other, the last ones count as redundant. So rows are put in
        # the order of the scene's joints first.
        order = constraint_report.scene_order(names, scene)
        names, reduced = tuple(names[k] for k in order), reduced[order]
        redundant, uncertain = constraint_report.dependent(names, reduced, distances)
        return None if uncertain else redundant

    def _recheck(self, scene: Scene, flat: FlatArguments) -> None:
        # Only numbers that differ from those of the latest scene of the structure are checked. In
        # native code, these checks were a third of the program.
        earlier = self._scenes.recent(flat.key)
        changed = None if earlier is None else flat.changes(earlier)
        if changed is None:
            _recheck(scene)
        else:
            recheck_changes(scene, flat.tree_structure, changed)
        self._scenes.add(flat.key, flat)


starts = _Starts()
