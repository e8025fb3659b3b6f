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

from .bodies import BodyState
from .dynamics import Formulation, Memory, Projection, mechanical_energy, state_rates
from .explicit import UnrolledExplicit
from .impacts import (
    Landing,
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
from .vectors import Scalar, Vector

REJECTED_ERROR = 1e100


class Method(eqx.Module):
    """How to integrate: solver, controller, formulation and landing."""

    solver: diffrax.AbstractSolver
    controller: diffrax.AbstractStepSizeController
    formulation: Formulation
    landing: Landing | None


class Variables(eqx.Module):
    """What the solver integrates: the coordinates' variables, and the ledger's integrals in J."""

    motion: Any
    work: dict[str, Scalar]


class Step(eqx.Module):
    """Everything between two steps: enough to go on from.

    `second_rates` are those of the contacts' depths, m/s^2. `intended` is the length of the next
    step, s, were it not cut short by an event; `enters` says that it is the first in a contact, of
    which `entering` is the length that held last.
    """

    t: Scalar
    t_next: Scalar
    y: Variables
    memory: Memory
    reaches: Reaches
    second_rates: Any
    intended: Scalar
    enters: Scalar
    entering: Scalar
    solver_state: Any
    controller_state: Any
    jumped: Any
    result: RESULTS
    attempts: Scalar
    accepted: Scalar


class Attempt(eqx.Module):
    """A step, and what is needed to look inside it."""

    step: Step
    kept: Scalar
    t_start: Scalar
    memory_start: Memory
    information: Any


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
    trial = _tried(method, scene, step, _end(method, step, t_end))
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
        intended, enters, entering = _resumed(step, after, t1, keep, lands, intended)
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
    sizes = _magnitudes(step.y), _magnitudes(trial.y)
    order = _error_order(method, _term(method))
    keep, _, t_next, jumped, state, result = method.controller.wrap(1).adapt_step_size(
        step.t, trial.t1, *sizes, (scene, step.memory), trial.error, order, step.controller_state
    )
    return keep, t_next, jumped, state, result


def _end(method: Method, step: Step, t_end: Scalar) -> Scalar:
    """Where the step ends: where it is proposed to, or at the next event."""
    t1 = jnp.minimum(step.t_next, t_end)
    if method.landing is None or not step.reaches:
        return t1
    resolution = 4.0 * jnp.finfo(t1.dtype).eps * jnp.maximum(jnp.abs(step.t), 1e-300)
    due = method.landing.due(step.reaches, step.second_rates)
    return jnp.minimum(t1, step.t + jnp.maximum(due, resolution))


def _resumed(
    step: Step, after: Reaches, t1: Scalar, keep: Scalar, lands: Scalar, proposed: Scalar
) -> tuple[Scalar, Scalar, Scalar]:
    """`intended`, `enters` and `entering` of the next step.

    What an event cut short tells nothing of the step to take next: that is the one intended
    before, or where a contact begins about as long as the last time.
    """
    h = t1 - step.t
    cut = h < 0.99 * step.intended
    begun = begins(step.reaches, after)
    entering = jnp.where(keep & step.enters & ~cut, h, step.entering)
    resumed = jnp.where(cut, jnp.maximum(proposed, step.intended), proposed)
    resumed = jnp.where(begun, jnp.minimum(resumed, 2.0 * entering), resumed)
    intended = jnp.where(lands, step.intended, jnp.where(keep, resumed, proposed))
    return intended, jnp.where(keep, begun, step.enters), entering


def _magnitudes(y: Variables) -> Variables:
    """What errors are compared with: each component, but of positions and velocities the largest.

    A journal that rolls along the wall hardly moves along one axis. Judged against that, its
    velocity would take a third more steps, for nothing, and their number would depend on the axes.
    """

    def largest(vector: Vector) -> Vector:
        size = jnp.maximum(jnp.maximum(jnp.abs(vector.x), jnp.abs(vector.y)), jnp.abs(vector.z))
        return Vector(size, size, size)

    def of(node: Any) -> Any:
        if not isinstance(node, BodyState):
            return node
        return BodyState(
            largest(node.position), node.orientation, largest(node.velocity), node.spin
        )

    return jax.tree.map(of, y, is_leaf=lambda node: isinstance(node, BodyState))


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
    """One test for all leaves: adding zero times each lets any NaN or infinity through."""
    total: Scalar = 0.0
    for leaf in jax.tree.leaves(tree):
        total = total + leaf * 0.0
    return total == 0.0


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
