"""Derivatives of integrals of quantities that jump at the event at which a step ends.

If a quantity jumps at an event, the derivative of its integral contains minus the jump times the
derivative of the event's time. As in `.saltation`, the step ends at a time that is not
differentiated, and the time tau from the event to this end is zero except for rounding, but has
derivatives, minus those of the event's time. So the jump times the derivative of tau is added.
"""

from collections.abc import Mapping
from dataclasses import replace

import jax
import jax.numpy as jnp

from ..._dynamics.breakpoints import breakpoints, one_sided_time, since_breakpoints
from ..._dynamics.contact_events import any_of, gap_pairs
from ..._dynamics.contact_forces import EntrySpeeds
from ..._dynamics.system import System
from ..._math.vectors import Condition, Scalar
from .saltation import time_since_event
from .step_state import Variables
from .trial_step import Trial

EARLIER = 1e-8
"""Part of a step by which an integrand is evaluated before the event: more than the rounding errors
of penetrations, and so little that a continuous integrand does not change noticeably."""


def with_integrand_jumps(
    trial: Trial, y: Variables, entry_speeds: EntrySpeeds, tangents: Variables, keep: Condition
) -> Variables:
    """Return the `tangents` of the variables `y`, corrected for integrands that jump at the end of
    an accepted step (`keep`). `y` and `entry_speeds` are those after all other corrections. If
    several events coincide, the mean of their times is taken."""
    system, family, step = trial.system, trial.family, trial.step
    has_events = system.scene.contact_joints() or breakpoints(system.scene)
    if family is None or not system.formulation.integrands or not has_events:
        return tangents
    assert trial.tangents is not None

    def since(system: System, y: Variables) -> tuple[Scalar, Condition]:
        return _since_events(trial, system, y)

    # `lands`: whether the step ends at an event; `time`, since this event, has derivatives.
    ends = (trial.outcome.y,), (trial.tangents.y,)
    time, lands, time_along = family.with_auxiliary(since, *ends)

    def jumps() -> dict[str, Scalar]:
        # The motion is moved back to before the event, by the rates at the end of the step, for the
        # time `back`, s: it exceeds the time since the event, also if that is zero.
        back = 2.0 * jnp.abs(time) + EARLIER * (trial.t1 - step.t)
        before, rates = trial.outcome.y, trial.outcome.solver_state.motion
        motion = jax.tree.map(lambda value, rate: value - back * rate, before.motion, rates)
        before = replace(before, motion=motion)
        # The changes of memories are in the correction at the instants of sampled forces.
        after = replace(y, memory=before.memory)
        # At a breakpoint, a `side` earlier than `t` gives the values before it, else those after.
        values_before = _integrands(system, before, step.entry_speeds, side=step.t, t=trial.t1)
        values_after = _integrands(system, after, entry_speeds, side=trial.t1, t=trial.t1)
        return {name: value - values_before[name] for name, value in values_after.items()}

    def none() -> dict[str, Scalar]:
        return dict.fromkeys(system.formulation.integrands, jnp.zeros(()))

    changes = jax.lax.cond(keep & lands, jumps, none)
    work = {name: tangents.work[name] + change * time_along for name, change in changes.items()}
    return replace(tangents, work={**tangents.work, **work})


def _since_events(trial: Trial, system: System, y: Variables) -> tuple[Scalar, Condition]:
    """Return the time, s, from the event at which the step ends to this end, the mean for several
    events, zero for none; and whether there is an event. `y`: variables at the end of the step."""
    step, after = trial.step, system.contact_gaps(y.motion)
    events = list(since_breakpoints(system, step.t, trial.t1).values())
    events += [time_since_event(before, gap) for before, gap in gap_pairs(step.contact_gaps, after)]
    count = sum(jnp.asarray(lands, float) for lands, _ in events)
    total = sum(time for _, time in events)
    return total / jnp.maximum(count, 1.0), any_of(lands for lands, _ in events)


def _integrands(
    system: System, y: Variables, entry_speeds: EntrySpeeds, side: Scalar, t: Scalar
) -> Mapping[str, Scalar]:
    # At a breakpoint, the values before it if `side` is earlier than t, and else those after it.
    at = system, one_sided_time(system, side, t), y.motion, entry_speeds, y.bristles, y.memory
    return {
        name: jnp.asarray(integrand(*at), float)
        for name, integrand in system.formulation.integrands.items()
    }
