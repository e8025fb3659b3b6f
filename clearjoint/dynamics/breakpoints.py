"""Instants at which elements of a scene change: steps end there, and see one side of them only.

An element declares them as its `breakpoints`, in s. Whether it compares time with < or <= makes no
difference then: a step up to such an instant sees the element as it is just before, a step from it
as it is just after.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp

from ..math.vectors import Condition, Scalar
from ..model.joints.base import AbstractElement
from ..model.scene import Scene
from .system import System

if TYPE_CHECKING:
    from jax.numpy import BinaryUfunc

ROUNDINGS = 8.0
"""Of a breakpoint, within which an instant is at it: elements may compute it in another order."""


def breakpoints(scene: Scene) -> dict[str, list[Scalar]]:
    """The breakpoints by joint and force, s; elements without any are left out. Arrays remain."""
    elements: dict[str, AbstractElement] = {**scene.joints, **scene.forces}
    times = {name: jax.tree.leaves(element.breakpoints()) for name, element in elements.items()}
    return {name: own for name, own in times.items() if own}


def next_breakpoint(system: System, t: Scalar) -> Scalar | None:
    """The first breakpoint after a time, infinite if there is none; ``None`` where the scene has
    none at all. Both times are by the system's own clock."""
    now = system.clock(t)
    soonest = _extreme(
        system.scene, jnp.minimum, lambda at: jnp.where(_is_after(at, now), at, jnp.inf)
    )
    return None if soonest is None else system.own_time(soonest)


def seen(system: System, start: Scalar, t: Scalar) -> Scalar:
    """The time as elements see it in a step from `start`: between the breakpoints, not on them. All
    times are by the system's own clock."""
    scene, start = system.scene, system.clock(start)

    def left(at: jax.Array) -> jax.Array:
        return jnp.where(_is_after(at, start), -jnp.inf, at + _rounding(at))

    def ahead(at: jax.Array) -> jax.Array:
        return jnp.where(_is_after(at, start), at - _rounding(at), jnp.inf)

    earliest = _extreme(scene, jnp.maximum, left)
    latest = _extreme(scene, jnp.minimum, ahead)
    if earliest is None:
        return t
    return system.own_time(jnp.clip(system.clock(t), earliest, latest))


def since_breakpoints(
    system: System, start: Scalar, t: Scalar
) -> dict[str, tuple[Condition, Scalar]]:
    """Of each element with breakpoints: whether a step from `start` to t, by the system's own
    clock, lands on one, and the time since that one, s. The time is zero to rounding, but has a
    derivative."""
    landings = {}
    start, t = system.clock(start), system.clock(t)
    for name, times in breakpoints(system.scene).items():
        count, sum_since = jnp.zeros(()), jnp.zeros(())
        for at in times:
            here = _is_after(at, start) & ~_is_after(at, t)
            count = count + jnp.sum(here)
            sum_since = sum_since + jnp.sum(jnp.where(here, t - at, 0.0))
        landings[name] = count > 0, sum_since / jnp.maximum(count, 1.0)
    return landings


def _is_after(at: Scalar, t: Scalar) -> jax.Array:
    return at > t + _rounding(at)


def _rounding(at: Scalar) -> jax.Array:
    return ROUNDINGS * jnp.finfo(jnp.result_type(float)).eps * jnp.abs(at)


def _extreme(
    scene: Scene, choice: "BinaryUfunc", of: Callable[[jax.Array], jax.Array]
) -> Scalar | None:
    """The smallest or largest of what each breakpoint gives; where steps end is no function of the
    parameters."""
    extreme: jax.Array | None = None
    for times in breakpoints(scene).values():
        for at in times:
            here = of(jax.lax.stop_gradient(jnp.asarray(at, dtype=float)))
            here = here if jnp.ndim(here) == 0 else choice.reduce(here)
            extreme = here if extreme is None else choice(extreme, here)
    return extreme
