"""Instants at which elements of a scene change: steps end there, and see one side of them only.

An element declares them as its `breakpoints`, in s. Whether it compares time with < or <= makes no
difference then: a step up to such an instant sees the element as it is just before, a step from it
as it is just after.
"""

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np

from ..compilation import traced_once
from ..math.functions import wrapped
from ..math.vectors import Condition, Scalar
from ..model.joints.base import AbstractElement
from ..model.scene import Scene
from .coordinates import MotionVariables
from .system import Prescribed, System

if TYPE_CHECKING:
    from jax.numpy import BinaryUfunc

ROUNDINGS = 8.0
"""Of a breakpoint, within which an instant is at it: elements may compute it in another order."""

PLACES, WEIGHTS = (column.tolist() for column in np.polynomial.legendre.leggauss(5))
"""Gauss's quadrature of order ten, over -1 to 1."""
DRIVER_ROUNDINGS = 64.0
ROUNDED_VALUE, ROUNDED_RATE = 1e-11, 1e-9
"""Rounding of a driver's value, m or rad, and of its rate, per second: those of a table of large
values at short intervals cancel to this."""


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


def drivers_are_smooth(
    system: System, variables: MotionVariables, start: Scalar, end: Scalar, rtol: Scalar
) -> Condition | None:
    """Whether constraints that depend on time change over a step by what their rates say, within a
    relative tolerance; ``None`` without such constraints.

    The equations of motion take second rates alone from a driver, at the solver's stages. Neither
    a kink nor a jump has one, so that error estimates miss both, and the run would go on with the
    old speed. Both times are by the system's own clock; bodies stand still at the `variables`, so
    that all that changes is what is prescribed. Angles count modulo 2 pi.
    """

    @traced_once
    def prescribed(system: System, variables: MotionVariables, t: Scalar) -> list[Prescribed]:
        return system.prescribed(variables, t)

    def total(values: Sequence[Scalar]) -> Scalar:
        return 0.5 * h * sum(w * value for w, value in zip(WEIGHTS, values, strict=True))

    if not jax.eval_shape(lambda: system.prescribed(variables, end)):
        return None
    h, eps = end - start, jnp.finfo(jnp.result_type(float)).eps
    inside = [start + 0.5 * (1.0 + x) * h for x in PLACES]
    within = [seen(system, start, t) for t in (start, end, *inside)]
    past_end = seen(system, end, end)  # on the other side, where the step ends at a breakpoint
    rounding = DRIVER_ROUNDINGS * eps * (1.0 + jnp.abs(system.clock(end)))
    smooth: Condition | None = None
    at_times = [prescribed(system, variables, t) for t in (past_end, *within)]
    for beyond, first, last, *others in zip(*at_times, strict=True):
        rates, seconds = zip(*((one.rate, one.second_rate) for one in others), strict=True)
        value = wrapped(beyond.value - first.value - total(rates), 2.0 * math.pi)
        rate = last.rate - first.rate - total(seconds)
        change = total([jnp.abs(second) for second in seconds])
        speed = jnp.abs(first.rate) + jnp.abs(last.rate) + change
        allowed = (rtol + rounding) * speed
        fine = jnp.abs(rate) <= allowed + ROUNDED_RATE
        fine &= jnp.abs(value) <= h * allowed + rounding * speed + ROUNDED_VALUE
        smooth = fine if smooth is None else smooth & fine
    return smooth


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
