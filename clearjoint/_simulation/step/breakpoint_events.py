"""Corrections, for a step that ends at a breakpoint, of velocities that jump and of derivatives.

As in `.saltation`, the change of the rates at the breakpoint, times the time since the breakpoint,
is added to the variables. This time is zero except for rounding, but it has derivatives with
respect to the parameters on which the breakpoint depends.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial, reduce
from operator import or_
from typing import TypeAlias, TypeVar

import jax
import jax.numpy as jnp
from typing_extensions import override

from ..._dynamics import breakpoints
from ..._dynamics.contact_forces import EntrySpeeds
from ..._dynamics.kinds import Kinds
from ..._dynamics.sampled_forces import HeldForce, sampled_forces, updated_memory, with_forces
from ..._dynamics.system import System
from ..._math.vectors import Condition, Scalar
from ..._model.bodies import NO_WRENCH, Wrench
from ..._model.joints.base import AbstractForce, Motions
from .saltation import constant
from .step_state import Variables, choose
from .trial_step import rates_of

T = TypeVar("T")
Memories: TypeAlias = dict[str, dict[str, Scalar]]
"""`Variables.memory`: `memories[force][name]`."""


class SwitchedForce(AbstractForce):
    """A force whose wrenches and power are interpolated linearly, by `share`, 0 to 1, between their
    values at two times of the scene, s, `before` and `after`. If these two are just before and
    just after a breakpoint, the derivative of the motion's rates by `share` is their jump there."""

    force: AbstractForce
    before: Scalar
    after: Scalar
    share: Scalar

    @override
    def body_names(self) -> tuple[str, ...]:
        return self.force.body_names()

    @override
    def wrenches(self, motions: Motions, t: Scalar) -> dict[str, Wrench]:
        del t
        old, new = (self.force.wrenches(motions, at) for at in (self.before, self.after))
        return {
            name: self._between(old.get(name, NO_WRENCH), new.get(name, NO_WRENCH))
            for name in {**old, **new}
        }

    @override
    def supplied_power(self, motions: Motions, t: Scalar) -> Scalar:
        del t
        old, new = (self.force.supplied_power(motions, at) for at in (self.before, self.after))
        return self._between(old, new)

    def _between(self, old: T, new: T) -> T:
        return jax.tree.map(lambda a, b: a + self.share * (b - a), old, new)


def across_breakpoints(
    system: System,
    start: Scalar,
    y: Variables,
    entry_speeds: EntrySpeeds,
    t: Scalar,
    keep: Condition,
    differentiated: bool,
) -> Variables:
    """Return the variables at the end of a step from `start` to `t`, s, corrected if the step is
    accepted (`keep`) and ends at breakpoints.

    **Arguments:** `y`: variables at the end of the step; `entry_speeds`: entry speeds of contacts
    at its start, m/s; `differentiated`: whether the caller differentiates the result.
    """
    scene = system.scene
    since = breakpoints.since_breakpoints(system, start, t)
    # By name of the element: whether the step ends at one of its breakpoints, and the time since.
    joints = {name: since[name] for name in scene.joints if name in since}
    forces = {name: since[name] for name in scene.forces if name in since}
    # Times just before and just after the breakpoint, at which elements are evaluated: t as the end
    # of the step from `start`, and as the start of the next step.
    before = breakpoints.one_sided_time(system, start, t)
    after = breakpoints.one_sided_time(system, t, t)
    sampled = breakpoints.sampled_instants(system, start, t)

    def rates(shares: Mapping[str, Scalar], y: Variables, time: Scalar) -> Variables:
        return rates_of(_with_shares(system, before, after, shares), y, entry_speeds, time)

    # A force with the share 0 is as before its breakpoint, with 1 as after it: here all are before.
    no_shares = {name: jnp.zeros(()) for name in forces}

    def corrected(y: Variables) -> Variables:
        if joints:
            # `time` is that since the drivers' breakpoint; if several have one, their mean, since
            # they are assumed to change together. It is zero except for rounding, but has
            # derivatives. Without a driver's breakpoint, as in steps to a force's and in most steps
            # of lanes, the bound of 1 avoids a division by zero, and `time` is exactly zero.
            count = sum(jnp.asarray(lands, float) for lands, _ in joints.values())
            time = sum(passed for _, passed in joints.values()) / jnp.maximum(count, 1.0)
            # Move back to the breakpoint with the old rates, apply the jump of velocities there, at
            # `after - time`, and move forward with the new rates. Without a driver's breakpoint,
            # `_past_kink` only removes the drift of velocities from the constraints. Forces stay as
            # before the breakpoint (`no_shares`): their changes are added below.
            y = _moved_on(y, rates(no_shares, y, before), -time)
            y = _past_kink(_with_shares(system, before, after, no_shares), y, after - time)
            y = _moved_on(y, rates(no_shares, y, after), time)
        if forces:
            # The rates depend linearly on each force's share: 0 before its breakpoint, 1 after. So
            # the derivative of the rates, in the direction in which each share grows by the time
            # since the breakpoint, is the sum of the changes of the rates times these times.
            times = {name: time for name, (_, time) in forces.items()}
            y = _moved_on(y, jax.jvp(lambda s: rates(s, y, after), (no_shares,), (times,))[1], 1.0)
        if sampled:
            y = _past_samples(system, sampled, y, entry_speeds, before, t, after, differentiated)
        return y

    # Few steps land on a breakpoint; a single run computes the correction for these only.
    landings = [lands for lands, _ in since.values()]
    landings += [lands for instants in sampled.values() for lands, _ in instants.values()]
    lands = reduce(or_, landings, jnp.asarray(False))
    return jax.lax.cond(keep & lands, corrected, lambda y: y, y)


def _with_shares(
    system: System, before: Scalar, after: Scalar, shares: Mapping[str, Scalar]
) -> System:
    """Return the system with each force in `shares`, by name, as a `SwitchedForce` with this share,
    0 to 1, between its values at the times `before` and `after`, s since `System.origin`."""
    forces = {
        name: SwitchedForce(
            force, system.scene_time(before), system.scene_time(after), shares[name]
        )
        for name, force in system.scene.forces.items()
        if name in shares
    }
    # Integrands are continuous, so that their changes at a breakpoint are zero.
    return _without_integrands(with_forces(system, forces))


def _without_integrands(system: System) -> System:
    """Return the system with integrands of zero, because quantities to integrate do not recognise a
    `SwitchedForce` or `HeldForce` as the element that they name."""
    integrands = dict.fromkeys(system.formulation.integrands, _zero)
    return replace(system, formulation=replace(system.formulation, integrands=integrands))


def _zero(*arguments: object) -> Scalar:
    del arguments
    return 0.0


def _past_samples(
    system: System,
    sampled: breakpoints.SampledInstants,
    y: Variables,
    entry_speeds: EntrySpeeds,
    before: Scalar,
    t: Scalar,
    after: Scalar,
    differentiated: bool,
) -> Variables:
    """Return the variables `y` at the end t, s, of a step, with new memories of the forces that
    sample the motion at t. `sampled`: result of `sampled_instants`; `before`, `after`: times just
    before and just after t, s. If an instant depends on parameters, the sampled motion depends on
    them, and so does the time for which the changed forces have acted at t. The result has these
    derivatives if `differentiated`."""
    # System, variables and entry speeds without derivatives, for the rates. The times since the
    # instants are zero except for rounding, and so are their products with derivatives of rates.
    fixed, still, speeds = constant((system, y, entry_speeds))

    forces, motions = sampled_forces(system.scene), system.motions(y.motion)
    kinds = Kinds(system.scene)
    if differentiated:
        rates = rates_of(fixed, still, speeds, before).motion
        # `jax.jvp` demands floats, but components may be Python numbers.
        as_floats = partial(jax.tree.map, partial(jnp.asarray, dtype=float))
        motion_rates = jax.jvp(lambda y: as_floats(fixed.motions(y)), (still.motion,), (rates,))[1]
    # Each change at an instant: name of the force, memories of all forces before and after the
    # instant, and time from the instant to t.
    memories, changes = y.memory, []
    # `key`: name of the instant, such as "sample"; `lands`: whether the step ends there.
    for name, instants in sampled.items():
        for key, (lands, instant) in instants.items():
            since, motions_sampled = system.scene_time(t) - instant, motions
            if differentiated:
                motions_sampled = _moved_on(motions, motion_rates, -since)
            sample = forces[name], motions_sampled, key, memories[name], instant
            # If there are many forces of a kind, they share one trace of the function.
            updated = kinds.evaluate(updated_memory, *sample)
            earlier = memories
            memories = {**memories, name: choose(lands, updated, memories[name])}
            changes.append((name, earlier, memories, since))
    y = replace(y, memory=memories)
    if not differentiated:
        return y
    # Only the times keep their derivatives: products of a time and a derivative are left out.
    changes = [(*constant((name, old, new)), since) for name, old, new, since in changes]
    return _with_shifted_instants(y, changes, fixed, still, speeds, after)


def _with_shifted_instants(
    y: Variables,
    changes: Sequence[tuple[str, Memories, Memories, Scalar]],
    fixed: System,
    still: Variables,
    speeds: EntrySpeeds,
    after: Scalar,
) -> Variables:
    """Return `y` plus, for each change of a force's memory, the jump of the rates times the time
    since the change. This time is zero except for rounding: only its derivatives matter.

    **Arguments:** `changes`: for each change, the force's name, the memories of all forces before
    and after it, and the time since it, s; of these, only the times have derivatives. `fixed`,
    `still`, `speeds`: system, variables with the memories before all changes, and entry speeds,
    without derivatives. `after`: time just after the changes, s.
    """
    forces = sampled_forces(fixed.scene)

    # The rates depend linearly on the shares of the changes of forces, as in `across_breakpoints`.
    # Each force in `held` gets its own changes, with the share of each.
    def changed_rates(shares: Sequence[Scalar]) -> Variables:
        held = {
            name: HeldForce(
                forces[name],
                still.memory[name],
                tuple(
                    (old[name], new[name], share)
                    for (changed, old, new, _), share in zip(changes, shares, strict=True)
                    if changed == name
                ),
            )
            for name in dict.fromkeys(changed for changed, *_ in changes)
        }
        return rates_of(_without_integrands(with_forces(fixed, held)), still, speeds, after)

    times = [since for *_, since in changes]
    along = jax.jvp(changed_rates, ([jnp.zeros(())] * len(times),), (times,))[1]
    # Integrands were left out of `changed_rates`; they may depend on the memories, and change too.
    for name, integrand in fixed.formulation.integrands.items():
        value = partial(integrand, fixed, after, still.motion, speeds, still.bristles)
        along.work[name] = sum(since * (value(new) - value(old)) for _, old, new, since in changes)
    # The jumps in `along` are multiplied by the times already, hence the factor 1.
    return replace(_moved_on(y, along, 1.0), memory=y.memory)


def _moved_on(y: T, rates: T, time: Scalar) -> T:
    return jax.tree.map(lambda value, rate: value + time * rate, y, rates)


def _past_kink(system: System, y: Variables, t: Scalar) -> Variables:
    """Return the variables with velocities that satisfy the constraints at the time t, s, just
    after a kink in the angle or distance that a driver prescribes, and that differ least from the
    velocities in `y`, in the metric of the mass matrix. The kinetic energy that the impulse of the
    constraints adds is added to the integral "supplied" of the energy ledger."""
    motion = system.project_velocities(y.motion, t)
    work = y.work
    if "supplied" in work:
        after, before = (system.energies(at, t)["kinetic"] for at in (motion, y.motion))
        work = {**work, "supplied": work["supplied"] + (after - before)}
    return replace(y, motion=motion, work=work)
