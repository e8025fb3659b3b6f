"""Decide whether a trial step is accepted, how long the next one is, and whether the run failed."""

from typing import Any, NamedTuple, TypeAlias

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Bool, PyTree

from ..._dynamics.breakpoints import drivers_are_smooth, has_breakpoints, one_sided_time
from ..._dynamics.contact_events import changes, time_since_onset, too_deep
from ..._fields.types import Single
from ..._math.stacked import stacked, unstacked
from ..._math.vectors import Condition, Scalar
from ..._result_codes import RESULTS
from . import step_length
from .discontinuities import changes_side, has_undeclared_jump, may_have_undeclared_jump
from .rotation_limit import LARGEST, TARGET, rotation_in
from .settings import DEFAULT_RTOL
from .step_state import ControllerState, Proposal, Rejection, choose
from .trial_step import Trial, error_order, may_jump, slopes_may_jump

Flag: TypeAlias = Bool[Any, ""]
"""A truth value, (), annotated as in diffrax."""
DRIVER_TOLERANCE = 3.0
"""Tolerance of `drivers_are_smooth`, as a multiple of the relative tolerance of the step-size
controller. The multiple leaves room for the error of the quadrature in that function."""
SHORTER = 0.2
"""Length of a repeated trial over the length of the rejected one, if a driver was not smooth. If a
body rotated too far, lower bound of this ratio, which diffrax's PID controller has too."""


class _Decision(NamedTuple):
    """The decision about a trial step so far.

    - `keep`: whether the trial is accepted.
    - `t_next`: end of the next trial, s.
    - `made_jump`: whether the rates may jump at the start of the next trial.
    - `controller_state`, `controller_result`: new state and result of the step-size controller.
    - `rejected`: whether the trial is rejected, by reason (`Rejection`); at most one is true.
    """

    keep: Flag
    t_next: Single
    made_jump: Flag
    controller_state: ControllerState
    controller_result: diffrax.RESULTS
    rejected: dict[str, Condition]

    def repeated(
        self, reason: Rejection, repeats: Condition, t_next: Scalar, last: Proposal
    ) -> "_Decision":
        """Return the decision to repeat the trial, for a `reason`, up to `t_next`, s, if `repeats`
        is true; otherwise this decision. `repeats` may be true only if `keep` is. `last`: the
        `Proposal` that led to the trial."""
        return self._replace(
            keep=self.keep & ~repeats,
            t_next=jnp.where(repeats, t_next, self.t_next),
            # The controller took the trial for accepted. Its state before the trial is restored, or
            # its history of errors would contain a step that was never made.
            controller_state=choose(repeats, last.controller_state, self.controller_state),
            rejected={**self.rejected, reason: repeats},
        )


def decide_step(
    trial: Trial, t_end: Scalar
) -> tuple[Condition, Proposal, RESULTS, dict[str, Condition]]:
    """Decide whether a trial step is accepted, in a run that ends at `t_end`, s. Return also the
    step to try next, the run's result code, and by `Rejection` whether it rejects the trial.

    The step-size controller decides first. A trial that the controller accepts is still rejected if
    a driver is not smooth over the step, if a body rotates too far in it, or if it passes a contact
    event at which it must end. Such a trial is repeated with a shorter step, or up to the event."""
    method, scene = trial.method, trial.system.scene
    step, t1, after = trial.step, trial.t1, trial.gaps
    last = step.proposal
    decision = _with_smooth_drivers(_controller_decision(trial), trial)
    if method.rotating:
        decision = _with_limited_rotation(decision, trial)
    # The next step begins where this one ends, or where it began if it is rejected. `full_length`
    # is the length that it would have if no event cut it short. The controller proposes it as if
    # the next step had the same time map as this one (see `.time_map`). Where the maps differ,
    # `next_length` corrects the proposal.
    full_length = decision.t_next - jnp.where(decision.keep, t1, step.t)
    if trial.time_map is not None:
        full_length = trial.time_map.next_length(full_length, decision.keep)
    begins_contact, entry_length = last.begins_contact, last.entry_length
    if method.landing is not None and after:
        # A trial that passes a contact event is repeated up to it: its set of closed contacts was
        # wrong.
        passes, landing_time = method.landing.retry(step.contact_gaps, after, step.t, t1)
        lands = decision.keep & passes
        # The controller, which took the trial for accepted, gets back its state in `last`.
        decision = decision.repeated(Rejection.CONTACT, lands, landing_time, last)
        full_length, begins_contact, entry_length = step_length.lengths_after_contacts(
            step, after, t1, decision.keep, lands, full_length
        )
        following = jnp.where(decision.keep, t1, step.t) + full_length
        decision = decision._replace(t_next=jnp.where(lands, landing_time, following))
    elif has_breakpoints(scene) or method.rotating:
        # Without landing at contact events, only breakpoints and rotations can have cut it short.
        full_length = step_length.length_after_breakpoints(step, t1, decision.keep, full_length)
        start = jnp.where(decision.keep, t1, step.t)
        decision = decision._replace(t_next=start + full_length)
    keep = decision.keep
    result = _result(trial, decision, t_end)
    if trial.tangents is not None:
        # Across an undeclared jump the states stay correct, but the derivatives do not.
        if may_have_undeclared_jump(scene):
            jumps = keep & has_undeclared_jump(trial)
            result = RESULTS.where(jumps, RESULTS.force_jumped, result)
        # Likewise if a force is reversed at once, as a torsional spring's torque at half a turn.
        jumps = changes_side(trial)
        if jumps is not None:
            result = RESULTS.where(keep & jumps, RESULTS.force_jumped, result)
    # Time since the latest onset, which runs with tangents need for the next step's time map.
    since = last.time_since_onset
    if since is not None:
        latest = jnp.minimum(since + (t1 - step.t), time_since_onset(step.contact_gaps, after))
        since = jnp.where(keep, latest, since)
    proposal = Proposal(
        t_next=decision.t_next,
        full_length=full_length,
        begins_contact=begins_contact,
        time_since_onset=since,
        entry_length=entry_length,
        made_jump=_made_jump(decision, trial),
        controller_state=decision.controller_state,
    )
    return keep, proposal, result, decision.rejected


def _with_smooth_drivers(decision: _Decision, trial: Trial) -> _Decision:
    """Return the `decision`, changed so that a trial over which a driver is not smooth is repeated.
    Towards an undeclared kink or jump, steps become ever shorter, until `_result` stops the run."""
    step = trial.step
    rtol = DRIVER_TOLERANCE * _relative_tolerance(trial.method.controller)
    smooth = drivers_are_smooth(trial.system, trial.outcome.y.motion, step.t, trial.t1, rtol)
    if smooth is None:
        return decision
    repeats: Condition = decision.keep & ~smooth
    shorter = step.t + SHORTER * (trial.t1 - step.t)
    return decision.repeated(Rejection.DRIVER, repeats, shorter, step.proposal)


def _with_limited_rotation(decision: _Decision, trial: Trial) -> _Decision:
    """Return the `decision`, changed so that a trial in which a body rotates by more than `LARGEST`
    is repeated. Its length was chosen for the rotation rates at the start, which may have grown."""
    step, rotation = trial.step, rotation_in(trial)
    repeats = decision.keep & (rotation > LARGEST)
    shorter = step.t + jnp.clip(TARGET / rotation, SHORTER, 1.0) * (trial.t1 - step.t)
    shorter = jax.lax.stop_gradient(shorter)
    return decision.repeated(Rejection.ROTATION, repeats, shorter, step.proposal)


def _made_jump(decision: _Decision, trial: Trial) -> Condition:
    """Return whether the next step must compute the rates at its start anew."""
    step, method, scene = trial.step, trial.method, trial.system.scene
    jumps = may_jump(method, scene)
    if slopes_may_jump(method, scene):
        # Rates are continuous here. But where a contact begins or ends, their derivatives jump, so
        # that the tangents of the rates cannot be reused.
        jumps = changes(step.contact_gaps, trial.gaps)
    # After a rejection the start of the step is the same, so the flag stays.
    return jnp.where(decision.keep, decision.made_jump | jumps, step.proposal.made_jump)


def _relative_tolerance(controller: diffrax.AbstractStepSizeController) -> Scalar:
    # A controller such as `diffrax.ClipStepSizeController` contains the one with the tolerances.
    inner = getattr(controller, "controller", None)
    if inner is not None:
        return _relative_tolerance(inner)
    return getattr(controller, "rtol", DEFAULT_RTOL)


def _controller_decision(trial: Trial) -> _Decision:
    """Return the decision of diffrax's step-size controller about a trial step. The controller gets
    the errors of variables and tangents together. Since it has one tolerance for both, errors of
    tangents are first divided by `method.derivative_tolerance`."""
    method, system, step = trial.method, trial.system, trial.step
    has_bristles = bool(system.scene.bristle_laws())

    # Deflections of bristles are micrometres: they and their errors are divided by the deflection
    # at full friction, so that the same tolerance suits them.
    def scaled(y: PyTree) -> PyTree:
        return step_length.with_relative_bristles(unstacked(y), system.scene) if has_bristles else y

    # `before` and `after` are magnitudes of the variables at both ends of the step. In a run with
    # tangents, these and `error` are pairs, whose second part is for the tangents.
    before, after = (step_length.magnitudes(scaled(y)) for y in (step.y, trial.outcome.y))
    error = scaled(trial.outcome.error)
    if trial.tangents is not None:
        assert step.tangents is not None and method.derivative_tolerance is not None
        tolerance = method.derivative_tolerance
        tangents = step.tangents.y, trial.tangents.y
        along_before, along_after = (step_length.magnitudes(scaled(y)) for y in tangents)
        before = stacked(before), stacked(step_length.tangent_sizes(system, before, along_before))
        after = stacked(after), stacked(step_length.tangent_sizes(system, after, along_after))
        along = jax.tree.map(lambda e: e / tolerance, scaled(trial.tangents.error))
        error = stacked(error), stacked(along)
    else:
        before, after, error = map(stacked, (before, after, error))
    # `wrap(1)` tells diffrax's controller that time runs forward. The second result of
    # `adapt_step_size`, the start of the next step, is not used: each step begins where the last
    # accepted one has ended.
    controller, last_state = method.controller.wrap(1), step.proposal.controller_state
    args, order = (system, step.entry_speeds), error_order(method)
    keep, _, t_next, made_jump, state, result = controller.adapt_step_size(
        step.t, trial.t1, before, after, args, error, order, last_state
    )
    too_long = jnp.logical_not(keep)  # of a controller with fixed steps, `keep` is a Python number
    reasons: dict[str, Condition] = {
        Rejection.ERROR: too_long & trial.finite,
        Rejection.NOT_FINITE: too_long & ~trial.finite,
    }
    return _Decision(keep, t_next, made_jump, state, result, reasons)


def _result(trial: Trial, decision: _Decision, t_end: Scalar) -> RESULTS:
    """Return the result code of the run after a trial step, in a run that ends at `t_end`, s. If
    several checks fail, the last of these decides: the step is too small, a journal is too deep in
    the wall, a driver or ideal joint is not followed, a variable is not finite, the solver or the
    controller failed. If no check fails, the code before stays."""
    system, step = trial.system, trial.step
    keep, t_next = decision.keep, decision.t_next
    now = jnp.where(keep, trial.t1, step.t)
    eps = jnp.finfo(now.dtype).eps
    # A step shorter than the spacing of the numbers at its start makes no progress. At t = 0 that
    # spacing is zero; there the time that remains sets the scale.
    resolution = 2.0 * eps * jnp.maximum(jnp.abs(now), eps * (t_end - now))
    stuck = (t_next - now <= resolution) & (now < t_end)
    success = diffrax.RESULTS.successful
    gave_up = (keep & (trial.solver_result != success)) | (decision.controller_result != success)
    result = RESULTS.where(stuck, RESULTS.step_too_small, step.result)
    if trial.gaps:
        deep = keep & too_deep(system.scene, trial.gaps)
        result = RESULTS.where(deep, RESULTS.left_bearing, result)
    refused = decision.rejected.get(Rejection.DRIVER)
    if refused is not None:
        # If steps shrink to nothing because of a driver, it has a kink or jump there. The cause is
        # not a stiff force.
        result = RESULTS.where(stuck & refused, RESULTS.not_followed, result)
    # At a breakpoint at the end of the step, constraints have the values just before it.
    time = one_sided_time(system, step.t, trial.t1)
    violated = system.constraints_violated(trial.outcome.y.motion, time)
    if violated is not None:
        result = RESULTS.where(keep & violated, RESULTS.not_followed, result)
    # Controllers that adapt the step reject such a trial; only one with fixed steps accepts it.
    result = RESULTS.where(keep & ~trial.finite, RESULTS.non_finite, result)
    return RESULTS.where(gave_up, RESULTS.solver_failed, result)
