"""The stepping loop: diffrax takes the steps and adapts them, this module decides what they mean.

It calls the solver's `step` and the controller's `adapt_step_size` (diffrax, "manual stepping")
rather than `diffeqsolve`: landing on impacts, the memory of the entry speed, projection and
the record of accepted steps belong between a trial step and its acceptance, where wrappers of
solver and controller reach only by hiding state in each other. The loop's body is scalar arithmetic
without callbacks, custom calls or scatters, so that XLA compiles it to one native function.
"""

from collections.abc import Callable
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp

from ...dynamics.breakpoints import breakpoints, seen
from ...dynamics.bristles import initial_bristles, updated_bristles
from ...dynamics.contact_events import (
    ContactGap,
    ContactGaps,
    begins,
    begins_at_once,
    initial_entry_speeds,
    updated_entry_speeds,
    uses_entry_speed,
)
from ...dynamics.contact_forces import Bristles, EntrySpeeds
from ...dynamics.energy import bristle_energy
from ...dynamics.system import System
from ...math.vectors import Condition, Scalar
from ...result_codes import RESULTS
from .acceptance import decide_step
from .breakpoint_events import across_breakpoints, joints_have_breakpoints
from .program_size import shapes_of
from .saltation import across_contacts, contacts_jump, slopes_jump
from .step_length import end_of_step
from .step_state import (
    Attempt,
    Method,
    Proposal,
    Step,
    Tangents,
    TangentsInside,
    Variables,
    choose,
)
from .systems import SystemFamily
from .trial_step import Trial, error_order, term_of, try_step
from .types import SecondRates, SolverState
from .unrolled_runge_kutta import UnrolledExplicit


def start(
    method: Method,
    system: System,
    t0: Scalar,
    t_end: Scalar,
    first_step: Scalar | None,
    y: Variables,
    entry_speeds: EntrySpeeds,
    derivatives: bool = False,
) -> Step:
    """What there is before the first step from t0.

    **Arguments:** `first_step`: s; chosen by the controller unless given. `entry_speeds`: entry
    speeds; from the contacts at t0 if it is empty. `derivatives`: whether the step will carry them.
    """
    contact_gaps = system.contact_gaps(y.motion)
    entry_speeds = entry_speeds or initial_entry_speeds(system.scene, contact_gaps)
    y = replace(y, bristles=initial_bristles(system.scene, y.bristles))
    y = replace(y, work=_ledger(system, t0, y, entry_speeds, derivatives))
    term, args = term_of(method), (system, entry_speeds)
    t_next, controller_state = method.controller.wrap(1).init(
        term, t0, t_end, y, first_step, args, method.solver.func, error_order(method)
    )
    t_next = jnp.asarray(t_next, dtype=float)
    solver_state = method.solver.init(term, t0, t_next, y, args)
    count = jnp.zeros((), dtype=int)
    step = Step(
        t=t0,
        y=y,
        entry_speeds=entry_speeds,
        contact_gaps=contact_gaps,
        second_rates=_second_rates(method, system, y, solver_state, contact_gaps),
        solver_state=solver_state,
        proposal=Proposal(
            t_next=t_next,
            full_length=t_next - t0,
            begins_contact=begins_at_once(contact_gaps),
            since_begin=_since_begin(contact_gaps) if derivatives else None,
            entry_length=t_next - t0,
            made_jump=False,
            controller_state=controller_state,
        ),
        result=RESULTS.successful,
        attempts=count,
        accepted=count,
    )
    return jax.tree.map(jnp.asarray, step)


def _since_begin(contact_gaps: ContactGaps) -> Scalar:
    """Time in s for which a contact has existed at the start of a run, of which nothing is known
    unless it begins there."""
    return jnp.where(begins_at_once(contact_gaps), 0.0, jnp.inf)


def _ledger(
    system: System, t: Scalar, y: Variables, entry_speeds: EntrySpeeds, derivatives: bool
) -> dict[str, Scalar]:
    """The ledger's integrals at the start: those given, and for the others the scene has zero, or
    for friction what bristles hold, which it books."""
    _, powers = shapes_of(
        lambda: system.rates(y.motion, entry_speeds, t, bristles=y.bristles), derivatives
    )
    work = {name: y.work.get(name, jnp.zeros_like(t)) for name in powers}
    if y.bristles and "friction" in powers.keys() - y.work.keys():
        forces = system.contact_forces(y.motion, entry_speeds, y.bristles)
        held = bristle_energy(system.scene, system.motions(y.motion), forces, y.bristles)
        work["friction"] = work["friction"] if held is None else jnp.asarray(held)
    return work


class _Arrival(eqx.Module):
    """The state at the end of a trial, if it is accepted: fields as those of `Step`."""

    y: Variables
    entry_speeds: EntrySpeeds
    contact_gaps: ContactGaps
    second_rates: SecondRates
    tangents: Tangents | None


def attempt(
    method: Method, system: System, step: Step, t_end: Scalar, family: SystemFamily | None = None
) -> Attempt:
    """Try one step, and accept it or propose a shorter one.

    If the step has tangents, `family` is that of the scene, and says along what they are.
    """
    trial = try_step(method, system, step, end_of_step(method, system, step, t_end), family)
    after = system.contact_gaps(trial.outcome.y.motion)
    decision = decide_step(method, system, step, trial, after, t_end)
    keep = decision.keep
    arrival = _arrival(method, system, family, step, trial, after, keep)
    inside = None
    if step.tangents is not None and trial.tangents is not None:
        inside = TangentsInside(step.tangents.entry_speeds, trial.tangents.information)
    return Attempt(
        step=Step(
            t=jnp.where(keep, trial.t1, step.t),
            y=choose(keep, arrival.y, step.y),
            entry_speeds=choose(keep, arrival.entry_speeds, step.entry_speeds),
            contact_gaps=choose(keep, arrival.contact_gaps, step.contact_gaps),
            second_rates=arrival.second_rates,
            solver_state=choose(keep, trial.outcome.solver_state, step.solver_state),
            proposal=decision.proposal,
            result=decision.result,
            attempts=step.attempts + 1,
            accepted=step.accepted + keep,
            tangents=choose(keep, arrival.tangents, step.tangents),
        ),
        kept=keep,
        t_start=step.t,
        entry_speeds_start=step.entry_speeds,
        information=trial.outcome.information,
        time_map=trial.time_map,
        tangents=inside,
    )


def _arrival(
    method: Method,
    system: System,
    family: SystemFamily | None,
    step: Step,
    trial: Trial,
    after: ContactGaps,
    keep: Condition,
) -> _Arrival:
    """What a trial arrives at, with the contacts `after`: memory, forces that jump, tangents."""
    t1, y1 = trial.t1, trial.outcome.y
    second_rates = choose(
        keep,
        _second_rates(method, system, y1, trial.outcome.solver_state, after),
        step.second_rates,
    )
    entry_speeds = _entry_speeds_after(method, system, step, y1, after, t1, keep, second_rates)
    y1, y_tangents = _across_jumps(method, system, family, step, trial, keep)
    if joints_have_breakpoints(system.scene):
        after = system.contact_gaps(y1.motion)
    tangents = None
    if family is not None:
        assert y_tangents is not None
        tangents = _tangents_after(family, step, trial, y_tangents, second_rates)
    return _Arrival(y1, entry_speeds, after, second_rates, tangents)


def _across_jumps(
    method: Method,
    system: System,
    family: SystemFamily | None,
    step: Step,
    trial: Trial,
    keep: Condition,
) -> tuple[Variables, Variables | None]:
    """The variables at the end of a step, and their tangents if there are any, with what jumps of
    the forces there leave in them."""
    y1, y_tangents = trial.outcome.y, None if trial.tangents is None else trial.tangents.y
    slopes = family is not None and slopes_jump(system.scene)
    contacts = method.landing is not None and (slopes or contacts_jump(system.scene))
    switches = bool(breakpoints(system.scene))
    if not contacts and not switches and not y1.bristles:
        return y1, y_tangents
    t1 = trial.t1

    def across(system: System, y: Variables, entry_speeds: EntrySpeeds) -> tuple[Variables, None]:
        if contacts:
            time = seen(system, step.t, t1)
            y = across_contacts(system, step.contact_gaps, y, entry_speeds, time, keep)
        if switches:
            y = across_breakpoints(system, step.t, y, entry_speeds, t1, keep)
        if y.bristles:
            y = replace(y, bristles=_bristles_after(method, system, step, y))
        return y, None

    if family is None:
        return across(system, y1, step.entry_speeds)[0], None
    assert step.tangents is not None
    tangents = y_tangents, step.tangents.entry_speeds
    y1, _, y_tangents = family.pushed(across, (y1, step.entry_speeds), tangents)
    return y1, y_tangents


def _bristles_after(method: Method, system: System, step: Step, y: Variables) -> Bristles:
    """The deflections of bristles if the step is accepted."""
    after, motions = system.contact_gaps(y.motion), system.motions(y.motion)
    lands = method.landing is not None
    return updated_bristles(system.scene, y.bristles, motions, step.contact_gaps, after, lands)


def _tangents_after(
    family: SystemFamily,
    step: Step,
    trial: Trial,
    y_tangents: Variables,
    second_rates: SecondRates,
) -> Tangents:
    """The tangents if the step is accepted; `y_tangents` are those of the variables at its end.

    Those of the entry speed hold up to terms of the size of the depth landed at, since the second
    rates are taken as constants.
    """
    end, start = trial.tangents, step.tangents
    assert end is not None and start is not None

    def memory_after(
        system: System, y1: Variables, entry_speeds: EntrySpeeds
    ) -> tuple[EntrySpeeds, None]:
        after = system.contact_gaps(y1.motion)
        return updated_entry_speeds(
            system.scene, entry_speeds, step.contact_gaps, after, second_rates
        ), None

    _, _, memory_tangents = family.pushed(
        memory_after, (trial.outcome.y, step.entry_speeds), (end.y, start.entry_speeds)
    )
    return Tangents(y_tangents, memory_tangents, end.solver_state)


def _entry_speeds_after(
    method: Method,
    system: System,
    step: Step,
    y1: Variables,
    after: ContactGaps,
    t1: Scalar,
    keep: Condition,
    second_rates: SecondRates,
) -> EntrySpeeds:
    """The memory if the step is accepted."""
    if not uses_entry_speed(system.scene):
        return step.entry_speeds
    if not isinstance(method.solver, UnrolledExplicit):
        second_rates = jax.lax.cond(
            keep & begins(step.contact_gaps, after),
            lambda: _end_second_rates(method, system, step, y1, t1),
            lambda: second_rates,
        )
    return updated_entry_speeds(
        system.scene, step.entry_speeds, step.contact_gaps, after, second_rates
    )


def _second_rates(
    method: Method,
    system: System,
    y: Variables,
    solver_state: SolverState,
    contact_gaps: ContactGaps,
) -> SecondRates:
    """Second derivatives of the gaps where the solver has the rates of the variables; else zero."""
    if contact_gaps and isinstance(method.solver, UnrolledExplicit):
        return system.second_rates(y.motion, solver_state.motion)
    return jax.tree.map(
        lambda gap: jnp.zeros_like(gap.rate),
        contact_gaps,
        is_leaf=lambda node: isinstance(node, ContactGap),
    )


def _end_second_rates(
    method: Method, system: System, step: Step, y1: Variables, t1: Scalar
) -> SecondRates:
    """Second derivatives of the gaps at the end of a step."""
    rates = term_of(method).vf(t1, y1, (system, step.entry_speeds))
    return system.second_rates(y1.motion, rates.motion)


def blank_attempt(
    method: Method,
    system: System,
    step: Step,
    t_end: Scalar,
    family: SystemFamily | None = None,
    attempt: Callable[..., Attempt] = attempt,
) -> Attempt:
    """A step before the first attempt, in the form of what `attempt` gives."""
    shapes = jax.eval_shape(lambda: attempt(method, system, step, t_end, family))
    zeros = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes)
    return replace(zeros, step=step)


def running(step: Step, t_end: Scalar, attempts: Scalar) -> Condition:
    """Whether to try another step before `t_end` and within the number of attempts."""
    return (step.t < t_end) & (step.result == RESULTS.successful) & (step.attempts < attempts)
