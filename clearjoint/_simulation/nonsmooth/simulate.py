"""Simulation with rigid contacts, whose impacts have no duration: `simulate_nonsmooth`."""

from dataclasses import replace
from functools import reduce

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Float, Int

from ..._compilation.xla import Compiled
from ..._dynamics import breakpoints
from ..._dynamics.coordinates import AbstractCoordinates, MotionVariables
from ..._dynamics.formulation import Formulation
from ..._dynamics.joint_coordinates.coordinates import JointCoordinates
from ..._dynamics.journals import warn_of_journals_outside
from ..._dynamics.sampled_forces import sampled_forces
from ..._dynamics.system import System
from ..._fields.checks import require, require_positive
from ..._fields.objects import with_arrays
from ..._fields.types import ArrayLike
from ..._math.vectors import Condition, ConstantFolded, Scalar, fold_constants, pack, unpack
from ..._model.bodies import BodyState, State
from ..._model.joints.base import each_label
from ..._model.scene import Scene
from ..._result_codes import RESULTS
from ..results.nonsmooth_solution import ContactTotals, NonsmoothSolution
from ..results.solution import Trajectory, raise_failure
from ..run.run_checks import check_numbers, check_precision, check_start, in_domain, is_traced
from ..run.saving import EXCEPT_TIMES, Saving, saving_or_nothing
from ..step.settings import Settings, check_span
from ..step.step_state import choose
from ..step.trial_step import all_finite
from .contact_problem import require_restitution, restitutions
from .moreau_jean import SOLVED, Rigid, advance

DRIVER_TOLERANCE = 1e-5
"""Relative tolerance of `drivers_are_smooth`, far above the error of the quadrature there."""


class RigidRun(eqx.Module):
    """A run between two steps. `touching`: whether each contact had an impulse in the last step;
    `totals`: sums and maxima of each contact since the start; `residual`: largest relative residual
    of the contact problems, and `steps`: number of steps, both without a step that failed."""

    t: Scalar
    variables: MotionVariables
    touching: dict[str, dict[str, Condition]]
    totals: dict[str, dict[str, ContactTotals]]
    residual: Scalar
    result: RESULTS
    steps: Scalar


class RigidStop(eqx.Module):
    """State of a run at one of its stops, which are the times to save at and the end. `bodies` have
    arrays for vectors; `totals` are those of each contact so far. For n stops, arrays have an
    additional first axis, (n,)."""

    bodies: dict[str, BodyState]
    totals: dict[str, dict[str, ContactTotals]]
    result: RESULTS


def run(
    folded_scene: ConstantFolded,
    formulation: Formulation,
    state: State,
    stops: Float[jax.Array, " stops"],
    longest: Scalar,
    restitution: Scalar | None,
    admissible: Condition | None = None,
) -> tuple[RigidRun, RigidStop]:
    """Run a scene from the first to the last of S stops, (S,) s, and return the run at its end, and
    the S - 1 stops after the first.

    **Arguments:** `longest`: s, length of the longest step; `restitution`: coefficient of every
    contact, or ``None`` for those of the contact laws; `admissible`: whether all numbers are within
    their ranges; if not, the run takes no step, and its result is `RESULTS.domain`.
    """
    system = System(unpack(folded_scene), formulation)
    rigid = Rigid(system, restitutions(system.scene, restitution))
    start = _first(rigid, system.encode(unpack(state.bodies)), stops[0])
    if admissible is not None:
        start = replace(start, result=RESULTS.where(admissible, start.result, RESULTS.domain))
    times, stop_indices = _with_breakpoints(system.scene, stops)

    # Continue the run over a `span`, from one of `times` to the next. If a driver has a breakpoint
    # at its end, `_past_kink` sets the velocities that the driver prescribes just after it.
    def to_stop(now: RigidRun, span: tuple[Scalar, Scalar]) -> tuple[RigidRun, RigidStop]:
        now = _past_kink(system, _to_stop(rigid, now, *span, longest), *span)
        bodies = pack(system.decode(now.variables))
        return now, RigidStop(bodies=bodies, totals=now.totals, result=now.result)

    # The scan goes from breakpoint to breakpoint too; only the states at stops are kept.
    end, states = jax.lax.scan(to_stop, start, (times[:-1], times[1:]))
    if stop_indices is not None:
        states = jax.tree.map(lambda leaf: leaf[stop_indices], states)
    return end, states


run_compiled = Compiled(run)


def _with_breakpoints(
    scene: Scene, stops: Float[jax.Array, " stops"]
) -> tuple[Float[jax.Array, " times"], Int[jax.Array, " rest"] | None]:
    """Return the sorted stops and breakpoints, `times`, (T,) s, at which steps must end, and for
    each stop except the first its index in ``times[1:]``, or ``None`` without breakpoints."""
    elements = jax.tree.leaves(breakpoints.breakpoints(scene))
    if not elements:
        return stops, None
    # A breakpoint outside of the run is moved to its start or end, where it adds no step.
    inside = [jnp.clip(jnp.ravel(at).astype(float), stops[0], stops[-1]) for at in elements]
    # A stop that is a breakpoint too is in `times` twice. The index is that of the last of equal
    # times, at which the run surely has the velocities that hold after the breakpoint. One is
    # subtracted because `side="right"` gives the index after it, and one for the first time.
    times = jnp.sort(jnp.concatenate([stops, *inside]))
    return times, jnp.searchsorted(times, stops[1:], side="right") - 2


def _past_kink(system: System, now: RigidRun, start: Scalar, stop: Scalar) -> RigidRun:
    """Return the run `now`, after the steps from `start` to `stop`, s, with the velocities that
    drivers prescribe just after `stop`. They change only if a driver has a breakpoint there."""
    # For each joint with breakpoints, the first entry tells whether one of them is in the span,
    # and thus at its end, `stop`. Forces have breakpoints too, but prescribe no velocities.
    since = breakpoints.since_breakpoints(system, start, stop)
    joints = [has_one for name, (has_one, _) in since.items() if name in system.scene.joints]
    if not joints:
        return now
    # The time `stop` in a step that starts there: just after a breakpoint.
    just_after = breakpoints.one_sided_time(system, stop, stop)
    # Where a driver's velocity jumps, the change of the speeds has the least kinetic energy. A run
    # that failed stays where it is, before `stop`.
    variables = jax.lax.cond(
        reduce(jnp.logical_or, joints) & (now.result == RESULTS.successful),
        lambda variables: system.project_velocities(variables, just_after),
        lambda variables: variables,
        now.variables,
    )
    return replace(now, variables=variables)


def _to_stop(rigid: Rigid, now: RigidRun, start: Scalar, stop: Scalar, longest: Scalar) -> RigidRun:
    """Return the run after equal steps, not longer than `longest`, from `start` to `stop`, all in
    s. If a step fails, the run stays as it was before it, with the failure as result."""
    # The factor is slightly below 1, because rounding of the span could otherwise add a step.
    count = jnp.ceil((stop - start) / longest * (1.0 - 1e-9))
    h = (stop - start) / jnp.maximum(count, 1.0)

    def goes(carry: tuple[RigidRun, Scalar]) -> Scalar:
        now, k = carry
        return (k < count) & (now.result == RESULTS.successful)

    def go(carry: tuple[RigidRun, Scalar]) -> tuple[RigidRun, Scalar]:
        now, k = carry
        return _after_step(rigid, now, start + k * h, h), k + 1.0

    end, _ = jax.lax.while_loop(goes, go, (now, jnp.zeros(())))
    # The sum of the steps differs from `stop` by rounding errors.
    return replace(end, t=jnp.where(end.result == RESULTS.successful, stop, end.t))


def _first(rigid: Rigid, variables: MotionVariables, t: Scalar) -> RigidRun:
    zero, no_count = jnp.zeros(()), jnp.zeros((), int)
    no_totals = ContactTotals(no_count, zero, zero, zero, zero, zero)
    laws = rigid.system.scene.laws()
    return RigidRun(
        t=t,
        variables=jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=float), variables),
        touching=each_label(lambda name, label: jnp.asarray(False), laws),
        totals=each_label(lambda name, label: no_totals, laws),
        residual=zero,
        result=RESULTS.successful,
        steps=no_count,
    )


def _after_step(rigid: Rigid, now: RigidRun, t: Scalar, h: Scalar) -> RigidRun:
    end = advance(rigid, now.variables, t, h)
    # A state that is not finite has its own result code, since the other conditions mean nothing
    # then. A penetration that is too deep has precedence over an unsolved contact problem, which
    # has little meaning where the side of the contact is unknown. Drivers are judged only in a step
    # that is good otherwise.
    finite = all_finite(end.variables)
    contacts, solved = end.contacts, end.residual <= SOLVED

    # Totals of one contact after this step. An impact is counted if the contact has an impulse, and
    # had none in the step before.
    def total(name: str, label: str) -> ContactTotals:
        totals, step = now.totals[name][label], contacts[name][label]
        pushes = step.impulse > 0.0
        approach = jnp.where(pushes, jnp.maximum(-step.opening, 0.0), 0.0)
        return ContactTotals(
            impacts=totals.impacts + (pushes & ~now.touching[name][label]),
            impulse=totals.impulse + step.impulse,
            dissipated=totals.dissipated + step.dissipated,
            hardest=jnp.maximum(totals.hardest, step.impulse),
            fastest=jnp.maximum(totals.fastest, approach),
            penetration=jnp.maximum(totals.penetration, step.penetration),
        )

    result = RESULTS.where(finite, now.result, RESULTS.non_finite)
    result = RESULTS.where(finite & ~solved, RESULTS.contact_unsolved, result)
    result = RESULTS.where(finite & ~end.shallow, RESULTS.step_too_long, result)
    good = finite & solved & end.shallow
    # Drivers enter the equations by their second derivatives, at single times of a step only.
    # Without this check, a kink or jump between these times would pass unnoticed.
    smooth = breakpoints.drivers_are_smooth(rigid.system, end.variables, t, t + h, DRIVER_TOLERANCE)
    if smooth is not None:
        result = RESULTS.where(good & ~smooth, RESULTS.not_followed, result)
        good = good & smooth
    # At a breakpoint at the end of the step, drivers have the values just before it.
    time = breakpoints.one_sided_time(rigid.system, t, t + h)
    violated = rigid.system.constraints_violated(end.variables, time)
    if violated is not None:
        result = RESULTS.where(good & violated, RESULTS.not_followed, result)
        good = good & jnp.logical_not(violated)
    following = RigidRun(
        t=t + h,
        variables=end.variables,
        touching=each_label(lambda name, label: contacts[name][label].impulse > 0.0, contacts),
        totals=each_label(total, contacts),
        residual=jnp.maximum(now.residual, end.residual),
        result=now.result,
        steps=now.steps + 1,
    )
    return replace(choose(good, following, now), result=result)


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

    Where a driver makes velocities jump, their change is the one of least kinetic energy.

    The function works under `jax.vmap`, `jax.jit` and `jax.jvp`. It then raises no error for a
    traced number outside its range: the run ends before its first step with `RESULTS.domain`. But
    derivatives across impacts are not derivatives of the motion, since the step in which an impact
    happens does not change with the parameters.

    **Arguments:**

    - `scene`, `state`: the mechanism, and its initial state, which must satisfy the constraints.
    - `end_time`, `start_time`: end and start of the run, s.
    - `save`: the times at which to save the state. Nothing else can be saved.
    - `step`: s, length of the longest step. Steps end at the times to save at and at breakpoints;
      between two such times, all steps are equal.
    - `restitution`: Newton's coefficient of restitution of every contact, 0 to 1, in place of the
      restitutions that the contact laws deliver.
    - `coordinates`: coordinates of the equations of motion; `JointCoordinates` unless given.
    - `redundant`: whether some constraints depend linearly on others. By default this is determined
      from the initial state; under a transformation of JAX the default is ``False``.
    - `throw`: whether to raise `SimulationError` if the run fails. If ``False``, and always if JAX
      traces the run, its solution is returned, with the failure as `result`.

    **Returns:** a `NonsmoothSolution`.

    **Raises:** `ValueError` for invalid arguments, such as a law without the method
    `delivered_restitution`, a thrust face whose friction has a moment, or a sampled force, such as
    a `Servo`, and if JAX computes in 32 bits; `SimulationError` for a run that fails: the contact
    problem of a step is not solved, a penetration exceeds the bearing's clearance or the depth at
    which `simulate` would end, a driver has an undeclared kink or jump inside a step, an ideal
    joint's error exceeds the smallest clearance or 1e-3 m or rad, or the state is not finite.

    **Warns:** `LeftBearingWarning` if a journal without axial support has left its bearing in a
    saved state or at the end; `UnusualValueWarning` for a journal that starts deep in the wall.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> solution = cj.simulate_nonsmooth(scene, state, 0.02, step=1e-4)
    >>> int(solution.contacts["shoulder"]["V"].impacts)
    1
    """
    check_precision(False)
    scene, state = with_arrays((scene, state))
    save = saving_or_nothing(save)
    save.require_none(EXCEPT_TIMES, "of a run with rigid contacts", "take simulate() for it")
    coordinates = JointCoordinates() if coordinates is None else coordinates
    Settings(coordinates=coordinates, redundant=redundant)  # raises an error for other types
    traced = is_traced((scene, state, end_time, start_time, step, restitution))
    times: ArrayLike | None = save.at(scene)
    redundant_constraints: tuple[str, ...] = ()

    def check() -> None:
        require_positive("step", step, "give the longest step in s")
        check_span(start_time, end_time)
        save.times_between(scene, start_time, end_time)
        check_numbers(scene, state)
        require_restitution(scene, restitution)
        sampled, expected = sorted(sampled_forces(scene)), "without sampled forces"
        remedy = "take simulate(): runs with rigid contacts carry no memories of forces"
        require(not sampled, "scene.forces", sampled, expected, remedy)

    # Known numbers are checked now. Checks of traced numbers become a condition of the program.
    admissible = in_domain(check)
    # The following need values of numbers, which traced numbers lack.
    if not traced:
        shortest = (float(end_time) - float(start_time)) / MOST_STEPS
        expected = f"at least {shortest:.1g} s, a part in {MOST_STEPS:.0g} of the span"
        remedy = "give a longer step in s, or an earlier end_time"
        require(bool(float(step) >= shortest), "step", step, expected, remedy)
        times = save.times_between(scene, start_time, end_time)
        redundant_constraints = check_start(scene, state, start_time, coordinates)
    are_redundant = bool(redundant_constraints) if redundant is None else redundant
    formulation = Formulation(coordinates, redundant=are_redundant)
    save_times = jnp.asarray([] if times is None else times)
    stops = jnp.concatenate([_array(start_time)[None], save_times, _array(end_time)[None]])
    coefficient = None if restitution is None else _array(restitution)
    numbers = state, stops, _array(step), coefficient, admissible
    end, states = run_compiled(fold_constants(scene), formulation, *numbers)
    # Without times to save at, the solution's `saved` is ``None``, not a trajectory without states.
    save_times = None if times is None else stops[1:-1]
    solution = _solution(end, states, save_times, formulation, redundant_constraints)
    if traced:
        return solution
    solution = jax.device_get(solution)
    saved = solution.saved
    rows = [] if saved is None else [(saved.times, saved.states)]
    warn_of_journals_outside(scene, solution.time, solution.final, rows)
    if throw:
        raise_failure(solution)
    return solution


def _solution(
    end: RigidRun,
    stops: RigidStop,
    times: Float[jax.Array, " times"] | None,
    formulation: Formulation,
    redundant_constraints: tuple[str, ...],
) -> NonsmoothSolution:
    saved, history, count = None, None, None
    if times is not None:
        # The last stop is the end of the run, which is not a saved state.
        saved_stops = jax.tree.map(lambda leaf: leaf[:-1], stops)
        # If the run failed, all stops from the failure on have its result code and no meaning.
        history = totals = saved_stops.totals
        count = (saved_stops.result == RESULTS.successful).sum()
        # Rigid contacts have no entry speeds, but a saved state lists one for each contact.
        zeros = each_label(lambda name, label: jnp.zeros_like(totals[name][label].impulse), totals)
        saved = Trajectory(times, State(saved_stops.bodies, zeros))
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


def _array(value: ArrayLike) -> jax.Array:
    return jnp.asarray(value, dtype=float)
