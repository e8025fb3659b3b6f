"""One lane of a batch: a run that takes one step a turn, reduces and records what is asked for.

Everything here is scalar arithmetic without loops; `vmap` adds the lanes, and `.device_pool` the
native loop round the turns.
"""

from functools import reduce
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from ...dynamics.absolute_coordinates import AbsoluteCoordinates
from ...dynamics.assembly import ACCEPTED_VIOLATION, REPRESENTED
from ...dynamics.equations_of_motion import flattened
from ...dynamics.formulation import Formulation
from ...dynamics.multipliers import row_rate
from ...dynamics.system import System
from ...math.vectors import EulerParameters, Scalar, unpack
from ...model.bodies import State
from ...model.scene import Scene
from ...quantities.instant import Instant
from ...results import RESULTS
from ..dense_output import on_constraints
from ..method import Scheme
from ..run_ends import begun, final_result, final_state
from ..step_state import Attempt, Method, Step, choose
from ..stepping import attempt, running
from .recording import SLOTS, Bracket, Crossing, Ring, Row, crossing_row
from .reductions import AbstractReduction

WINDOW = SLOTS + 1


class Plan(eqx.Module):
    """What all lanes of a batch have in common beside their scene.

    - `reductions` and `sections`: by name.
    - `saves`: whether states are saved at chosen times.
    - `max_steps`: largest number of steps tried in a lane.
    """

    scheme: Scheme
    reductions: dict[str, AbstractReduction]
    sections: dict[str, Crossing]
    saves: bool = eqx.field(static=True)
    max_steps: Any

    @property
    def method(self) -> Method:
        """How the lanes are integrated."""
        return self.scheme.method

    def looks_inside(self) -> bool:
        """Whether anything is recorded between the ends of steps."""
        return self.saves or bool(self.sections)


class Orders(eqx.Module):
    """What the host asks of a lane for a segment.

    `end_time` and `first_step`: s. `window`: the next times to save at, one more than a ring has
    slots, infinite behind the last. `wanted`: crossings still to be recorded, by section.
    """

    end_time: Scalar
    first_step: Scalar
    window: tuple[Scalar, ...]
    wanted: dict[str, Scalar]


class Lane(eqx.Module):
    """A run between two turns."""

    step: Step
    tallies: dict[str, Any]
    bracket: Bracket | None
    saved: Ring | None
    crossings: dict[str, Ring]
    levels: dict[str, Scalar]

    def runs(self, plan: Plan, end_time: Scalar) -> Scalar:
        """Whether another step is to be tried."""
        return running(self.step, end_time, plan.max_steps)


class Outcome(eqx.Module):
    """How a lane's run ended, and what it comes to."""

    time: Scalar
    result: RESULTS
    attempts: Scalar
    accepted: Scalar
    final: State
    results: dict[str, dict[str, Scalar]]


def begin_lane(plan: Plan, scene: Scene, state: State, start_time: Scalar, orders: Orders) -> Lane:
    """The lane before its first step."""
    fits = _is_assembled(plan, scene, state, start_time)
    system = plan.scheme.system(scene)
    step = begun(plan.method, system, state, start_time, orders.end_time, orders.first_step)
    step = eqx.tree_at(
        lambda s: s.result, step, RESULTS.where(fits, step.result, RESULTS.not_assembled)
    )
    now = Row(step.t, step.y, step.memory).instant(system)
    bracket = _empty_bracket(plan, system, step, orders) if plan.looks_inside() else None
    row = Row(step.t, step.y, step.memory)
    lane = Lane(
        step,
        {name: reduction.start(now) for name, reduction in plan.reductions.items()},
        bracket,
        Ring.like(row) if plan.saves else None,
        {name: Ring.like(row) for name in plan.sections},
        {name: _level(section, now) for name, section in plan.sections.items()},
    )
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=jnp.result_type(leaf)), lane)


def turn(plan: Plan, scene: Scene, lane: Lane, orders: Orders) -> Lane:
    """Take one step, unless the lane is at its end or waits for the host."""
    system = plan.scheme.system(scene)
    tried = attempt(plan.method, system, lane.step, orders.end_time)
    goes = _goes(plan, lane, orders)
    kept = goes & tried.kept
    step = choose(goes, tried.step, lane.step)
    lane = eqx.tree_at(lambda a: a.step, lane, step)
    if plan.looks_inside():
        bracket = choose(kept, Bracket.of(tried), lane.bracket)
        lane = eqx.tree_at(lambda a: a.bracket, lane, bracket)

    def inside(x: Scalar) -> Instant:
        return Bracket.of(tried).within(plan.method, x).instant(system)

    now = Row(step.t, step.y, step.memory).instant(system, inside)
    lane = _with_tallies(plan, lane, now, kept)
    lane = _with_crossings(plan, system, lane, now, kept, orders)
    return _with_save(plan, system, lane, orders)


def outcome(plan: Plan, scene: Scene, lane: Lane, end_time: Scalar) -> Outcome:
    """What is known of a lane now; final if it has ended."""
    system = plan.scheme.system(scene)
    step = lane.step
    now = Row(step.t, step.y, step.memory).instant(system)
    return Outcome(
        step.t,
        final_result(step, end_time),
        step.attempts,
        step.accepted,
        final_state(system, step),
        {
            name: reduction.results(lane.tallies[name], now)
            for name, reduction in plan.reductions.items()
        },
    )


def emptied(lane: Lane) -> Lane:
    """The lane with its rings read."""
    saved = None if lane.saved is None else lane.saved.emptied()
    crossings = {name: ring.emptied() for name, ring in lane.crossings.items()}
    return Lane(lane.step, lane.tallies, lane.bracket, saved, crossings, lane.levels)


def moves(plan: Plan, lane: Lane, orders: Orders) -> Scalar:
    """Whether a turn would do anything: the lane neither ended nor waits for the host."""
    goes = _goes(plan, lane, orders)
    if lane.saved is None:
        return goes
    return goes | (_save_is_due(lane, orders) & ~lane.saved.full())


def _goes(plan: Plan, lane: Lane, orders: Orders) -> Scalar:
    goes = lane.runs(plan, orders.end_time)
    if lane.saved is not None:
        more = orders.window[SLOTS] < jnp.inf
        goes = goes & ~_save_is_due(lane, orders) & ~(lane.saved.full() & more)
    for name, ring in lane.crossings.items():
        goes = goes & ~(ring.full() & (orders.wanted[name] > ring.count))
    return goes


def _next_save(lane: Lane, orders: Orders) -> Scalar:
    """The first time not saved at yet."""
    assert lane.saved is not None
    time: Scalar = orders.window[-1]
    for k in reversed(range(SLOTS)):
        time = jnp.where(lane.saved.count == k, orders.window[k], time)
    return time


def _save_is_due(lane: Lane, orders: Orders) -> Scalar:
    """Whether the run has come past a time that is not saved at yet."""
    if lane.saved is None:
        return jnp.asarray(False)
    return _next_save(lane, orders) <= lane.step.t


def _with_save(plan: Plan, system: System, lane: Lane, orders: Orders) -> Lane:
    if lane.saved is None:
        return lane
    assert lane.bracket is not None
    due = _save_is_due(lane, orders) & ~lane.saved.full()
    row = _on_constraints(system, lane.bracket.at(plan.method, _next_save(lane, orders)))
    return eqx.tree_at(lambda a: a.saved, lane, lane.saved.with_row(row, due))


def _with_tallies(plan: Plan, lane: Lane, now: Instant, kept: Scalar) -> Lane:
    tallies = {
        name: choose(kept, reduction.update(lane.tallies[name], now), lane.tallies[name])
        for name, reduction in plan.reductions.items()
    }
    return Lane(lane.step, tallies, lane.bracket, lane.saved, lane.crossings, lane.levels)


def _with_crossings(
    plan: Plan, system: System, lane: Lane, now: Instant, kept: Scalar, orders: Orders
) -> Lane:
    rings, levels = {}, {}
    for name, section in plan.sections.items():
        assert lane.bracket is not None
        ring, before, after = lane.crossings[name], lane.levels[name], _level(section, now)

        def value(row: Row, section: Crossing = section) -> Scalar:
            return _level(section, row.instant(system))

        row = crossing_row(plan.method, lane.bracket, before, after, value)
        row = _on_constraints(system, row)
        rises = kept & (before < 0.0) & (after >= 0.0)
        wanted = rises & (row.t >= section.after) & (orders.wanted[name] > ring.count)
        rings[name] = ring.with_row(row, wanted)
        levels[name] = jnp.where(kept, after, before)
    return Lane(lane.step, lane.tallies, lane.bracket, lane.saved, rings, levels)


def _on_constraints(system: System, row: Row) -> Row:
    """The row as `simulate` saves it."""
    return Row(row.t, on_constraints(system, row.y, row.t), row.memory)


def _level(section: Crossing, now: Instant) -> Scalar:
    return jnp.asarray(section.quantity(now), dtype=float)


def _empty_bracket(plan: Plan, system: System, step: Step, orders: Orders) -> Bracket:
    """A bracket of length zero at the start."""
    shapes: Attempt = jax.eval_shape(lambda: attempt(plan.method, system, step, orders.end_time))
    row = Row(step.t, step.y, step.memory)
    stages = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes.information["stages"])
    return Bracket(row, row, stages, step.enters if shapes.graded is not None else None)


def _is_assembled(plan: Plan, scene: Scene, state: State, t: Scalar) -> Scalar:
    """Whether position and velocity satisfy all ideal joints, and the coordinates can hold them."""
    bodies, absolute = unpack(state.bodies), System(scene, Formulation(AbsoluteCoordinates()))
    motions = absolute.motions(absolute.encode(bodies))
    fits: Scalar = jnp.asarray(True)
    for row in flattened(absolute.rows(motions, t)):
        violation = jnp.maximum(jnp.abs(row.value), jnp.abs(row_rate(row, motions)))
        fits = fits & (violation <= ACCEPTED_VIOLATION)
    own = System(scene, plan.scheme.formulation)
    for name, held in own.decode(own.encode(bodies)).items():
        fits = fits & (_apart(held.orientation, bodies[name].orientation) < REPRESENTED)
    return fits


def _apart(p: EulerParameters, q: EulerParameters) -> Scalar:
    """Largest difference of the Euler parameters of two orientations, whose sign means nothing."""
    pairs = ((p.e0, q.e0), (p.e1, q.e1), (p.e2, q.e2), (p.e3, q.e3))
    alike = [jnp.abs(one - other) for one, other in pairs]
    opposite = [jnp.abs(one + other) for one, other in pairs]
    return jnp.minimum(reduce(jnp.maximum, alike), reduce(jnp.maximum, opposite))
