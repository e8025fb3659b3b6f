"""Whether a trial is accepted, how long the next step shall be, and whether the run has failed."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp

from ...dynamics.breakpoints import breakpoints, drivers_are_smooth, seen
from ...dynamics.contact_events import ContactGaps, changes, time_since_begin, too_deep
from ...dynamics.system import System
from ...fields.types import Single
from ...math.vectors import Condition, Scalar
from ...result_codes import RESULTS
from .discontinuity_monitor import has_undeclared_jump, may_have_undeclared_jump
from .step_length import (
    length_after_breakpoints,
    lengths_after_contacts,
    magnitudes,
    with_relative_bristles,
)
from .step_state import Method, Proposal, Step, Variables, choose
from .trial_step import Trial, error_order, may_jump, slopes_may_jump
from .types import Flag

DRIVER_TOLERANCE = 3.0
"""Relative tolerances of a step by which a driver's changes may differ from its rates'."""
FIXED_STEPS_RTOL = 1e-6
"""The relative tolerance for drivers in runs of fixed steps."""
SHORTER = 0.2
"""Length of the next trial after a step over which a driver is not smooth, on that step's."""


class StepDecision(eqx.Module):
    """Whether to keep a trial, which step to try next, and the result of the run so far."""

    keep: Condition
    proposal: Proposal
    result: RESULTS


class _ControllerDecision(eqx.Module):
    """What the step-size controller says of a trial: its own outputs, by diffrax's names."""

    keep: Flag
    t_next: Single
    made_jump: Flag
    controller_state: object
    result: diffrax.RESULTS


def decide_step(
    method: Method, system: System, step: Step, trial: Trial, after: ContactGaps, t_end: Scalar
) -> StepDecision:
    """What becomes of a trial that ends with the contacts `after`.

    The step-size controller decides, unless the trial passes an event on which it must land: then
    it is rejected, and tried again up to there.
    """
    t1, last = trial.t1, step.proposal
    decision = _controller_decision(method, system, step, trial)
    keep, t_next = decision.keep, decision.t_next
    controller_state = decision.controller_state
    rtol = DRIVER_TOLERANCE * getattr(method.controller, "rtol", FIXED_STEPS_RTOL)
    smooth = drivers_are_smooth(system, trial.outcome.y.motion, step.t, t1, rtol)
    refused: Condition | None = None
    if smooth is not None:
        # A kink that no breakpoint declares is approached in shorter and shorter steps.
        refused = keep & ~smooth
        keep = keep & smooth
        t_next = jnp.where(refused, step.t + SHORTER * (t1 - step.t), t_next)
        controller_state = choose(refused, last.controller_state, controller_state)
    full_length = t_next - jnp.where(keep, t1, step.t)
    if trial.time_map is not None:
        full_length = trial.time_map.next_length(full_length, keep)
    begins_contact, entry_length = last.begins_contact, last.entry_length
    if method.landing is not None and after:
        passes, landing_time = method.landing.retry(step.contact_gaps, after, step.t, t1)
        lands = keep & passes
        controller_state = choose(lands, last.controller_state, controller_state)
        keep = keep & jnp.logical_not(passes)
        full_length, begins_contact, entry_length = lengths_after_contacts(
            step, after, t1, keep, lands, full_length
        )
        t_next = jnp.where(lands, landing_time, jnp.where(keep, t1, step.t) + full_length)
    elif breakpoints(system.scene):
        full_length = length_after_breakpoints(step, t1, keep, full_length)
        t_next = jnp.where(keep, t1, step.t) + full_length
    jumps = may_jump(method, system.scene)
    if slopes_may_jump(method, system.scene):
        jumps = changes(step.contact_gaps, after)
    made_jump = jnp.where(keep, decision.made_jump | jumps, last.made_jump)
    result = _result(system, step, trial, keep, refused, t_next, decision.result, after, t_end)
    if trial.tangents is not None and may_have_undeclared_jump(system.scene):
        jumps = keep & has_undeclared_jump(method, system, step, trial, after)
        result = RESULTS.where(jumps, RESULTS.force_jumped, result)
    proposal = Proposal(
        t_next=t_next,
        full_length=full_length,
        begins_contact=begins_contact,
        since_begin=_since_begin(step, after, t1, keep),
        entry_length=entry_length,
        made_jump=made_jump,
        controller_state=controller_state,
    )
    return StepDecision(keep, proposal, result)


def _since_begin(step: Step, after: ContactGaps, t1: Scalar, keep: Condition) -> Scalar | None:
    """`since_begin` of the next proposal, after a trial that ends with the contacts `after`."""
    since = step.proposal.since_begin
    if since is None:
        return None
    latest = jnp.minimum(since + (t1 - step.t), time_since_begin(step.contact_gaps, after))
    return jnp.where(keep, latest, since)


def _controller_decision(
    method: Method, system: System, step: Step, trial: Trial
) -> _ControllerDecision:
    def judged(y: Variables) -> Variables:
        return with_relative_bristles(y, system.scene)

    before, after = (magnitudes(judged(y)) for y in (step.y, trial.outcome.y))
    error = judged(trial.outcome.error)
    if trial.tangents is not None:
        assert step.tangents is not None and method.derivative_tolerance is not None
        tolerance = method.derivative_tolerance
        before = before, magnitudes(judged(step.tangents.y))
        after = after, magnitudes(judged(trial.tangents.y))
        error = error, jax.tree.map(lambda e: e / tolerance, judged(trial.tangents.error))
    keep, _, t_next, made_jump, state, result = method.controller.wrap(1).adapt_step_size(
        step.t,
        trial.t1,
        before,
        after,
        (system, step.entry_speeds),
        error,
        error_order(method),
        step.proposal.controller_state,
    )
    return _ControllerDecision(keep, t_next, made_jump, state, result)


def _result(
    system: System,
    step: Step,
    trial: Trial,
    keep: Condition,
    refused: Condition | None,
    t_next: Scalar,
    controller_result: diffrax.RESULTS,
    after: ContactGaps,
    t_end: Scalar,
) -> RESULTS:
    now = jnp.where(keep, trial.t1, step.t)
    eps = jnp.finfo(now.dtype).eps
    resolution = 2.0 * eps * jnp.maximum(jnp.abs(now), eps * (t_end - now))  # at t = 0 as well
    stuck = (t_next - now <= resolution) & (now < t_end)
    gave_up = (keep & (trial.solver_result != diffrax.RESULTS.successful)) | (
        controller_result != diffrax.RESULTS.successful
    )
    result = RESULTS.where(stuck, RESULTS.step_too_small, step.result)
    if after:
        result = RESULTS.where(keep & too_deep(system.scene, after), RESULTS.left_bearing, result)
    if refused is not None:
        result = RESULTS.where(stuck & refused, RESULTS.not_followed, result)
    time = seen(system, step.t, trial.t1)
    apart = system.is_apart(trial.outcome.y.motion, time)
    if apart is not None:
        result = RESULTS.where(keep & apart, RESULTS.not_followed, result)
    result = RESULTS.where(keep & ~trial.finite, RESULTS.non_finite, result)
    return RESULTS.where(gave_up, RESULTS.solver_failed, result)
