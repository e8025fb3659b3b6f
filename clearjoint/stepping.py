"""The stepping loop: diffrax takes the steps and adapts them, this module decides what they mean.

It calls the solver's `step` and the controller's `adapt_step_size` (diffrax, "manual stepping")
rather than `diffeqsolve`: landing on impacts, the memory of the entry speed, projection and
the record of accepted steps belong between a trial step and its acceptance, where wrappers of
solver and controller reach only by hiding state in each other. The loop's body is scalar arithmetic
without callbacks, custom calls or scatters, so that XLA compiles it to one native function.
"""

from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp

from .dynamics import Formulation, Memory, Projection, mechanical_energy, state_rates
from .explicit import UnrolledExplicit
from .impacts import (
    Reach,
    Reaches,
    begins,
    has_memory,
    initial_memory,
    reaches,
    second_rates,
    updated_memory,
)
from .projection import project_positions, project_velocities
from .results import RESULTS
from .scene import Scene
from .several import total
from .step_length import end_of_step, magnitudes, resumed
from .steps import Attempt, Method, Step, Variables
from .vectors import Scalar

REJECTED_ERROR = 1e100


def _term(method: Method) -> diffrax.ODETerm:
    def field(t: Scalar, y: Variables, args: Any) -> Variables:
        scene, memory = args
        rates = Variables(*state_rates(scene, method.formulation, y.motion, memory, t))
        return jax.tree.map(lambda rate: jnp.asarray(rate, dtype=t.dtype), rates)

    return diffrax.ODETerm(field)


def start(
    method: Method,
    scene: Scene,
    t0: Scalar,
    t_end: Scalar,
    first_step: Scalar | None,
    y: Variables,
    memory: Memory,
) -> Step:
    """What there is before the first step; `memory` is found unless it is given."""
    found = reaches(scene, method.formulation.coordinates.motions(scene, y.motion))
    memory = memory or initial_memory(scene, found)
    y = Variables(y.motion, _ledger(method, scene, t0, y, memory))
    term, args = _term(method), (scene, memory)
    t_next, controller_state = method.controller.wrap(1).init(
        term, t0, t_end, y, first_step, args, method.solver.func, _error_order(method, term)
    )
    t_next = jnp.asarray(t_next, dtype=float)
    solver_state = method.solver.init(term, t0, t_next, y, args)
    count = jnp.zeros((), dtype=int)
    return jax.tree.map(
        jnp.asarray,
        Step(
            t0,
            t_next,
            y,
            memory,
            found,
            _second_rates(method, scene, y, solver_state, found),
            t_next - t0,
            False,
            t_next - t0,
            solver_state,
            controller_state,
            False,
            RESULTS.successful,
            count,
            count,
        ),
    )


def _error_order(method: Method, term: diffrax.ODETerm) -> Any:
    return method.solver.error_order(term)


def _ledger(
    method: Method, scene: Scene, t: Scalar, y: Variables, memory: Memory
) -> dict[str, Scalar]:
    """The ledger's integrals at the start: those given, and zero for the others the scene has."""
    _, powers = jax.eval_shape(lambda: state_rates(scene, method.formulation, y.motion, memory, t))
    return {name: y.work.get(name, jnp.zeros_like(t)) for name in powers}


class Trial(eqx.Module):
    """A step as the solver took it, before it is accepted or not."""

    t1: Scalar
    y: Variables
    error: Variables
    finite: Scalar
    information: Any
    solver_state: Any
    solver_result: Any


def attempt(method: Method, scene: Scene, step: Step, t_end: Scalar) -> Attempt:
    """Try one step, and accept it or propose a shorter one."""
    trial = _tried(method, scene, step, end_of_step(method, step, t_end))
    t1, y1 = trial.t1, trial.y
    keep, t_next, jumped, controller_state, controller_result = _judged(method, scene, step, trial)
    after = reaches(scene, method.formulation.coordinates.motions(scene, y1.motion))
    intended = t_next - jnp.where(keep, t1, step.t)
    enters, entering = step.enters, step.entering
    if method.landing is not None and after:
        passes, landing_time = method.landing.retry(step.reaches, after, step.t, t1)
        lands = keep & passes
        controller_state = _choose(lands, step.controller_state, controller_state)
        keep = keep & ~passes
        intended, enters, entering = resumed(step, after, t1, keep, lands, intended)
        t_next = jnp.where(lands, landing_time, jnp.where(keep, t1, step.t) + intended)
    result = _result(step, keep, trial, t_next, t_end, controller_result)
    seconds = _choose(
        keep, _second_rates(method, scene, y1, trial.solver_state, after), step.second_rates
    )
    memory = _memory_after(method, scene, step, y1, after, t1, keep, seconds)
    advanced = Step(
        jnp.where(keep, t1, step.t),
        t_next,
        _choose(keep, y1, step.y),
        _choose(keep, memory, step.memory),
        _choose(keep, after, step.reaches),
        seconds,
        intended,
        enters,
        entering,
        _choose(keep, trial.solver_state, step.solver_state),
        controller_state,
        jnp.where(keep, jumped | _may_jump(method, scene), step.jumped),
        result,
        step.attempts + 1,
        step.accepted + keep,
    )
    return Attempt(advanced, keep, step.t, step.memory, trial.information)


def _tried(method: Method, scene: Scene, step: Step, t1: Scalar) -> Trial:
    """The solver's step, projected if steps are. What is not finite stays where it was."""
    made_jump = step.jumped if _may_jump(method, scene) else False
    y1, error, information, solver_state, solver_result = method.solver.step(
        _term(method), step.t, t1, step.y, (scene, step.memory), step.solver_state, made_jump
    )
    finite = _all_finite((y1, error))
    y1 = _choose(finite, y1, step.y)
    if isinstance(method.formulation.stabilisation, Projection):
        y1 = projected(scene, method.formulation, y1, t1)
    error = jax.tree.map(lambda e: jnp.where(finite, e, REJECTED_ERROR), error)
    return Trial(t1, y1, error, finite, information, solver_state, solver_result)


def _judged(method: Method, scene: Scene, step: Step, trial: Trial) -> tuple[Any, ...]:
    """What the controller says: whether to keep the step, the end of the next, whether it jumped,
    its state and its result."""
    sizes = magnitudes(step.y), magnitudes(trial.y)
    order = _error_order(method, _term(method))
    keep, _, t_next, jumped, state, result = method.controller.wrap(1).adapt_step_size(
        step.t, trial.t1, *sizes, (scene, step.memory), trial.error, order, step.controller_state
    )
    return keep, t_next, jumped, state, result


def _may_jump(method: Method, scene: Scene) -> bool:
    """Whether a new memory may leave the last stage stale.

    Landing sets the memory where the force is still zero, so that it leaves it right.
    """
    return method.landing is None and has_memory(scene)


def _memory_after(
    method: Method,
    scene: Scene,
    step: Step,
    y1: Variables,
    after: Reaches,
    t1: Scalar,
    keep: Scalar,
    seconds: Any,
) -> Memory:
    """The memory if the step is accepted."""
    if not has_memory(scene):
        return step.memory
    if not isinstance(method.solver, UnrolledExplicit):
        seconds = jax.lax.cond(
            keep & begins(step.reaches, after),
            lambda: _end_second_rates(method, scene, step, y1, t1),
            lambda: seconds,
        )
    return updated_memory(scene, step.memory, step.reaches, after, seconds)


def _second_rates(
    method: Method, scene: Scene, y: Variables, solver_state: Any, found: Reaches
) -> Any:
    """Second derivatives of the gaps where the solver has the rates of the variables; else zero."""
    if found and isinstance(method.solver, UnrolledExplicit):
        return second_rates(scene, method.formulation, y.motion, solver_state.motion)
    return jax.tree.map(
        lambda reach: jnp.zeros_like(reach.rate),
        found,
        is_leaf=lambda node: isinstance(node, Reach),
    )


def _end_second_rates(method: Method, scene: Scene, step: Step, y1: Variables, t1: Scalar) -> Any:
    """Second derivatives of the gaps at the end of a step."""
    rates = _term(method).vf(t1, y1, (scene, step.memory))
    return second_rates(scene, method.formulation, y1.motion, rates.motion)


def projected(scene: Scene, formulation: Formulation, y: Variables, t: Scalar) -> Variables:
    """The variables on the constraints; what the projection takes is booked in the ledger."""
    motion = project_velocities(
        scene, formulation, project_positions(scene, formulation, y.motion, t), t
    )
    work = y.work
    if formulation.ledger and "stabilisation" in work:
        taken = _energy(scene, formulation, y.motion, t) - _energy(scene, formulation, motion, t)
        work = {**work, "stabilisation": work["stabilisation"] + taken}
    return Variables(motion, work)


def _energy(scene: Scene, formulation: Formulation, variables: Any, t: Scalar) -> Scalar:
    motions = formulation.coordinates.motions(scene, variables)
    return sum(mechanical_energy(scene, motions, t).values())


def _result(
    step: Step, keep: Scalar, trial: Trial, t_next: Scalar, t_end: Scalar, controller_result: Any
) -> RESULTS:
    now = jnp.where(keep, trial.t1, step.t)
    stuck = (t_next - now <= 2.0 * jnp.finfo(now.dtype).eps * jnp.abs(now)) & (now < t_end)
    gave_up = (keep & (trial.solver_result != diffrax.RESULTS.successful)) | (
        controller_result != diffrax.RESULTS.successful
    )
    result = RESULTS.where(stuck, RESULTS.step_too_small, step.result)
    result = RESULTS.where(keep & ~trial.finite, RESULTS.non_finite, result)
    return RESULTS.where(gave_up, RESULTS.solver_failed, result)


def _choose(condition: Scalar, first: Any, second: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), first, second)


def _all_finite(tree: Any) -> Scalar:
    """One test for all leaves: adding zero times each lets any NaN or infinity through. Leaves of
    one shape are added element by element before the elements are."""
    sums: dict[Any, Scalar] = {}
    for leaf in jax.tree.leaves(tree):
        shape = jnp.shape(leaf)
        sums[shape] = sums.get(shape, 0.0) + leaf * 0.0
    return sum(map(total, sums.values())) == 0.0


def look_inside(method: Method, scene: Scene, tried: Attempt, t: Scalar) -> tuple[Any, Any]:
    """Variables and memory at an instant of an accepted step, by the solver's dense output.

    The memory is that of the step's start: what the step's end changes holds from there on.
    """
    end = tried.step.t
    dense = method.solver.interpolation_cls(t0=tried.t_start, t1=end, **tried.information)
    y = _choose(t >= end, tried.step.y, dense.evaluate(t))
    if isinstance(method.formulation.stabilisation, Projection):
        y = Variables(projected(scene, method.formulation, y, t).motion, y.work)
    return y, _choose(t >= end, tried.step.memory, tried.memory_start)


def running(step: Step, t_end: Scalar, attempts: Scalar) -> Scalar:
    """Whether to try another step before `t_end` and within the number of attempts."""
    return (step.t < t_end) & (step.result == RESULTS.successful) & (step.attempts < attempts)
