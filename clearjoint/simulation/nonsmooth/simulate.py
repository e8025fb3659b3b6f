"""Simulation with rigid contacts, whose impacts have no duration: the function
`simulate_nonsmooth`."""

import jax
import jax.numpy as jnp
from jaxtyping import Float

from ...dynamics.coordinates import AbstractCoordinates
from ...dynamics.formulation import Formulation
from ...dynamics.joint_coordinates.coordinates import JointCoordinates
from ...dynamics.journals import warn_of_journals_outside
from ...fields.checks import require, require_positive
from ...fields.conversion import with_arrays
from ...fields.types import ArrayLike
from ...math.vectors import Scalar, fold_constants
from ...model.bodies import State
from ...model.joints.base import each_label
from ...model.scene import Scene
from ...result_codes import RESULTS
from ..results.nonsmooth_solution import NonsmoothSolution
from ..results.solution import Trajectory, raise_failure
from ..run.run_checks import check_numbers, check_precision, check_start, in_domain, is_traced
from ..run.saving import EXCEPT_TIMES, Saving, saving_or_nothing
from ..step.spans import check_span
from .restitution import require_restitution
from .run import RigidRun, RigidStop, run_compiled

MOST_STEPS = 1e9
"""Largest number of steps of a run. A run of more steps would take hours."""


def simulate_nonsmooth(
    scene: Scene,
    state: State,
    end_time: Scalar,
    save: Saving | None = None,
    *,
    step: Scalar,
    start_time: Scalar = 0.0,
    restitution: Scalar | None = None,
    coordinates: AbstractCoordinates | None = None,
    redundant: bool | None = None,
    throw: bool = True,
) -> NonsmoothSolution:
    """Simulate a scene with rigid contacts in fixed steps, by the midpoint rule of Moreau and Jean.

    A rigid contact has no stiffness, duration or peak force, so that a step may be far longer than
    a real impact. After an impact, a contact separates at a coefficient of restitution times its
    approach speed. By default, the coefficient is that of a free impact with its contact law (the
    method `delivered_restitution` of the law). The contact slides by Coulomb's law, with the
    coefficient of the friction law at high slip. It penetrates by no more than its approach in half
    a step. The time of an impact is known to half a step, because impacts happen in the middle of a
    step; therefore the error of all states is of first order in the length of the step.

    A step ends at each breakpoint of a joint or force, a time at which it changes abruptly. Where a
    driver makes velocities jump, the change of the velocities is the one of least kinetic energy,
    as in `simulate`.

    The function works under `jax.vmap`, `jax.jit` and `jax.jvp`. It then raises no error for a
    traced number outside its range: the run ends before its first step with `RESULTS.domain`. But
    derivatives across impacts are not derivatives of the motion, since the step in which an impact
    happens does not change with the parameters.

    **Arguments:**

    - `scene`, `state`: the mechanism, and its initial state, which must satisfy the constraints.
    - `end_time`, `start_time`: s.
    - `save`: the times at which to save the state; a step ends at each of them. Nothing else can be
      saved.
    - `step`: s, length of the longest step. Between two times to save at, steps are equal.
    - `restitution`: Newton's coefficient of restitution of every contact, 0 to 1, in place of the
      restitutions that the contact laws deliver.
    - `coordinates`: coordinates of the equations of motion; `JointCoordinates` unless given.
    - `redundant`: whether some constraints depend linearly on others. By default this is determined
      from the initial state; under a transformation of JAX the default is ``False``.
    - `throw`: if the run fails, raise `SimulationError`. Otherwise, and always if JAX traces the
      run, the solution of a failed run is returned, whose `result` is the code of the failure.

    **Returns:** a `NonsmoothSolution`.

    **Raises:** `ValueError` for invalid arguments, such as a law that does not report the
    restitution that it delivers; `SimulationError` for a run that fails, because the contact
    problem of a step was not solved, a penetration exceeds the bearing's clearance, a driver has an
    undeclared kink or jump inside a step, or the state is not finite.

    **Warns:** `LeftBearingWarning` if a journal without axial support has slid out of its bearing
    in a saved state or at the end; `UnusualValueWarning` for a journal that starts deep in the wall
    of its bearing.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> solution = cj.simulate_nonsmooth(scene, state, 0.02, step=1e-4)
    >>> int(solution.contacts["shoulder"]["V"].impacts)
    1
    """
    check_precision(False)
    scene, state = with_arrays((scene, state))
    save = saving_or_nothing(save)
    save.require_none(EXCEPT_TIMES, "of a run with rigid contacts", "take simulate() for it")
    require_restitution(scene, restitution)
    coordinates = JointCoordinates() if coordinates is None else coordinates
    traced = is_traced((scene, state, end_time, start_time, step, restitution))
    times: ArrayLike | None = save.times
    redundant_constraints: tuple[str, ...] = ()

    def check() -> None:
        require_positive("step", step, "give the longest step in s")
        check_span(start_time, end_time)
        save.times_between(start_time, end_time)
        check_numbers(scene, state)
        require_restitution(scene, restitution)

    # Known numbers are checked now. Checks of traced numbers become a condition of the program.
    admissible = in_domain(check)
    # The following need values of numbers, which traced numbers lack.
    if not traced:
        shortest = (float(end_time) - float(start_time)) / MOST_STEPS
        expected = f"at least {shortest:.1g} s, a part in {MOST_STEPS:.0g} of the span"
        remedy = "give a longer step in s, or an earlier end_time"
        require(bool(float(step) >= shortest), "step", step, expected, remedy)
        times = save.times_between(start_time, end_time)
        redundant_constraints = check_start(scene, state, start_time, coordinates)
    formulation = Formulation(
        coordinates, redundant=bool(redundant_constraints) if redundant is None else redundant
    )
    between = jnp.asarray([] if times is None else times)
    stops = jnp.concatenate([_array(start_time)[None], between, _array(end_time)[None]])
    chosen = None if restitution is None else _array(restitution)
    run = run_compiled(
        fold_constants(scene), formulation, state, stops, _array(step), chosen, admissible
    )
    inner = None if times is None else stops[1:-1]
    solution = _solution(*run, inner, formulation, redundant_constraints)
    return solution if traced else _reported(jax.device_get(solution), scene, throw)


def _solution(
    end: RigidRun,
    stops: RigidStop,
    times: Float[jax.Array, " times"] | None,
    formulation: Formulation,
    redundant_constraints: tuple[str, ...],
) -> NonsmoothSolution:
    """Return the solution of a run, with the states at the inner stops as saved states.

    **Arguments:** `end`, `stops`: the run at its end, and at the N times to save at and the end;
    `times`: (N,) s, the times to save at, or ``None``; `formulation`, `redundant_constraints`:
    stored in the solution.
    """
    saved, history, count = None, None, None
    if times is not None:
        # The last stop is the end of the run, which is not a saved state.
        rows = jax.tree.map(lambda leaf: leaf[:-1], stops)
        # If the run failed, all rows from the failure on have its result code and no meaning.
        history, count = rows.totals, (rows.result == RESULTS.successful).sum()
        # Rigid contacts have no entry speeds, but a saved state lists one for each contact.
        entry_speeds = each_label(
            lambda name, label: jnp.zeros_like(rows.totals[name][label].impulse), rows.totals
        )
        saved = Trajectory(times, State(rows.bodies, entry_speeds))
    return NonsmoothSolution(
        time=end.t,
        final=State(jax.tree.map(lambda leaf: leaf[-1], stops.bodies)),
        result=end.result,
        steps=end.steps,
        saved=saved,
        history=history,
        saved_count=count,
        contacts=end.totals,
        residual=end.residual,
        formulation=formulation,
        redundant_constraints=redundant_constraints,
    )


def _reported(solution: NonsmoothSolution, scene: Scene, throw: bool) -> NonsmoothSolution:
    """Return a solution unchanged, after a check of how its run ended.

    A warning is issued for each journal that has left its bearing.

    **Raises:** `SimulationError` if the run failed and `throw` is set.
    """
    saved = solution.saved
    rows = [] if saved is None else [(saved.times, saved.states)]
    warn_of_journals_outside(scene, solution.time, solution.final, rows)
    if throw:
        raise_failure(solution)
    return solution


def _array(value: ArrayLike) -> jax.Array:
    return jnp.asarray(value, dtype=float)
