"""Compute and check initial states that satisfy the constraints in position and velocity."""

from collections.abc import Callable, Collection
from dataclasses import replace
from functools import partial

import jax
import numpy as np

from .._compilation.xla import HostFirst
from .._fields.caching import cached_by_numbers
from .._fields.cautions import UnusualValueWarning, caution
from .._fields.checks import (
    caution_unless,
    nearest,
    require,
    require_shape,
)
from .._fields.objects import on_device, with_arrays
from .._math.rotations import rotation_matrix
from .._math.vectors import EulerParameters, Scalar, pack, unpack
from .._model.bodies import GROUND, BodyState, State
from .._model.joints.base import PARALLEL, AbstractConstraint, AbstractContactJoint
from .._model.joints.ideal import AbstractOrientedJoint
from .._model.scene import Scene
from .._native import Native
from .absolute_coordinates import AbsoluteCoordinates
from .constraint_report import check_names, row_residuals
from .coordinates import AbstractCoordinates, MotionVariables, at_rest
from .formulation import Formulation
from .journals import (
    UNIQUE_REACTIONS,
    centring_joints,
    outside,
    require_centred,
    resting_entry_speeds,
    resting_joints,
    with_ideal,
)
from .system import System

ITERATIONS = 100
"""Largest number of Newton steps of positions in `assemble`; near the solution few are needed."""
TOLERANCE = 1e-12
"""Largest constraint value at which `assemble` stops iterating, in m, rad or, for directions,
without unit: slightly above the rounding errors of lengths of a metre."""
SATISFIED = 1e-9
"""Largest constraint value and rate that `assemble` accepts. Rounding errors of lengths above a
metre may exceed `TOLERANCE`."""
STRIKING = 0.1
"""Fraction of the kinetic energy, above which `assemble` warns, that would be lost if all journals
stopped in their bearings. If a crank turns and all links behind its clearance rest, this fraction
is between a half and one."""
LOCKED = (
    "With ideal joints the mechanism can't move as its drivers prescribe, so that bodies behind a "
    "clearance have the velocities of the guess: give those of the motion, and pass moving=False."
)
ACCEPTED_VIOLATION = 1e-6
"""Largest constraint value and rate with which a run may start: far above rounding errors, and
small beside a clearance."""
REPRESENTED = 1e-3
"""Largest accepted change of an Euler parameter by conversion to variables and back. For an
orientation that the variables cannot represent, this change is about one."""


def assemble(
    scene: Scene,
    state: State,
    t: Scalar = 0.0,
    *,
    resting: Collection[str] = (),
    centred: bool = False,
    moving: bool | None = None,
) -> State:
    """Find a state near a guess that satisfies the constraints, with each journal in its bearing.

    Each Newton step is the smallest correction, in the metric of the mass matrix, that satisfies
    the linearised constraints: the result is approximately the nearest state. A journal inside its
    bearing is not moved by its clearance joint, except along the axis if the joint holds it
    axially. A journal that penetrates the wall by more than a micrometre is put into the centre of
    the bearing, with the velocity that an ideal joint would give it. A user-defined joint without a
    centred position (its method `centred_joint` returns ``None``) is left as it is. A pin in a slot
    is only centred across the slot.

    Choose `moving` by what the guess says about velocities. Constraints do not determine velocities
    of bodies behind a clearance: if a driver turns the crank of a four-bar whose crank pin has
    clearance and the guess is at rest, then coupler and rocker stay at rest, and the crank strikes
    them with its whole speed. With `moving=True`, bodies move as if all joints were ideal.

    **Arguments:**

    - `state`: the guess.
    - `t`: s, time at which constraints and forces that depend on time are evaluated.
    - `resting`: names of clearance joints whose journals are put in contact with the wall, on the
      side to which gravity and the scene's forces press them while all bodies are at rest. These
      journals penetrate the wall as far as their load demands, so that they don't oscillate. A
      contact whose law uses the entry speed gets the speed of an impact whose energy is the
      contact's elastic energy, so that later oscillations are damped like such an impact.
    - `centred`: whether all journals except `resting` ones are centred in their bearings.
    - `moving`: if ``True``, the result has the velocities, nearest to those of the guess, at which
      no journal moves in its bearing; if ``False``, the velocities of the guess, as far as the
      constraints allow. ``None``, the default, means ``True`` if a driver moves at time `t` and
      velocities without motion in bearings exist, otherwise ``False``.

    **Returns:** the assembled state, with the `work`, `bristles` and `memory` of the guess, and its
    `entry_speeds` except for those of the joints in `resting`.

    **Raises:** `ValueError`

    - if the state's bodies are not those of the scene, or a number of the state is not finite;
    - if no state near the guess satisfies the constraints; the message names the worst constraint;
    - if a `FixedJoint` or `PrismaticJoint` would hold a wrong orientation, since its bodies are
      turned too far relative to each other in the guess;
    - if a journal is deep in a wall although it is centred, such as a pin beyond the end of a slot;
    - if `moving` is ``True``, but the mechanism with ideal joints cannot move as drivers prescribe;
    - if a name in `resting` does not name a clearance joint with a resting position, which
      `Backlash` lacks, or the load on its journal has no component across the joint's axis.

    **Warns:** `UnusualValueWarning` if `moving` is ``None`` and either a driver moves, but the
    mechanism with ideal joints cannot follow this driver; or no driver moves, and more than a
    tenth of the kinetic energy would be lost if all journals stopped in their bearings.

    >>> scene, guess = cj.mechanisms.slider_crank(clearance=None)
    >>> state = cj.assemble(scene, guess)
    >>> bool(np.allclose(state.bodies["slider"].position, guess.bodies["slider"].position))
    True
    """
    check_names(scene, state)
    require_shape("t", t, (), "pass one time in s")
    for argument, value in (("centred", centred), ("moving", moving is None or moving)):
        require(isinstance(value, bool), argument, value, "True or False", "pass a bool")
    scene, state = with_arrays((scene, state))
    with_centre = sorted(centring_joints(scene, scene.contact_joints()))
    # A single name would be taken for a list of its letters.
    is_list = isinstance(resting, Collection) and not isinstance(resting, str)
    require(is_list, "resting", resting, "a list of names", 'pass ["pin"]')
    joints, default = scene.contact_joints(), AbstractContactJoint.resting_joint
    # Joints with a resting position override the method `resting_joint`.
    can_rest = [name for name in with_centre if type(joints[name]).resting_joint is not default]
    for name in resting:
        remedy = nearest(name, can_rest, "leave out the others")
        expected = f"names of clearance joints {can_rest}"
        require(name in can_rest, "resting", name, expected, remedy)
    # Loads depend on the position, so resting journals are centred first, then moved to the wall.
    ideal = centring_joints(scene, with_centre if centred else resting)
    state = _in_bearings(scene, ideal, state, t)
    require_centred(scene, state, ideal)
    if resting:
        # The load depends on the position too, so it is computed again at the wall.
        for _ in range(2):
            ideal |= resting_joints(scene, ideal, resting, state, t)
            state = _in_bearings(scene, ideal, state, t)
        # Resting journals are not checked: they are placed as circles, so that a journal with a
        # profile may be deep in the wall.
        require_centred(scene, state, set(ideal) - set(resting))
        entry_speeds = state.entry_speeds | resting_entry_speeds(scene, resting, state, t)
        state = replace(state, entry_speeds=entry_speeds)
    # Without clearance joints, the constraints alone have determined the velocities.
    if not with_centre or moving is False:
        return state
    all_ideal = with_ideal(scene, centring_joints(scene, with_centre) | ideal)
    driven = _driven(scene, state, t)
    try:
        # Only the velocities of the mechanism with ideal joints are taken, at the positions of
        # `state`, and then corrected so that they satisfy the scene's own constraints.
        mechanism = _satisfying(all_ideal, state, t)
        bodies = AbsoluteCoordinates().with_speeds(scene, state.bodies, mechanism.bodies)
        moved = _with_velocities(scene, replace(state, bodies=bodies), t)
    except ValueError as error:
        if moving:
            raise ValueError(
                f"With ideal joints, as `moving` demands: {error} Or pass moving=False."
            ) from error
        if driven:
            caution(f"{LOCKED} ({error})", UnusualValueWarning)
        return state
    if moving or driven:
        return moved
    _caution_striking(scene, state, moved)
    return state


def _driven(scene: Scene, state: State, t: Scalar) -> bool:
    """Return whether a constraint, such as a driver, moves bodies at time t."""
    rates = row_residuals(scene, State(at_rest(state.bodies)), t).rates
    return bool(np.abs(rates).max(initial=0.0) > SATISFIED)


def _caution_striking(scene: Scene, state: State, moved: State) -> None:
    """Warn if much of the kinetic energy of `state` is lost in `moved`, the state with the nearest
    velocities at which no journal moves relative to its bearing."""
    before, after = (float(_kinetic_energy(scene, at.bodies)) for at in (state, moved))
    lost = 1.0 - after / before if before > 0.0 else 0.0
    share, expected = round(100.0 * lost, 1), f"at most {100.0 * STRIKING:g} %"
    meaning = "% of the kinetic energy in motion of journals relative to their bearings"
    remedy = (
        "pass moving=True for the velocities of the mechanism with ideal joints, or moving=False "
        "if the journals are to strike"
    )
    caution_unless(lost <= STRIKING, "state", share, meaning, expected, remedy)


# NumPy computes this function if it can, since a compilation takes longer than a single call.
@HostFirst
def _kinetic_energy(scene: Scene, bodies: dict[str, BodyState]) -> Scalar:
    system = System(unpack(scene), Formulation(AbsoluteCoordinates()))
    return system.energies(system.encode(unpack(bodies)), 0.0)["kinetic"]


def _in_bearings(
    scene: Scene, ideal: dict[str, AbstractConstraint], state: State, t: Scalar
) -> State:
    """Return a state near the guess `state` that satisfies the constraints, with the joints in
    `ideal` in place of the scene's joints of the same names. If this moves further journals out of
    their bearings, ideal joints that centre these are added to `ideal`, which is changed."""
    # The loop ends, because each pass adds at least one of the scene's clearance joints.
    while True:
        state = _satisfying(with_ideal(scene, ideal), state, t)
        added = centring_joints(scene, outside(scene, state) - set(ideal))
        if not added:
            return state
        ideal |= added


def _satisfying(scene: Scene, state: State, t: Scalar) -> State:
    """Return a state near `state` that satisfies the constraints, by Newton steps."""
    bodies = state.bodies
    t = on_device(t)
    for _ in range(ITERATIONS):
        rows = row_residuals(scene, State(bodies), t)
        if np.abs(rows.values).max(initial=0.0) <= TOLERANCE:
            break
        bodies = _corrected(System.project_positions, scene, bodies, t)
    else:  # The rows of the last correction have not been evaluated.
        rows = row_residuals(scene, State(bodies), t)
    _require_satisfied(rows.texts(), rows.values, SATISFIED, "assembled", "positions")
    state = _with_velocities(scene, replace(state, bodies=bodies), t)
    require_oriented(scene, cosines_of_turns(scene, state.bodies))
    return state


def _with_velocities(scene: Scene, state: State, t: Scalar) -> State:
    bodies, t = state.bodies, on_device(t)
    # For velocities the constraints are linear: one projection solves them, and a second one
    # removes the rounding errors of the first.
    for _ in range(2):
        bodies = _corrected(System.project_velocities, scene, bodies, t)
    state = replace(state, bodies=bodies)
    rows = row_residuals(scene, state, t)
    _require_satisfied(rows.texts(), rows.rates, SATISFIED, "assembled", "velocities")
    return state


def require_assembled(names: tuple[str, ...], values: np.ndarray, rates: np.ndarray) -> None:
    """Check that constraints and their rates are violated by `ACCEPTED_VIOLATION` at most."""
    _require_satisfied(names, values, ACCEPTED_VIOLATION, "consistent", "positions")
    _require_satisfied(names, rates, ACCEPTED_VIOLATION, "consistent", "velocities")


def require_oriented(scene: Scene, cosines: dict[str, Scalar]) -> None:
    """Check, by the results of `cosines_of_turns`, that the relative orientation in each fixed and
    prismatic joint is less than 90 degrees from the declared one. The constraints of these joints
    are also satisfied at orientations that differ from the declared one by half a revolution about
    x, y or z, or by a cyclic permutation of the axes, and hold bodies at such an orientation."""
    for name, cosine in cosines.items():
        turn = round(float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))), 3)
        second = scene.joints[name].body_names()[1]
        expected = (
            f"one in which body {second!r} is less than 90 degrees from the `orientation` of joint "
            f"{name!r}"
        )
        remedy = "turn the body, or give the joint another `orientation`"
        require(bool(cosine > 0.0), "state", turn, expected, remedy)


# NumPy computes this function if it can, since a compilation takes longer than a single call.
@HostFirst
def cosines_of_turns(scene: Scene, bodies: dict[str, BodyState]) -> dict[str, Scalar]:
    """Return, for each fixed or prismatic joint by name, the cosine of the angle from the declared
    relative orientation of its bodies to the actual one."""
    oriented = {n: j for n, j in scene.joints.items() if isinstance(j, AbstractOrientedJoint)}
    if not oriented:
        return {}
    orientations = {name: body.orientation for name, body in unpack(bodies).items()}
    orientations[GROUND] = EulerParameters(*PARALLEL)
    cosines: dict[str, Scalar] = {}
    for name, joint in unpack(oriented).items():
        first, second = (rotation_matrix(orientations[body]) for body in joint.pair())
        from_declared = first.T @ second @ rotation_matrix(joint.orientation).T
        x, y, z = from_declared.rows
        # The trace of a rotation matrix is one plus twice the cosine of the angle.
        cosines[name] = 0.5 * (x.x + y.y + z.z - 1.0)
    return cosines


def require_certain(uncertain: tuple[str, ...]) -> None:
    """Raise a `ValueError` if any constraint rows are `uncertain`: they nearly depend on others, so
    that rounding errors would determine their reactions (see `ConstraintReport`)."""
    expected = "without constraints that nearly depend on the others"
    remedy = (
        "align the points and axes of these joints with the others' exactly, or misalign them by "
        "more than 1e-5; leave out redundant joints; or start farther from a singular position"
    )
    require(not uncertain, "state", list(uncertain), expected, remedy)


def require_representable(
    state: State,
    coordinates: AbstractCoordinates,
    variables: MotionVariables,
    represented: dict[str, np.ndarray],
) -> None:
    """Check that an assembled state keeps its orientations when it is converted to coordinates and
    back: `variables` and `represented` are the results of `round_trip`. Antiparallel axes, for
    example, satisfy the constraints of a revolute joint, but joint coordinates represent parallel
    axes only. Check also that `variables` is not empty, so that something can move."""
    _require_something_moves(variables, coordinates)
    for name, body in state.bodies.items():
        given, converted = np.asarray(body.orientation), np.asarray(represented[name])
        # Euler parameters of opposite sign are the same orientation.
        apart = min(np.abs(given - converted).max(), np.abs(given + converted).max())
        expected = f"one that the coordinates can represent, here {converted.tolist()}"
        remedy = "reverse an axis of the joint that carries the body, or use AbsoluteCoordinates()"
        argument = f"state.bodies[{name!r}].orientation"
        require(bool(apart < REPRESENTED), argument, given, expected, remedy)


@cached_by_numbers
def require_freedom(scene: Scene, state: State, coordinates: AbstractCoordinates) -> None:
    """Raise a `ValueError` unless the coordinates have a variable, so that something can move."""
    variables, _ = round_trip(scene, state, coordinates)
    _require_something_moves(variables, coordinates)


def _require_something_moves(variables: MotionVariables, coordinates: AbstractCoordinates) -> None:
    moves, kind = bool(jax.tree.leaves(variables)), type(coordinates).__name__
    remedy = "pass coordinates=AbsoluteCoordinates() to find the reactions of a fixed structure"
    require(moves, "coordinates", kind, "such that a degree of freedom is left", remedy)


# NumPy computes this function if it can, since a compilation takes longer than a single call.
@HostFirst
def round_trip(
    scene: Scene, state: State, coordinates: AbstractCoordinates
) -> tuple[MotionVariables, dict[str, np.ndarray]]:
    """Return the variables of a state, with all velocities set to zero, and the Euler parameters,
    (4,), that the variables represent, by name of body."""
    scene = unpack(scene)
    variables = coordinates.encode(scene, at_rest(unpack(state.bodies)))
    decoded = coordinates.decode(scene, variables)
    return variables, {name: pack(body.orientation) for name, body in decoded.items()}


def _require_satisfied(
    names: tuple[str, ...], residuals: np.ndarray, tolerance: float, quality: str, part: str
) -> None:
    """Check that all `residuals` of the constraints `names` are at most `tolerance` in magnitude:
    constraint values if `part` is "positions", their rates if it is "velocities". `quality` is
    "consistent" for a state from the user, and "assembled" for a computed one."""
    if residuals.size == 0:
        return
    # NaN counts as the worst residual.
    worst = int(np.argmax(np.where(np.isfinite(residuals), np.abs(residuals), np.inf)))
    limit = f"residual of constraint {names[worst]!r} at most {tolerance:g}"
    remedy = "call assemble(scene, state) first"
    if quality == "assembled":
        remedy = "start from a better guess, or check the joints' points and axes with each other"
    residual, expected = float(residuals[worst]), f"{quality} in its {part} ({limit})"
    require(bool(np.abs(residual) <= tolerance), "state", residual, expected, remedy)


# This function is compiled to native code or, if that is not possible, by XLA without a warning.
@partial(Native, warns=False)
def _corrected(
    projection: Callable[[System, MotionVariables, Scalar], MotionVariables],
    scene: Scene,
    bodies: dict[str, BodyState],
    t: Scalar,
) -> dict[str, BodyState]:
    system = System(unpack(scene), UNIQUE_REACTIONS)
    return pack(system.decode(projection(system, system.encode(unpack(bodies)), t)))
