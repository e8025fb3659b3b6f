"""What an attempted step is made of: each part runs alone in a native loop of its own.

Run by ``python -m studies.benchmark profile``.
"""

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import clearjoint as cj
from clearjoint.dynamics import Formulation, state_rates
from clearjoint.lanes import WINDOW, Lane, Orders, turn
from clearjoint.pool import Common, Seat
from clearjoint.simulate import make_method
from clearjoint.stepping import attempt, start
from clearjoint.steps import Method, Step, Variables
from clearjoint.vectors import unpack
from studies.benchmarks.observed import begun, observed
from studies.benchmarks.report import Record
from studies.benchmarks.sweep_programs import clearance_axis

TURNS = 50_000
"""Of a loop, shared out among the lanes."""
INSTANT, SPAN = 0.3, 4.0
"""s: the state at which the parts of a run are evaluated, none of which branches on contact; and
the run that is timed as a whole."""
SMALL = 1e-9
"""s, the step with which the parts move on."""
PLACES = (8, 16, 32, 64, 128)


def of_run(solver: diffrax.AbstractERK, repeats: int) -> list[Record]:
    """Times of an attempt's parts in a single run; each contains the one before.

    An attempt in a run also lands, remembers impacts, and is kept or not; its time is that of a run
    of 4 s over their number. The last is what a call of `simulate` takes on the host: the time of a
    run of 0.1 ms, some ten steps.
    """
    scene, state = cj.double_pendulum(0.5e-3, 0.9)
    reached = cj.simulate(scene, state, INSTANT, progress=False)
    method = make_method(solver, None, Formulation(), 1e-12, 1e-6, None)

    def run(span: float) -> int:
        return int(cj.simulate(scene, state, span, solver=solver, progress=False).attempts)

    @eqx.filter_jit
    def repeat(loop: Callable[..., Any], turns: Any) -> Any:
        return loop(method, unpack(scene), _step_at(method, unpack(scene), reached), turns)

    turns, attempts = jnp.asarray(TURNS), run(SPAN)
    loops = [partial(repeat, loop) for loop in (right_hand_sides, solver_steps, controlled_steps)]
    for loop in loops:
        loop(turns)
    assert isinstance(solver.tableau, diffrax.ButcherTableau)
    stages, found = solver.tableau.num_stages - 1, []
    for _ in range(repeats):
        times = [microseconds(TURNS, loop, turns) for loop in loops]
        found.append({
            "solver": type(solver).__name__,
            "right-hand side, µs": times[0],
            "as many as an attempt takes, µs": stages * times[0],
            "solver's step, µs": times[1],
            "with controller, µs": times[2],
            "attempt in a run, µs": microseconds(attempts, run, SPAN),
            "call without steps, ms": 1e-3 * microseconds(1, run, 1e-4),
        })  # fmt: skip
    return found


def of_batch(repeats: int, places: Sequence[int] = PLACES) -> list[Record]:
    """Times of a lane-turn's parts with different numbers of lanes side by side, on one core."""
    scene, state = cj.double_pendulum()
    with observed() as seen:
        axes = {"clearance": clearance_axis(np.geomspace(5e-5, 1e-3, 256))}
        cj.sweep(scene, state, 0.5, axes, progress=False, devices=jax.devices()[:1])
    common, seats = begun(seen[0][0])
    method = common.plan.method

    @eqx.filter_jit
    def repeat(loop: Callable[..., Any], seats: Seat, turns: Any) -> Any:
        def one(seat: Seat) -> Any:
            return loop(common, seat, turns)

        return jax.vmap(one)(seats)

    def of_step(loop: Callable[..., Any], common: Common, seat: Seat, turns: Any) -> Any:
        return loop(method, common.scene(seat.task), seat.lane.step, turns)

    parts = [right_hand_sides, solver_steps, controlled_steps, tried_steps]
    loops = [*(partial(of_step, part) for part in parts), _turns]

    def on(count: int) -> list[Callable[..., Any]]:
        first = jax.tree.map(lambda leaf: leaf[:count], seats)
        return [partial(repeat, loop, first) for loop in loops]

    calls = {count: on(count) for count in places}
    for group in calls.values():
        for call in group:
            call(jnp.asarray(1))
    found = []
    for _ in range(repeats):
        for count, group in calls.items():
            turns = jnp.asarray(TURNS // count)
            times = [microseconds(TURNS // count * count, call, turns) for call in group]
            found.append({
                "places": count,
                "right-hand side, µs": times[0],
                "six, µs": 6 * times[0],
                "solver's step, µs": times[1],
                "with controller, µs": times[2],
                "attempt, µs": times[3],
                "turn, µs": times[4],
            })  # fmt: skip
    return found


def microseconds(turns: int, call: Callable[..., Any], *arguments: Any) -> float:
    """Time of a call for each of the turns it makes."""
    begin = time.perf_counter()
    jax.block_until_ready(call(*arguments))
    return (time.perf_counter() - begin) / turns * 1e6


def _step_at(method: Method, scene: Any, reached: cj.Solution) -> Step:
    """The step that follows the end of a run."""
    t, state = jnp.asarray(INSTANT), reached.final
    motion = method.formulation.coordinates.encode(scene, unpack(state.bodies))
    y = Variables(motion, {})
    return start(method, scene, t, t + SMALL, jnp.asarray(SMALL), y, state.memory)


def _term(method: Method, scene: Any, step: Step) -> diffrax.ODETerm:
    """The equations of motion with the memory of a step."""

    def rates(t: Any, y: Variables, args: Any) -> Variables:
        del args
        found = Variables(*state_rates(scene, method.formulation, y.motion, step.memory, t))
        return jax.tree.map(lambda rate: jnp.asarray(rate, dtype=float), found)

    return diffrax.ODETerm(rates)


def repeated(turn: Callable[..., Any], turns: Any, *values: Any) -> Any:
    """As many turns in a native loop; `turn` takes and returns the values."""

    def go(now: Any) -> Any:
        return (now[0] + 1, *turn(*now[1:]))

    return jax.lax.while_loop(lambda now: now[0] < turns, go, (jnp.zeros((), int), *values))


def right_hand_sides(method: Method, scene: Any, step: Step, turns: Any) -> Any:
    """Right-hand sides, each a little further on."""
    term = _term(method, scene, step)

    def turn(y: Any) -> tuple[Any]:
        rates = term.vf(step.t, y, None)
        return (jax.tree.map(lambda value, rate: value + SMALL * rate, y, rates),)

    return repeated(turn, turns, step.y)


def solver_steps(method: Method, scene: Any, step: Step, turns: Any) -> Any:
    """The solver's steps alone."""
    term, t0, t1 = _term(method, scene, step), step.t, step.t + SMALL

    def turn(y: Any, state: Any, total: Any) -> tuple[Any, ...]:
        after, error, _, state, _ = method.solver.step(term, t0, t1, y, None, state, False)
        return after, state, sum(jax.tree.leaves(error), total)

    return repeated(turn, turns, step.y, step.solver_state, jnp.zeros_like(step.t))


def controlled_steps(method: Method, scene: Any, step: Step, turns: Any) -> Any:
    """The solver's steps, and the controller's judgement."""
    term, t0, t1 = _term(method, scene, step), step.t, step.t + SMALL
    controller: Any = method.controller.wrap(1)
    order = method.solver.error_order(term)

    def turn(y: Any, state: Any, past: Any, total: Any) -> tuple[Any, ...]:
        after, error, _, state, _ = method.solver.step(term, t0, t1, y, None, state, False)
        _, _, t_next, _, past, _ = controller.adapt_step_size(
            t0, t1, y, after, None, error, order, past
        )
        return after, state, past, total + t_next

    values = step.y, step.solver_state, step.controller_state, jnp.zeros_like(step.t)
    return repeated(turn, turns, *values)


def tried_steps(method: Method, scene: Any, step: Step, turns: Any) -> Any:
    """Attempted steps, as a run makes them."""
    return repeated(lambda step: (attempt(method, scene, step, jnp.inf).step,), turns, step)


def _turns(common: Common, seat: Seat, turns: Any) -> Any:
    task, scene = seat.task, common.scene(seat.task)
    orders = Orders(task.end_time, task.first_step, (jnp.inf,) * WINDOW, common.capacity)

    def go(lane: Lane) -> tuple[Lane]:
        return (turn(common.plan, scene, lane, orders),)

    return repeated(go, turns, seat.lane)
