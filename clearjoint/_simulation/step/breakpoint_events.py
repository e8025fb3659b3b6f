"""Corrections of a step that ends at a breakpoint: of velocities that jump, and of derivatives with
respect to parameters.

A breakpoint is a declared time at which a driver or load changes abruptly. A step that ends at a
breakpoint is corrected as in `.saltation`: the change of the rates at the breakpoint, times the
time since the breakpoint, is added to the variables. Rates are time derivatives of the variables.
The time since the breakpoint is zero except for rounding, but it has derivatives with respect to
the parameters on which the breakpoint depends. Where the angle or distance that a driver prescribes
has a kink, an impulse of the constraints changes the velocities. The new velocities are those that
satisfy the constraints and differ least from the old ones, in the metric of the mass matrix.

The clock of a `System` counts the time from its `origin`, s; without an origin it shows the scene's
time. The entry speed of a contact is its penetration rate at its onset. The energy ledger of a run
consists of integrals of powers, J, such as the energy "supplied" by drivers and loads.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import reduce
from operator import or_
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp

from ..._dynamics.breakpoints import one_sided_time, since_breakpoints
from ..._dynamics.contact_forces import EntrySpeeds
from ..._dynamics.system import System
from ..._math.vectors import Condition, Scalar
from ..._model.bodies import NO_WRENCH, Wrench
from ..._model.joints.base import AbstractForce, Motions
from .step_state import Variables
from .trial_step import rates_of

T = TypeVar("T")


class SwitchedForce(AbstractForce):
    """A force whose wrenches and power are interpolated linearly between their values at two times.

    With times just before and just after a breakpoint, the derivative of the rates with respect to
    `share` is the change of the rates at the breakpoint.

    - `force`: the force; `before`, `after`: the two times of the scene, s.
    - `share`: position between the two values, 0 for those at `before` and 1 for those at `after`.
    """

    force: AbstractForce
    before: Scalar
    after: Scalar
    share: Scalar

    def body_names(self) -> tuple[str, ...]:
        """Return the names of the bodies that the force acts on."""
        return self.force.body_names()

    def wrenches(self, motions: Motions, t: Scalar) -> dict[str, Wrench]:
        """Return the interpolated wrenches, N and N m, by body name. A body without a wrench at one
        of the two times has a wrench of zero there. `t` is not used."""
        del t
        old, new = (self.force.wrenches(motions, at) for at in (self.before, self.after))
        return {
            name: self._between(old.get(name, NO_WRENCH), new.get(name, NO_WRENCH))
            for name in {**old, **new}
        }

    def supplied_power(self, motions: Motions, t: Scalar) -> Scalar:
        """Return the interpolated power, W, by which the force changes the total energy; `t` is not
        used."""
        del t
        return self._between(
            *(self.force.supplied_power(motions, at) for at in (self.before, self.after))
        )

    def _between(self, old: T, new: T) -> T:
        return jax.tree.map(lambda a, b: a + self.share * (b - a), old, new)


def across_breakpoints(
    system: System,
    start: Scalar,
    y: Variables,
    entry_speeds: EntrySpeeds,
    t: Scalar,
    keep: Condition,
) -> Variables:
    """Return the variables at the end of a step, corrected if the step ends at breakpoints.

    **Arguments:**

    - `start`, `t`: start and end of the step, s, on the clock of `system`.
    - `y`: variables at the end of the step; `entry_speeds`: entry speeds of contacts at its start,
      m/s.
    - `keep`: whether the step is accepted; otherwise `y` is returned.
    """
    scene = system.scene
    since = since_breakpoints(system, start, t)
    # By name of the element: whether the step ends at one of its breakpoints, and the time since.
    joints = {name: since[name] for name in scene.joints if name in since}
    forces = {name: since[name] for name in scene.forces if name in since}
    # Times just before and just after the breakpoint, at which elements are evaluated.
    before, after = one_sided_time(system, start, t), one_sided_time(system, t, t)

    def rates(shares: Mapping[str, Scalar], y: Variables, time: Scalar) -> Variables:
        return rates_of(_with_shares(system, before, after, shares), y, entry_speeds, time)

    # Shares of zero: all forces are as they were before their breakpoints.
    none = {name: jnp.zeros(()) for name in forces}

    def corrected(y: Variables) -> Variables:
        """Return the variables with the changes at all breakpoints where the step ends."""
        if joints:
            # Move back to the breakpoint with the old rates, apply the velocity jump there, and
            # move forward again with the new rates. The time of these moves is zero except for
            # rounding, but its derivatives are not.
            # Drivers with breakpoints at the same instant are assumed to change together, so the
            # mean of their times is taken. Lanes of a batch compute this in every step; the bound
            # of 1 avoids a division by zero where no driver has a breakpoint at the end. In a step
            # that ends at breakpoints of forces only, `time` is zero, and velocities lose nothing
            # but their drift from the constraints.
            count = sum(jnp.asarray(lands, float) for lands, _ in joints.values())
            time = sum(time for _, time in joints.values()) / jnp.maximum(count, 1.0)
            y = _moved_on(y, rates(none, y, before), -time)
            y = _past_kink(_with_shares(system, before, after, none), y, after - time)
            y = _moved_on(y, rates(none, y, after), time)
        if forces:
            # The rates depend linearly on the share of each switched force. So the derivative of
            # the rates, in the direction in which each share grows by the time since the force's
            # breakpoint, is the sum of the changes of the rates times these times.
            times = {name: time for name, (_, time) in forces.items()}
            y = _moved_on(y, jax.jvp(lambda s: rates(s, y, after), (none,), (times,))[1], 1.0)
        return y

    # Few steps land on a breakpoint; a single run computes the correction for these only.
    lands = reduce(or_, [lands for lands, _ in since.values()], jnp.asarray(False))
    return jax.lax.cond(keep & lands, corrected, lambda y: y, y)


def _with_shares(
    system: System, before: Scalar, after: Scalar, shares: Mapping[str, Scalar]
) -> System:
    """Return the system with each force whose name is in `shares` replaced by a `SwitchedForce`
    with this share.

    **Arguments:** `before`, `after`: times on both sides of a breakpoint, s, on the clock of
    `system`.
    """
    sides = system.clock(before), system.clock(after)
    forces = {
        name: SwitchedForce(force, *sides, shares[name]) if name in shares else force
        for name, force in system.scene.forces.items()
    }
    return system.with_scene(eqx.tree_at(lambda s: s.forces, system.scene, forces))


def _moved_on(y: Variables, rates: Variables, time: Scalar) -> Variables:
    """Return the variables `y` after a `time`, s, with constant `rates`."""
    return jax.tree.map(lambda value, rate: value + time * rate, y, rates)


def _past_kink(system: System, y: Variables, t: Scalar) -> Variables:
    """Return the variables with velocities that satisfy the constraints at the time t, s, just
    after a kink in the angle or distance that a driver prescribes.

    If the run has an energy ledger, the kinetic energy that the impulse of the constraints adds is
    added to the integral "supplied".
    """
    motion = system.project_velocities(y.motion, t)
    work = y.work
    if "supplied" in work:
        after, before = (system.energies(at, t)["kinetic"] for at in (motion, y.motion))
        work = {**work, "supplied": work["supplied"] + (after - before)}
    return replace(y, motion=motion, work=work)
