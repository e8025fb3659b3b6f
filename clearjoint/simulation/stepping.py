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

from ..dynamics.breakpoints import breakpoints, seen
from ..dynamics.contact_events import (
    Reach,
    Reaches,
    begins,
    begins_at_once,
    has_memory,
    initial_memory,
    too_deep,
    updated_memory,
)
from ..dynamics.contact_forces import Memory
from ..dynamics.system import System
from ..math.vectors import Scalar
from ..results import RESULTS
from .jumps import across_contacts, contacts_jump
from .program_size import shapes_of
from .step_length import end_of_step, magnitudes, resumed, resumed_in_time
from .step_state import Attempt, Method, Step, Tangents, TangentsInside, Variables, choose
from .switches import across_breakpoints, joints_have_breakpoints
from .systems import SystemFamily
from .trial_step import Trial, graded_step, may_jump, term_of, tried
from .unrolled_runge_kutta import UnrolledExplicit
from .unseen_jumps import jumped_unseen, may_jump_unseen

TANGENT_TOLERANCE = 10.0
"""Tolerances of the tangents in those of the state: at rtol 1e-9 derivatives along the double
pendulum's first eleven contacts are then right to 6e-7, at 1e-11 to 2e-8."""
FOLLOWED = 1e-3
"""rad or m: a driver farther off what it prescribes is not followed. Stabilised constraints drift
by a thousandth of this at usual tolerances."""


def start(
    method: Method,
    system: System,
    t0: Scalar,
    t_end: Scalar,
    first_step: Scalar | None,
    y: Variables,
    memory: Memory,
    derivatives: bool = False,
) -> Step:
    """What there is before the first step; `memory` is found unless it is given. `derivatives` tell
    that the step will carry them."""
    found = system.reaches(y.motion)
    memory = memory or initial_memory(system.scene, found)
    y = Variables(y.motion, _ledger(system, t0, y, memory, derivatives))
    term, args = term_of(method), (system, memory)
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
            _second_rates(method, system, y, solver_state, found),
            t_next - t0,
            begins_at_once(found),
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
    system: System, t: Scalar, y: Variables, memory: Memory, derivatives: bool
) -> dict[str, Scalar]:
    """The ledger's integrals at the start: those given, and zero for the others the scene has."""
    _, powers = shapes_of(lambda: system.rates(y.motion, memory, t), derivatives)
    return {name: y.work.get(name, jnp.zeros_like(t)) for name in powers}


class Verdict(eqx.Module):
    """Whether a trial is kept, and the step to take next; fields as those of `Step`."""

    keep: Scalar
    t_next: Scalar
    intended: Scalar
    enters: Scalar
    entering: Scalar
    jumped: Scalar
    controller_state: Any
    controller_result: Any


def attempt(
    method: Method, system: System, step: Step, t_end: Scalar, family: SystemFamily | None = None
) -> Attempt:
    """Try one step, and accept it or propose a shorter one.

    If the step has tangents, `family` is that of the scene, and says along what they are.
    """
    trial = tried(method, system, step, end_of_step(method, system, step, t_end), family)
    t1, y1 = trial.t1, trial.taken.y
    after = system.reaches(y1.motion)
    verdict = _decided(method, system, step, trial, after)
    keep = verdict.keep
    result = _result(system, step, trial, verdict, after, t_end)
    seconds = choose(
        keep, _second_rates(method, system, y1, trial.taken.solver_state, after), step.second_rates
    )
    memory = _memory_after(method, system, step, y1, after, t1, keep, seconds)
    y1, y1_along = _across_jumps(method, system, family, step, trial, keep)
    if joints_have_breakpoints(system.scene):
        after = system.reaches(y1.motion)
    tangents = inside = None
    if family is not None:
        assert step.tangents is not None and trial.tangents is not None
        ahead = _tangents_after(family, step, trial, y1_along, seconds)
        tangents = choose(keep, ahead, step.tangents)
        inside = TangentsInside(step.tangents.memory, trial.tangents.information)
        if may_jump_unseen(system.scene):
            jumps = keep & jumped_unseen(method, system, step, trial, after)
            result = RESULTS.where(jumps, RESULTS.force_jumped, result)
    advanced = Step(
        jnp.where(keep, t1, step.t),
        verdict.t_next,
        choose(keep, y1, step.y),
        choose(keep, memory, step.memory),
        choose(keep, after, step.reaches),
        seconds,
        verdict.intended,
        verdict.enters,
        verdict.entering,
        choose(keep, trial.taken.solver_state, step.solver_state),
        verdict.controller_state,
        jnp.where(keep, verdict.jumped | may_jump(method, system.scene), step.jumped),
        result,
        step.attempts + 1,
        step.accepted + keep,
        tangents,
    )
    return Attempt(
        advanced,
        keep,
        step.t,
        step.memory,
        trial.taken.information,
        graded_step(method, step),
        inside,
    )


def _decided(method: Method, system: System, step: Step, trial: Trial, after: Reaches) -> Verdict:
    """What the controller says, unless the step must land on an event that it passes."""
    t1 = trial.t1
    keep, t_next, jumped, controller_state, controller_result = _judged(method, system, step, trial)
    intended = t_next - jnp.where(keep, t1, step.t)
    enters, entering = step.enters, step.entering
    if method.landing is not None and after:
        passes, landing_time = method.landing.retry(step.reaches, after, step.t, t1)
        lands = keep & passes
        controller_state = choose(lands, step.controller_state, controller_state)
        keep = keep & ~passes
        intended, enters, entering = resumed(step, after, t1, keep, lands, intended)
        t_next = jnp.where(lands, landing_time, jnp.where(keep, t1, step.t) + intended)
    elif breakpoints(system.scene):
        intended = resumed_in_time(step, t1, keep, intended)
        t_next = jnp.where(keep, t1, step.t) + intended
    return Verdict(
        keep, t_next, intended, enters, entering, jumped, controller_state, controller_result
    )


def _judged(method: Method, system: System, step: Step, trial: Trial) -> tuple[Any, ...]:
    """What the controller says: whether to keep the step, the end of the next, whether it jumped,
    its state and its result."""
    before, after, error = magnitudes(step.y), magnitudes(trial.taken.y), trial.taken.error
    if trial.tangents is not None:
        assert step.tangents is not None
        before = before, magnitudes(step.tangents.y)
        after = after, magnitudes(trial.tangents.y)
        error = error, jax.tree.map(lambda e: e / TANGENT_TOLERANCE, trial.tangents.error)
    order = _error_order(method, term_of(method))
    keep, _, t_next, jumped, state, result = method.controller.wrap(1).adapt_step_size(
        step.t, trial.t1, before, after, (system, step.memory), error, order, step.controller_state
    )
    return keep, t_next, jumped, state, result


def _across_jumps(
    method: Method,
    system: System,
    family: SystemFamily | None,
    step: Step,
    trial: Trial,
    keep: Scalar,
) -> tuple[Variables, Any]:
    """The variables at the end of a step, and their tangents if there are any, with what jumps of
    the forces there leave in them."""
    y1, along = trial.taken.y, None if trial.tangents is None else trial.tangents.y
    contacts = method.landing is not None and contacts_jump(system.scene)
    switches = bool(breakpoints(system.scene))
    if not contacts and not switches:
        return y1, along
    t1 = trial.t1

    def across(system: System, y: Variables, memory: Memory) -> tuple[Variables, None]:
        if contacts:
            time = seen(system.scene, step.t, t1)
            y = across_contacts(system, step.reaches, y, memory, time, keep)
        if switches:
            y = across_breakpoints(system, step.t, y, memory, t1, keep)
        return y, None

    if family is None:
        return across(system, y1, step.memory)[0], None
    assert step.tangents is not None
    y1, _, along = family.pushed(across, (y1, step.memory), (along, step.tangents.memory))
    return y1, along


def _tangents_after(
    family: SystemFamily,
    step: Step,
    trial: Trial,
    y_along: Any,
    seconds: Any,
) -> Tangents:
    """The tangents if the step is accepted; `y_along` are those of the variables.

    Those of the entry speed hold up to terms of the size of the depth landed at, since the second
    rates are taken as constants.
    """
    taken, along = trial.tangents, step.tangents
    assert taken is not None and along is not None

    def memory_after(system: System, y1: Variables, memory: Memory) -> tuple[Memory, None]:
        after = system.reaches(y1.motion)
        return updated_memory(system.scene, memory, step.reaches, after, seconds), None

    memory, _, memory_tangents = family.pushed(
        memory_after, (trial.taken.y, step.memory), (taken.y, along.memory)
    )
    return Tangents(y_along, memory_tangents, taken.solver_state)


def _memory_after(
    method: Method,
    system: System,
    step: Step,
    y1: Variables,
    after: Reaches,
    t1: Scalar,
    keep: Scalar,
    seconds: Any,
) -> Memory:
    """The memory if the step is accepted."""
    if not has_memory(system.scene):
        return step.memory
    if not isinstance(method.solver, UnrolledExplicit):
        seconds = jax.lax.cond(
            keep & begins(step.reaches, after),
            lambda: _end_second_rates(method, system, step, y1, t1),
            lambda: seconds,
        )
    return updated_memory(system.scene, step.memory, step.reaches, after, seconds)


def _second_rates(
    method: Method, system: System, y: Variables, solver_state: Any, found: Reaches
) -> Any:
    """Second derivatives of the gaps where the solver has the rates of the variables; else zero."""
    if found and isinstance(method.solver, UnrolledExplicit):
        return system.second_rates(y.motion, solver_state.motion)
    return jax.tree.map(
        lambda reach: jnp.zeros_like(reach.rate),
        found,
        is_leaf=lambda node: isinstance(node, Reach),
    )


def _end_second_rates(method: Method, system: System, step: Step, y1: Variables, t1: Scalar) -> Any:
    """Second derivatives of the gaps at the end of a step."""
    rates = term_of(method).vf(t1, y1, (system, step.memory))
    return system.second_rates(y1.motion, rates.motion)


def _result(
    system: System,
    step: Step,
    trial: Trial,
    verdict: Verdict,
    after: Reaches,
    t_end: Scalar,
) -> RESULTS:
    keep, controller_result = verdict.keep, verdict.controller_result
    now = jnp.where(keep, trial.t1, step.t)
    eps = jnp.finfo(now.dtype).eps
    resolution = 2.0 * eps * jnp.maximum(jnp.abs(now), eps * (t_end - now))  # at t = 0 as well
    stuck = (verdict.t_next - now <= resolution) & (now < t_end)
    gave_up = (keep & (trial.solver_result != diffrax.RESULTS.successful)) | (
        controller_result != diffrax.RESULTS.successful
    )
    result = RESULTS.where(stuck, RESULTS.step_too_small, step.result)
    if after:
        result = RESULTS.where(keep & too_deep(system.scene, after), RESULTS.left_bearing, result)
    off = system.off_prescribed(trial.taken.y.motion, seen(system.scene, step.t, trial.t1))
    if off is not None:
        result = RESULTS.where(keep & (off > FOLLOWED), RESULTS.not_followed, result)
    result = RESULTS.where(keep & ~trial.finite, RESULTS.non_finite, result)
    return RESULTS.where(gave_up, RESULTS.solver_failed, result)


def not_tried(
    method: Method, system: System, step: Step, t_end: Scalar, family: SystemFamily | None = None
) -> Attempt:
    """A step before the first attempt, in the form of one."""
    shapes = jax.eval_shape(lambda: attempt(method, system, step, t_end, family))
    zeros = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes)
    return eqx.tree_at(lambda a: a.step, zeros, step)


def running(step: Step, t_end: Scalar, attempts: Scalar) -> Scalar:
    """Whether to try another step before `t_end` and within the number of attempts."""
    return (step.t < t_end) & (step.result == RESULTS.successful) & (step.attempts < attempts)
