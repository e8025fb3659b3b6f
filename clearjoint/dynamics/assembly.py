"""Initial states that satisfy the constraints, in position and velocity."""

from collections.abc import Callable, Collection
from functools import partial

import equinox as eqx
import jax
import numpy as np

from ..compilation import HostFirst
from ..fields.caching import cached_by_numbers
from ..fields.checks import checkable, require, require_finite
from ..fields.conversion import on_device, with_arrays
from ..fields.suggestions import nearest
from ..math.vectors import Scalar, pack, unpack
from ..model.bodies import BodyState, State
from ..model.joints.base import AbstractConstraint
from ..model.scene import Scene
from ..native import Native
from .absolute_coordinates import AbsoluteCoordinates
from .constraint_report import constraint_report
from .coordinates import AbstractCoordinates, MotionVariables
from .formulation import Formulation
from .journals import centring_joints, outside, seating_joints, with_ideal
from .system import System

ITERATIONS = 100
TOLERANCE = 1e-12
"""Largest |Phi| of an assembled state, m for translations."""
ACCEPTED_VIOLATION = 1e-6
"""Largest |Phi| and |rate of Phi| that a given state may start a run with."""
REPRESENTED = 1e-3
"""Difference of Euler parameters beyond which an assembled state is another than its variables'."""


def check_names(scene: Scene, state: State) -> None:
    """Check that a state has exactly the scene's bodies."""
    require(
        isinstance(scene, Scene),
        "scene",
        type(scene).__name__,
        "a Scene",
        "pass one; mechanisms come with a state: scene, state = cj.mechanisms.four_bar()",
    )
    require(
        isinstance(state, State),
        "state",
        type(state).__name__,
        "a State",
        "pass State({name: body_state(...)})",
    )
    require(
        set(state.bodies) == set(scene.bodies),
        "state",
        sorted(state.bodies),
        f"of the scene's bodies {sorted(scene.bodies)}",
        "give each body of the scene one state, under the same name",
    )
    for name, body in state.bodies.items():
        for field in ("position", "orientation", "velocity", "spin"):
            require_finite(f"state.bodies[{name!r}].{field}", getattr(body, field))
        if (known := checkable(body.orientation)) is not None:
            (turn,) = known
            norm = (turn**2).sum() ** 0.5
            require(
                (norm > 0.9) & (norm < 1.1),
                f"state.bodies[{name!r}].orientation",
                turn,
                "Euler parameters of about unit norm, scalar part first",
                "make states with body_state(...), which checks them",
            )
    for part in ("entry_speeds", "work", "bristles"):
        for leaf in jax.tree.leaves(getattr(state, part)):
            require_finite(f"state.{part}", leaf)


def assemble(
    scene: Scene, state: State, t: Scalar = 0.0, *, resting: Collection[str] = ()
) -> State:
    """The state nearest to a guess, in the metric of the masses, that satisfies the constraints and
    has each journal in its bearing.

    A journal that is in its bearing stays where the guess has it. One that is in the wall, by more
    than a micrometre, or beyond it is centred, and moves as an ideal joint would let it.

    **Arguments:**

    - `state`: the guess; velocities may be rough as well.
    - `t`: s, for constraints that depend on time.
    - `resting`: names of clearance joints whose journals shall lie against the wall, where gravity
      and the scene's forces press them while nothing moves yet.

    **Raises:** `ValueError` if the constraints can't be met from there, with the worst of them; for
    a joint to be seated that has no clearance, or whose journal nothing presses against the wall.

    >>> scene, guess = cj.mechanisms.slider_crank(clearance=None)
    >>> state = cj.assemble(scene, guess)
    >>> bool(np.allclose(state.bodies["slider"].position, guess.bodies["slider"].position))
    True
    """
    check_names(scene, state)
    scene, state = with_arrays((scene, state))
    known = sorted(centring_joints(scene, scene.contact_joints()))
    require(not isinstance(resting, str), "resting", resting, "a list of names", 'pass ["pin"]')
    for name in resting:
        remedy = nearest(name, known, "leave out the others")
        require(name in known, "resting", name, f"names of clearance joints {known}", remedy)
    held = centring_joints(scene, resting)
    state = _in_bearings(scene, held, state, t)
    if not resting:
        return state
    held |= seating_joints(scene, held, resting, state, t)
    return _in_bearings(scene, held, state, t)


def _in_bearings(
    scene: Scene, held: dict[str, AbstractConstraint], state: State, t: Scalar
) -> State:
    """The state assembled with ideal joints in the place of those `held`, to which those of all
    journals outside their bearings are added."""
    while True:
        state = _satisfying(with_ideal(scene, held), state, t)
        added = centring_joints(scene, outside(scene, state) - set(held))
        if not added:
            return state
        held |= added


def _satisfying(scene: Scene, state: State, t: Scalar) -> State:
    """The nearest state that satisfies the constraints."""
    formulation = Formulation(AbsoluteCoordinates(), redundant=True)
    bodies = state.bodies
    t = on_device(t)
    for _ in range(ITERATIONS):
        report = constraint_report(scene, State(bodies), t)
        if np.abs(report.values).max(initial=0.0) <= TOLERANCE:
            break
        bodies = _corrected(System.project_positions, scene, formulation, bodies, t)
    report = constraint_report(scene, State(bodies), t)
    _require_satisfied(report.names, report.values, TOLERANCE * 1e3, "assembled", "positions")
    for _ in range(2):
        bodies = _corrected(System.project_velocities, scene, formulation, bodies, t)
    report = constraint_report(scene, State(bodies), t)
    _require_satisfied(report.names, report.rates, 1e-9, "assembled", "velocities")
    return State(bodies, state.entry_speeds, state.work, state.bristles)


def require_assembled(names: tuple[str, ...], values: np.ndarray, rates: np.ndarray) -> None:
    """Check that a given initial state satisfies the constraints."""
    _require_satisfied(names, values, ACCEPTED_VIOLATION, "consistent", "positions")
    _require_satisfied(names, rates, ACCEPTED_VIOLATION, "consistent", "velocities")


def require_certain(uncertain: tuple[str, ...]) -> None:
    """Check that no constraint nearly depends on the others: motion and reactions would then be
    rounding's."""
    require(
        not uncertain,
        "state",
        list(uncertain),
        "without constraints that nearly depend on the others",
        "align the points and axes of these joints with the others' exactly, or by more than 1e-5; "
        "leave out what the others hold; or start farther from a singular position",
    )


def require_representable(scene: Scene, state: State, coordinates: AbstractCoordinates) -> None:
    """Check that the coordinates can hold an assembled state: a revolute joint's constraints, for
    example, leave its axes parallel or antiparallel, an angle only the former."""
    variables, held = round_trip(scene, state, Formulation(coordinates))
    _require_something_moves(variables, coordinates)
    for name, body in state.bodies.items():
        turn, other = np.asarray(body.orientation), np.asarray(held[name].orientation)
        apart = min(np.abs(turn - other).max(), np.abs(turn + other).max())
        require(
            bool(apart < REPRESENTED),
            f"state.bodies[{name!r}].orientation",
            turn,
            f"one that the coordinates can hold, here {other.tolist()}",
            "turn round one of the axes of the joint that carries the body, or pass "
            "coordinates=AbsoluteCoordinates()",
        )


@cached_by_numbers
def require_freedom(scene: Scene, state: State, coordinates: AbstractCoordinates) -> None:
    """Check that the coordinates have something left to move; nothing is compiled for it."""
    variables, _ = eqx.filter_eval_shape(
        round_trip.__wrapped__, scene, state, Formulation(coordinates)
    )
    _require_something_moves(variables, coordinates)


def _require_something_moves(variables: MotionVariables, coordinates: AbstractCoordinates) -> None:
    require(
        bool(jax.tree.leaves(variables)),
        "coordinates",
        type(coordinates).__name__,
        "such that something is left to move",
        "pass coordinates=AbsoluteCoordinates() to find the reactions of a fixed structure",
    )


@HostFirst
def round_trip(
    scene: Scene, state: State, formulation: Formulation
) -> tuple[MotionVariables, dict[str, BodyState]]:
    """The variables of a state, and the bodies as these hold them."""
    system = System(unpack(scene), formulation)
    variables = system.encode(unpack(state.bodies))
    return variables, pack(system.decode(variables))


def _require_satisfied(
    names: tuple[str, ...], residuals: np.ndarray, tolerance: float, wish: str, what: str
) -> None:
    if residuals.size == 0:
        return
    worst = int(np.argmax(np.where(np.isfinite(residuals), np.abs(residuals), np.inf)))
    remedy = (
        "call assemble(scene, state) first"
        if wish == "consistent"
        else "start from a better guess, or check the joints' points and axes against each other"
    )
    require(
        bool(np.abs(residuals[worst]) <= tolerance),
        "state",
        float(residuals[worst]),
        f"{wish} in its {what} (residual of constraint {names[worst]!r} at most {tolerance:g})",
        remedy,
    )


@partial(Native, warns=False)
def _corrected(
    projection: Callable[[System, MotionVariables, Scalar], MotionVariables],
    scene: Scene,
    formulation: Formulation,
    bodies: dict[str, BodyState],
    t: Scalar,
) -> dict[str, BodyState]:
    system = System(unpack(scene), formulation)
    return pack(system.decode(projection(system, system.encode(unpack(bodies)), t)))
