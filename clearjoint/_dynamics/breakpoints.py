"""Breakpoints: declared times at which elements of a scene change abruptly, and at which steps end.

In a step that ends at a breakpoint, the element is evaluated just before it, and in a step that
starts there, just after it: it does not matter whether the element compares times with < or <=.
Public functions take times t since `System.origin`; breakpoints are times of the scene.
"""

from collections.abc import Callable, Sequence
from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from .._compilation.xla import shared_by_many, traced_once
from .._math.smoothing import TURN, wrapped
from .._math.vectors import Condition, Scalar
from .._model.drives.drivers import AbstractRotationDriver
from .._model.drives.functions_of_time import Increasing
from .._model.joints.base import AbstractElement, ByLabel, Row, each_label
from .._model.joints.sampled_force import ROUNDINGS, Periodic
from .._model.scene import Scene
from .coordinates import MotionVariables
from .sampled_forces import sampled_forces
from .system import System

SHORTEST = 1e-12
"""Time, s, much shorter than any step. A breakpoint at a smaller time, such as zero, is assumed to
have the rounding error of this time, so that the rounding error of each breakpoint is positive."""
FEW = 8
"""Number of breakpoints of a table up to which each is compared with the time, without a search."""

NODES, WEIGHTS = (column.tolist() for column in np.polynomial.legendre.leggauss(5))
"""Gauss quadrature with five points (order ten) on the interval -1 to 1."""
DRIVER_ROUNDINGS = 64.0
"""Assumed rounding error of a driver's rate in `drivers_are_smooth`, as a multiple of the rounding
error of one operation."""
ROUNDED_VALUE, ROUNDED_RATE = 1e-11, 1e-9
"""Allowed rounding errors in the change of a driver's value (m or rad) and of its rate (m/s or
rad/s). Such errors occur in tables of large values at short intervals of time."""


def breakpoints(scene: Scene) -> dict[str, list[Scalar | Increasing]]:
    """Return the breakpoints, s, of each joint or force that has any, as times of the scene: single
    times, and long tables as `Increasing`. Instants of sampled forces are not included."""

    def is_table(node: PyTree) -> bool:  # a table is kept as one object, not as its array
        return isinstance(node, Increasing)

    elements: dict[str, AbstractElement] = {**scene.joints, **scene.forces}
    times = {}
    for name, element in elements.items():
        instants = []
        for at in jax.tree.leaves(element.breakpoints(), is_leaf=is_table):
            # An element may return an array or a table without times.
            size = np.size(at.times if is_table(at) else at)
            # A table of a few times becomes an array, in which each time is compared: this costs
            # less than the search in a table.
            if is_table(at) and 0 < size <= FEW:
                at = jnp.asarray(at.times, dtype=float)
            if size > 0:
                instants.append(at)
        if instants:
            times[name] = instants
    return times


def has_breakpoints(scene: Scene) -> bool:
    """Return whether a scene has breakpoints, or instants of sampled forces."""
    return bool(breakpoints(scene) or sampled_forces(scene))


def next_breakpoint(system: System, t: Scalar) -> Scalar | None:
    """Return the first breakpoint or sampled force's instant after t by more than rounding errors,
    s since the origin like t; infinity if none is left, ``None`` if no element has any."""
    t = system.scene_time(t)
    soonest = _extreme(system, t, lambda at: at, after=True)
    forces = sampled_forces(system.scene).values()
    periodic = [instants for force in forces for instants in force.instants().values()]
    for instants in periodic:
        # One period after the latest instant that has passed.
        following = shared_by_many(len(periodic), _latest, system.origin, instants, t, 1)
        at = jax.lax.stop_gradient(jnp.asarray(following, dtype=float))
        soonest = at if soonest is None else jnp.minimum(soonest, at)
    return None if soonest is None else system.own_time(soonest)


def one_sided_time(system: System, start: Scalar, t: Scalar) -> Scalar:
    """Return the time t, clipped to the inside of the interval between two breakpoints in which the
    step from `start` lies, where elements have their values of this step. Instants of sampled
    forces do not count, since the memories of these forces are constant within a step."""
    # Each breakpoint gives a bound slightly inside of the step: a lower one if it is not after the
    # start, else an upper one.
    start = system.scene_time(start)
    earliest = _extreme(system, start, lambda at: at + _rounding(system.origin, at), after=False)
    latest = _extreme(system, start, lambda at: at - _rounding(system.origin, at), after=True)
    if earliest is None:  # The scene has no breakpoints.
        return t
    return system.own_time(jnp.clip(system.scene_time(t), earliest, latest))


def since_breakpoints(
    system: System, start: Scalar, t: Scalar
) -> dict[str, tuple[Condition, Scalar]]:
    """Return for each element with `breakpoints`, for a step from `start` to `t`:

    - whether the step ends at one of its breakpoints;
    - the time, s, from this breakpoint to the end of the step: zero except for rounding, but with
      derivatives by the parameters on which the breakpoint depends. Zero if the step ends at none.
    """
    landings = {}
    start, t = system.scene_time(start), system.scene_time(t)
    for name, times in breakpoints(system.scene).items():
        count, sum_since = jnp.zeros(()), jnp.zeros(())
        for at in times:
            if isinstance(at, Increasing):
                # Only the last breakpoint that is not after the end may be at the end. If there is
                # none, the first one stands for it, which is after the end and so not in the step.
                passed = _passed(system, at, t)
                instants = jnp.asarray(at.times, dtype=float)
                at = instants[jnp.maximum(passed - 1, 0)]
            # Steps end at breakpoints, so a breakpoint in the step is at the step's end.
            in_step = _is_after(system.origin, at, start) & ~_is_after(system.origin, at, t)
            count = count + jnp.sum(in_step)
            sum_since = sum_since + jnp.sum(jnp.where(in_step, t - at, 0.0))
        # A table may list the same breakpoint twice. The mean has the same derivative as the time
        # since that breakpoint; the sum would have twice this derivative.
        landings[name] = count > 0, sum_since / jnp.maximum(count, 1.0)
    return landings


SampledInstants: TypeAlias = dict[str, dict[str, tuple[Condition, Scalar]]]


def sampled_instants(system: System, start: Scalar, t: Scalar) -> SampledInstants:
    """Return two results for each sampled force and each name in its `instants`: whether the step
    from `start` to t ends at such an instant; and the latest instant that is not after t, as a time
    of the scene, s. A rounding error is added to this time, so that a table of targets that changes
    at the instant surely has its new value there."""
    start, t = system.scene_time(start), system.scene_time(t)
    instants = {name: f.instants() for name, f in sampled_forces(system.scene).items()}
    count = sum(map(len, instants.values()))

    def latest(name: str, key: str) -> tuple[Condition, Scalar]:
        periodic = instants[name][key]
        return shared_by_many(count, _latest_in_step, system.origin, periodic, start, t)

    return each_label(latest, instants)


def _latest_in_step(
    origin: Scalar | None, row: Periodic, start: Scalar, t: Scalar
) -> tuple[Condition, Scalar]:
    at = _latest(origin, row, t)
    return _is_after(origin, at, start), at + _rounding(origin, at)


def drivers_are_smooth(
    system: System, variables: MotionVariables, start: Scalar, end: Scalar, rtol: Scalar
) -> Condition | None:
    """Return whether all drivers (constraints that depend on time) are smooth over a step; ``None``
    without drivers. They are evaluated for bodies at rest, at the positions in `variables`.

    A driver is smooth if the change of its value is the integral of its rate, and the change of its
    rate is the integral of its second time derivative, up to `rtol` times the driver's speed. The
    equations of motion use the second derivative only, at the solver's stages: a kink or jump
    between stages would show in no error estimate, and the run would go on with the old speed.
    """

    # The rows are evaluated at eight times (past the end, start, end and five nodes of the
    # quadrature), and traced once for all of them.
    @traced_once
    def prescribed(system: System, variables: MotionVariables, t: Scalar) -> ByLabel[Row]:
        return system.prescribed(variables, t)

    def integral(values: Sequence[Scalar]) -> Scalar:
        return 0.5 * h * sum(w * value for w, value in zip(WEIGHTS, values, strict=True))

    if not system.is_driven(end):
        return None
    h, eps = end - start, jnp.finfo(jnp.result_type(float)).eps
    inside = [start + 0.5 * (1.0 + x) * h for x in NODES]
    within = [one_sided_time(system, start, t) for t in (start, end, *inside)]
    # If the step ends at a breakpoint, the rate may change there, but the value must be continuous.
    # So the value is taken on the far side of the end, and rates on the near side.
    past_end = one_sided_time(system, end, end)
    # This number is used as the relative error of a driver's rates, and also as the rounding error
    # of `end`, s, which causes an error of speed times this time in the driver's value.
    rounding = DRIVER_ROUNDINGS * eps * (1.0 + jnp.abs(system.scene_time(end)))
    smooth: Condition | None = None
    at_times = [prescribed(system, variables, t) for t in (past_end, *within)]
    names = [(name, label) for name, family in at_times[0].items() for label in family]
    for name, label in names:
        past, at_start, at_end, *at_nodes = (rows[name][label] for rows in at_times)
        # Since `System.prescribed` puts all bodies at rest, `time_rate` and `bias` are the first
        # and the second time derivative of the driver's value.
        rates = [row.time_rate for row in at_nodes]
        second_rates = [row.bias for row in at_nodes]
        # By how much value and rate change otherwise than by the integrals of their derivatives.
        value_jump = past.value - at_start.value - integral(rates)
        # Angles are known up to whole revolutions.
        if isinstance(system.scene.joints[name], AbstractRotationDriver):
            value_jump = wrapped(value_jump, TURN)
        rate_jump = at_end.time_rate - at_start.time_rate - integral(second_rates)
        # The scale includes `change`, the total variation of the rate, since a driver that
        # oscillates within the step may have small rates at both ends.
        change = integral([jnp.abs(second_rate) for second_rate in second_rates])
        speed = jnp.abs(at_start.time_rate) + jnp.abs(at_end.time_rate) + change
        allowed = (rtol + rounding) * speed
        is_smooth = jnp.abs(rate_jump) <= allowed + ROUNDED_RATE
        # A driver that rests up to its breakpoint at the end has moved a little at `past_end`.
        rounded = rounding * (speed + jnp.abs(past.time_rate)) + ROUNDED_VALUE
        is_smooth &= jnp.abs(value_jump) <= h * allowed + rounded
        smooth = is_smooth if smooth is None else smooth & is_smooth
    return smooth


def is_reached(system: System, instant: Scalar, t: Scalar) -> Condition:
    """Return whether t is at or after an `instant`, or is earlier only by a rounding error. Both
    are in s since `System.origin`."""
    return ~_is_after(system.origin, system.scene_time(instant), system.scene_time(t))


def _latest(origin: Scalar | None, row: Periodic, t: Scalar, later: int = 0) -> Scalar:
    """Return the latest instant of `row` that is not after t or, with `later`, the one that many
    periods after it. Times are the scene's, s, compared up to `_rounding`, which uses `origin`."""
    nearest = jnp.round((t - row.offset) / row.period)
    passed = jnp.where(_is_after(origin, row.instant(nearest), t), nearest - 1.0, nearest)
    return row.instant(jax.lax.stop_gradient(passed) + later)


def _is_after(origin: Scalar | None, at: Scalar, t: Scalar) -> jax.Array:
    return at > t + _rounding(origin, at)


def _rounding(origin: Scalar | None, at: Scalar) -> jax.Array:
    """Return the difference, s, up to which a time counts as equal to a breakpoint `at`, both as
    times of the scene, in a system with this `origin`."""
    # A time since the origin has the rounding error of the origin too.
    size = SHORTEST if origin is None else jnp.maximum(jnp.abs(origin), SHORTEST)
    # An infinite rounding error would make an infinite breakpoint equal to any time.
    size = jnp.maximum(jnp.where(jnp.isinf(at), 0.0, jnp.abs(at)), size)
    return ROUNDINGS * jnp.finfo(jnp.result_type(float)).eps * size


def _passed(system: System, table: Increasing, t: Scalar) -> jax.Array:
    """Return the number of breakpoints of a table that are not after t. Times are the scene's, s,
    compared up to `_rounding`, which uses the origin of the `system`."""
    times = jax.lax.stop_gradient(jnp.asarray(table.times, dtype=float))
    # Of a breakpoint that counts as equal to t, the rounding error is that of t.
    return jnp.searchsorted(times, t + _rounding(system.origin, t), side="right")


def _extreme(
    system: System, t: Scalar, function: Callable[[jax.Array], jax.Array], after: bool
) -> Scalar | None:
    """Return the smallest value of an increasing function of time at the breakpoints after t or,
    without `after`, its largest value at those not after t. All times are the scene's. The value is
    infinite if there is no such breakpoint, and ``None`` if the scene has none at all. It is not
    differentiated, since the solution does not depend on where steps end."""
    # `choice` takes the extreme of several values, and `none` stands for no breakpoint.
    choice, none = (jnp.minimum, jnp.inf) if after else (jnp.maximum, -jnp.inf)
    extreme: jax.Array | None = None
    for times in breakpoints(system.scene).values():
        for declared in times:  # a time, an array of times or a table
            instants = declared.times if isinstance(declared, Increasing) else declared
            at = jax.lax.stop_gradient(jnp.asarray(instants, dtype=float))
            if isinstance(declared, Increasing):
                # Since the function increases, its value at the nearest breakpoint is the extreme.
                passed, count = _passed(system, declared, t), len(at)
                index, exists = (passed, passed < count) if after else (passed - 1, passed > 0)
                nearest = function(at[jnp.clip(index, 0, count - 1)])
                value = jnp.where(exists, nearest, none)
            else:
                is_after = _is_after(system.origin, at, t)
                value = jnp.where(is_after if after else ~is_after, function(at), none)
                # An array has several times, each with its value.
                value = value if jnp.ndim(value) == 0 else choice.reduce(value, axis=None)
            extreme = value if extreme is None else choice(extreme, value)
    return extreme
