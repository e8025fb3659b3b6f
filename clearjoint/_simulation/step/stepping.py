"""Body of a run's main loop: try one step, accept or reject it, carry the state to the next one.

diffrax supplies the solver's `step` and the controller's `adapt_step_size`, which are called one
step at a time, because in `diffeqsolve` the treatment of contact events would need hidden state.
The body is scalar arithmetic without callbacks, custom calls or scatters, so that it compiles to
one native function. Times count from the `origin` of a `System`.
"""

import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TypeAlias, TypeVar

import diffrax
import jax
import jax.numpy as jnp

from ..._compilation.xla import traced_once
from ..._dynamics.breakpoints import breakpoints, has_breakpoints, one_sided_time
from ..._dynamics.bristles import initial_bristles, updated_bristles
from ..._dynamics.contact_events import (
    ContactGaps,
    begins,
    begins_at_start,
    initial_entry_speeds,
    updated_entry_speeds,
    uses_entry_speed,
)
from ..._dynamics.contact_forces import EntrySpeeds
from ..._dynamics.energy import bristle_energy
from ..._dynamics.sampled_forces import initial_memories
from ..._dynamics.system import System
from ..._math.vectors import Condition, Scalar
from ..._model.joints.base import ByLabel, each_label
from ..._result_codes import RESULTS
from .acceptance import decide_step
from .breakpoint_events import across_breakpoints
from .integrand_jumps import with_integrand_jumps
from .method import SystemFamily
from .saltation import across_contacts, any_changes, contacts_jump, slopes_jump
from .solvers import UnrolledExplicit
from .step_length import end_of_step
from .step_state import (
    Attempt,
    Method,
    Proposal,
    Rejected,
    SolverState,
    Step,
    Tangents,
    TangentsInside,
    Variables,
    choose,
)
from .trial_step import Arguments, Trial, error_order, term_of, try_step

Shapes = TypeVar("Shapes")

MANY_OPERATIONS = 50_000
"""Number of operations in the equations of motion above which `shapes_of` warns of slow compiling.

Chains of 12, 24 and 48 ideal revolute joints have 2800, 11 000 and 55 000 operations. To compile
them took 2, 5 and 23 s as native code; with XLA, 53 s, 264 s, and more than 8 GB of memory.
"""


def start(
    method: Method,
    term: diffrax.ODETerm,
    system: System,
    t0: Scalar,
    t_end: Scalar,
    first_step: Scalar | None,
    y: Variables,
    entry_speeds: EntrySpeeds,
    derivatives: bool = False,
) -> Step:
    """Return the `Step` from which a run begins, the complete state before the first step.

    **Arguments:**

    - `term`: the equations from `term_of`; JAX traces them once, also if the term is used again.
    - `t0`, `t_end`: s, start and end of the run.
    - `first_step`: length of the first step, s; with ``None`` the controller chooses it.
    - `y`: the motion and, to continue an earlier run, integrals of the energy ledger, bristle
      deflections and memories; missing ones are initialised.
    - `entry_speeds`: m/s; missing ones are derived from the contacts at `t0`, and those that no law
      uses are left out.
    - `derivatives`: whether the caller will add tangents to the step.
    """
    contact_gaps = system.contact_gaps(y.motion)
    entry_speeds = initial_entry_speeds(system.scene, contact_gaps, entry_speeds)
    memory = initial_memories(system, y.motion, t0, y.memory)
    y = replace(y, bristles=initial_bristles(system.scene, y.bristles), memory=memory)
    args = system, entry_speeds
    y = replace(y, work=_initial_ledger(term, args, t0, y, derivatives))
    # `wrap(1)` tells diffrax's controller that time runs forward.
    controller, func, order = method.controller.wrap(1), method.solver.func, error_order(method)
    t_next, controller_state = controller.init(term, t0, t_end, y, first_step, args, func, order)
    t_next = jnp.asarray(t_next, dtype=float)
    solver_state = method.solver.init(term, t0, t_next, y, args)
    zero, begins_contact = jnp.zeros((), dtype=int), begins_at_start(contact_gaps)
    # A contact that touches the wall at the start begins now. The onset of a contact that is deeper
    # is unknown, and counts as long past.
    since_onset = jnp.where(begins_contact, 0.0, jnp.inf)
    # `entry_length` limits the first step after an onset to twice its value. No step has begun with
    # an onset yet, so the length of the run's first step is taken. If that is too short,
    # `entry_length` grows up to twofold with each onset.
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
            begins_contact=begins_contact,
            time_since_onset=since_onset if derivatives else None,
            entry_length=t_next - t0,
            made_jump=False,
            controller_state=controller_state,
        ),
        result=RESULTS.successful,
        attempts=zero,
        accepted=zero,
    )
    # Every leaf becomes an array, because a loop returns arrays and needs the same types as input.
    return jax.tree.map(jnp.asarray, step)


def _initial_ledger(
    term: diffrax.ODETerm, args: Arguments, t: Scalar, y: Variables, derivatives: bool
) -> dict[str, Scalar]:
    """Return the integrals of the energy ledger at the start of a run, J, by name; empty without a
    ledger. Integrals that `y.work` has are kept. `derivatives`: whether steps carry tangents."""
    # Only the names of the powers are needed: the equations are traced and not computed. Without a
    # ledger, the solver uses the same trace.
    system, entry_speeds = args
    powers = shapes_of(lambda: term.vector_field(t, replace(y, work={}), args), derivatives).work
    work = {name: y.work.get(name, jnp.zeros_like(t)) for name in powers}
    # "friction" starts at the energy stored in the bristles, because the ledger counts under it all
    # energy that friction takes from the motion, also the part that bristles will return.
    if y.bristles and "friction" in powers.keys() - y.work.keys():
        forces = system.contact_forces(y.motion, entry_speeds, y.bristles)
        stored = bristle_energy(system.scene, system.motions(y.motion), forces, y.bristles)
        # With bristles, `stored` is never ``None``; the condition is for the type checker.
        work["friction"] = work["friction"] if stored is None else jnp.asarray(stored)
    return work


def shapes_of(equations: Callable[[], Shapes], derivatives: bool) -> Shapes:
    """Return the shapes of the results of the `equations` of motion, as `jax.eval_shape` does, and
    warn if they have so many operations that compiling takes long. This function runs once for each
    compiled program. `derivatives`: whether steps carry tangents."""
    program, shapes = jax.make_jaxpr(equations, return_shape=True)()
    # The equations are a function that JAX traces once (see `term_of`): the program is a call of
    # this function, and the operations are in the program that is called.
    calls = [equation.params.get("jaxpr") for equation in program.jaxpr.eqns]
    count = len(calls) + sum(len(call.jaxpr.eqns) for call in calls if call is not None)
    # A step with derivatives has about three times as many operations as a step without.
    operations = count * (3 if derivatives else 1)
    if operations > MANY_OPERATIONS:
        warnings.warn(
            f"A step of this scene has some {operations} operations for each stage of the solver: "
            f"above {MANY_OPERATIONS}, compiling takes half a minute or more, and in jax.jit, vmap "
            "and grad, where XLA compiles, minutes and more than 8 GB of memory. Long chains of "
            "ideal joints take fewer operations in AbsoluteCoordinates(), short closed loops in "
            "JointCoordinates(); diffrax.Bosh3() has half the stages.",
            stacklevel=2,
        )
    return shapes


def attempt(
    method: Method, system: System, step: Step, t_end: Scalar, family: SystemFamily | None = None
) -> Attempt:
    """Try one step, and either accept it or propose a shorter one.

    **Arguments:** `step`: the state before the attempt; `t_end`: end of the run, beyond which no
    step goes; `family`: the system as a function of the parameters, if the step carries tangents.

    **Returns:** an `Attempt`, whose `step` is the next state if the trial was accepted; otherwise
    the given state with a new proposal, result code and number of attempts.
    """
    trial = try_step(method, system, step, end_of_step(method, system, step, t_end), family)
    keep, proposal, result, reasons = decide_step(trial, t_end)
    accepted = accepted_state(trial, keep)
    inside = None
    if step.tangents is not None and trial.tangents is not None:
        inside = TangentsInside(step.tangents.entry_speeds, trial.tangents.information)
    # Both outcomes are computed and one is selected leaf by leaf: lanes of a batch accept and
    # reject independently, and an accepted step of one lane must not depend on another lane.
    chosen, attempts = choose(keep, accepted, step), step.attempts + 1
    following = replace(chosen, proposal=proposal, result=result, attempts=attempts)
    return Attempt(
        step=following,
        accepted=keep,
        t_start=step.t,
        entry_speeds_start=step.entry_speeds,
        information=trial.outcome.information,
        time_map=trial.time_map,
        tangents=inside,
        rejected=Rejected(trial.t1, reasons),
    )


def accepted_state(trial: Trial, keep: Condition) -> Step:
    """Return the state after a trial step, with the `proposal`, `result` and `attempts` of the
    state before. If `keep` is false, the trial is rejected, the caller doesn't use the result, and
    single runs skip parts of its computation."""
    method, system, family = trial.method, trial.system, trial.family
    step, gaps = trial.step, trial.gaps
    y1, solver_state = trial.outcome.y, trial.outcome.solver_state
    # Second time derivatives of penetrations; zero if the solver's state does not have the rates.
    second_rates = _second_rates(method, system, y1, solver_state, gaps)
    # Those of a rejected trial may not be finite.
    second_rates = choose(keep, second_rates, step.second_rates)
    before, entry_speeds, tangents = step.contact_gaps, step.entry_speeds, None
    if uses_entry_speed(system.scene):
        at_onsets = second_rates
        if not isinstance(method.solver, UnrolledExplicit):
            # The solver's state does not contain the rates at the end of the step. One more
            # evaluation is spent only where a contact begins, as nothing else uses them.
            def end_second_rates() -> ByLabel[Scalar]:
                args = system, step.entry_speeds
                rates = term_of(method).vf(trial.t1, trial.outcome.y, args)
                return system.second_rates(trial.outcome.y.motion, rates.motion)

            begun = keep & begins(before, gaps)
            at_onsets = jax.lax.cond(begun, end_second_rates, lambda: second_rates)
        entry_speeds = updated_entry_speeds(system.scene, entry_speeds, before, gaps, at_onsets)
    y1, y_tangents = _across_discontinuities(trial, keep)
    if any(name in system.scene.joints for name in breakpoints(system.scene)):
        # A driver with a kink makes velocities jump, and with them the rates of the gaps.
        gaps = system.contact_gaps(y1.motion)
    if family is not None:
        at_end, at_start = trial.tangents, step.tangents
        assert at_end is not None and at_start is not None and y_tangents is not None

        # Variables may include integrals over time for outputs, whose integrands may jump too.
        y_tangents = with_integrand_jumps(trial, y1, entry_speeds, y_tangents, keep)

        # Runs with tangents have explicit solvers, so that `second_rates` equals `at_onsets`. Its
        # derivatives are left out, which neglects terms proportional to the penetration at the end
        # of the step.
        def entry_speeds_after(
            system: System, y1: Variables, entry_speeds: EntrySpeeds
        ) -> EntrySpeeds:
            after = system.contact_gaps(y1.motion)
            return updated_entry_speeds(system.scene, entry_speeds, before, after, second_rates)

        # The derivatives are taken at the solver's result and not at the corrected one, because the
        # entry speeds were computed from the solver's result.
        at, along = (trial.outcome.y, step.entry_speeds), (at_end.y, at_start.entry_speeds)
        _, entry_speed_tangents = family.with_derivatives(entry_speeds_after, at, along)
        tangents = Tangents(y_tangents, entry_speed_tangents, at_end.solver_state)
    return replace(
        step,
        t=trial.t1,
        y=y1,
        entry_speeds=entry_speeds,
        contact_gaps=gaps,
        second_rates=second_rates,
        solver_state=solver_state,
        accepted=step.accepted + 1,
        tangents=tangents,
    )


Ends: TypeAlias = tuple[Variables, Variables | None]
"""Variables at the end of a step, and their tangents; ``None`` in a run without tangents."""


def _across_discontinuities(trial: Trial, keep: Condition) -> Ends:
    """Return variables and tangents at the end of a trial step, corrected for discontinuities of
    forces (see `.saltation`, `.breakpoint_events`); not used unless the step is accepted, `keep`.
    The corrections change the variables by rounding errors, or by the change of the rates times the
    short time by which a step ends past an onset, with two exceptions: velocities jump where the
    angle or distance that a driver prescribes has a kink, and bristle deflections become zero in
    open contacts. Tangents may change much."""
    system, family = trial.system, trial.family
    step, t1, y1 = trial.step, trial.t1, trial.outcome.y
    y_tangents = None if trial.tangents is None else trial.tangents.y
    # Corrections that the scene cannot need are left out of the program. If only the slope of a
    # force jumps, the correction concerns the tangents alone, so a run without tangents skips it.
    slopes = family is not None and slopes_jump(system.scene)
    lands = trial.method.landing is not None
    corrects_contacts = lands and (slopes or contacts_jump(system.scene))
    corrects_breakpoints = has_breakpoints(system.scene)
    if not corrects_contacts and not corrects_breakpoints and not y1.bristles:
        return y1, y_tangents

    def corrected(correction: Callable[..., Variables], at: Ends) -> Ends:
        y, along = at
        if family is None:
            return correction(system, y, step.entry_speeds), None
        assert step.tangents is not None
        tangents = along, step.tangents.entry_speeds
        return family.with_derivatives(correction, (y, step.entry_speeds), tangents)

    def contacts_corrected(system: System, y: Variables, entry_speeds: EntrySpeeds) -> Variables:
        # The forces are those before a breakpoint at the end; `across_breakpoints` needs those on
        # both sides.
        time = one_sided_time(system, step.t, t1)
        before = step.contact_gaps
        return across_contacts(system, before, y, entry_speeds, time, family is not None)

    # Bristles come last, because they depend on the corrected motion.
    def others_corrected(system: System, y: Variables, entry_speeds: EntrySpeeds) -> Variables:
        if corrects_breakpoints:
            differentiated = family is not None
            y = across_breakpoints(system, step.t, y, entry_speeds, t1, keep, differentiated)
        if y.bristles:
            before, after = step.contact_gaps, system.contact_gaps(y.motion)
            motions = system.motions(y.motion)
            bristles = updated_bristles(system.scene, y.bristles, motions, before, after, lands)
            y = replace(y, bristles=bristles)
        return y

    ends = y1, y_tangents
    if corrects_contacts:
        changes = keep & any_changes(system.scene, step.contact_gaps, trial.gaps)
        # `corrected` takes derivatives inside of the branch, because JAX needs longer to trace the
        # derivatives of a branch. To transpose a branch, JAX divides it twice into a linear part
        # and the rest, unless the branch is a call of a function, whose division JAX keeps. The
        # transpose computes this function again, instead of taking its intermediate results.
        is_transposed = family is not None and family.is_transposed
        correct = traced_once(partial(corrected, contacts_corrected), recomputes=is_transposed)
        ends = jax.lax.cond(changes, correct, lambda ends: ends, ends)
    if corrects_breakpoints or y1.bristles:
        ends = corrected(others_corrected, ends)
    return ends


def _second_rates(
    method: Method, system: System, y: Variables, solver_state: SolverState, gaps: ContactGaps
) -> ByLabel[Scalar]:
    """Return the second time derivatives of all penetrations, m/s^2, from the variables and their
    rates in `solver_state`; zero if the solver, unlike `UnrolledExplicit`, keeps no rates."""
    if gaps and isinstance(method.solver, UnrolledExplicit):
        return system.second_rates(y.motion, solver_state.motion)
    return each_label(lambda name, label: jnp.zeros_like(gaps[name][label].rate), gaps)


def running(step: Step, t_end: Scalar, attempts: Scalar) -> Condition:
    """Return whether a run goes on after `step`: it is before its end `t_end`, s, has not failed,
    and has made fewer than `attempts` trials."""
    return (step.t < t_end) & (step.result == RESULTS.successful) & (step.attempts < attempts)
