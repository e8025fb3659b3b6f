"""A motion at a breakpoint: velocities that a driver makes jump, and the derivatives across it.

As in `.jumps`, the state at the end of a step that lands on a breakpoint holds what the rates
before and after would have made of the time since: nothing, to rounding, but with the derivative of
the motion along whatever the breakpoint depends on. Where the angle of a driver has a kink,
velocities jump by an impulse of the constraints, with least kinetic energy.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp

from ...dynamics.breakpoints import breakpoints, seen, since_breakpoints
from ...dynamics.contact_forces import EntrySpeeds
from ...dynamics.system import System
from ...math.vectors import Condition, Scalar
from ...model.bodies import NO_WRENCH, Wrench
from ...model.joints.base import AbstractForce, Motions
from ...model.scene import Scene
from .rates import rates_of
from .step_state import Variables

T = TypeVar("T")


class SwitchedForce(AbstractForce):
    """A force as at a time `before`, and a `share` of what it changes by until `after`."""

    force: AbstractForce
    before: Scalar
    after: Scalar
    share: Scalar

    def body_names(self) -> tuple[str, ...]:
        """Names of the bodies that the switched force acts on."""
        return self.force.body_names()

    def wrenches(self, motions: Motions, t: Scalar) -> dict[str, Wrench]:
        """Wrenches on the bodies, of which `share` is that of the force after."""
        del t
        old, new = (self.force.wrenches(motions, at) for at in (self.before, self.after))
        return {
            name: self._between(old.get(name, NO_WRENCH), new.get(name, NO_WRENCH))
            for name in {**old, **new}
        }

    def supplied_power(self, motions: Motions, t: Scalar) -> Scalar:
        """Power in W, of which `share` is that of the force after."""
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
    """The variables at the end of a step from `start` to t, changed if that is kept and lands on
    breakpoints; `entry_speeds` is that at its start.
    """
    scene = system.scene
    since = since_breakpoints(system, start, t)
    joints = {name: since[name] for name in scene.joints if name in since}
    forces = {name: since[name] for name in scene.forces if name in since}
    before, after = seen(system, start, t), seen(system, t, t)

    def rates(shares: Mapping[str, Scalar], y: Variables, time: Scalar) -> Variables:
        between = _with_shares(system, before, after, shares)
        return jax.tree.map(jnp.asarray, rates_of(between, y, entry_speeds, time))

    none = {name: jnp.zeros(()) for name in forces}

    def cross(y: Variables) -> Variables:
        if joints:
            time = _mean(joints)
            y = _moved_on(y, rates(none, y, before), -time)
            y = _past_kink(_with_shares(system, before, after, none), y, after - time)
            y = _moved_on(y, rates(none, y, after), time)
        if forces:
            times = {name: time for name, (_, time) in forces.items()}
            y = _moved_on(y, jax.jvp(lambda s: rates(s, y, after), (none,), (times,))[1], 1.0)
        return y

    lands: Condition = jnp.asarray(False)
    for lands_here, _ in since.values():
        lands = lands | lands_here
    return jax.lax.cond(keep & lands, cross, lambda y: y, y)


def _with_shares(
    system: System, before: Scalar, after: Scalar, shares: Mapping[str, Scalar]
) -> System:
    """The system with given shares of what its forces with breakpoints change by."""
    sides = system.clock(before), system.clock(after)
    forces = {
        name: SwitchedForce(force, *sides, shares[name]) if name in shares else force
        for name, force in system.scene.forces.items()
    }
    return system.with_scene(eqx.tree_at(lambda s: s.forces, system.scene, forces))


def _mean(since: dict[str, tuple[Condition, Scalar]]) -> Scalar:
    """The time since the breakpoints that a step lands on; drivers that change at one instant are
    taken to do so together."""
    count = sum(jnp.asarray(lands, float) for lands, _ in since.values())
    return sum(time for _, time in since.values()) / jnp.maximum(count, 1.0)


def _moved_on(y: Variables, rates: Variables, time: Scalar) -> Variables:
    return jax.tree.map(lambda value, rate: value + time * rate, y, rates)


def _past_kink(system: System, y: Variables, t: Scalar) -> Variables:
    """The variables with velocities as the constraints want them from t on; what their impulse
    brings in is booked as supplied."""
    motion = system.project_velocities(y.motion, t)
    work = y.work
    if "supplied" in work:
        after, before = (system.energies(at, t)["kinetic"] for at in (motion, y.motion))
        work = {**work, "supplied": work["supplied"] + (after - before)}
    return replace(y, motion=motion, work=work)


def joints_have_breakpoints(scene: Scene) -> bool:
    """Whether velocities may jump at a breakpoint."""
    return any(name in scene.joints for name in breakpoints(scene))
