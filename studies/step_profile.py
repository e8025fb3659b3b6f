"""What an attempted step is made of: each part runs alone in a native loop of its own.

Run by ``python -m studies.benchmark profile``.
"""

import time
from statistics import median
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp

import clearjoint as cj
from clearjoint.dynamics import Formulation, state_rates
from clearjoint.impacts import Landing
from clearjoint.segments import segment
from clearjoint.simulate import begin_compiled, default_controller
from clearjoint.stepping import Method, Step, Variables
from clearjoint.vectors import unpack

PARTS = ("right-hand side", "all stages alone", "solver's step", "with controller", "attempt")
"""Alone: so many right-hand sides as an attempt takes. Attempt: also landing, memory, acceptance."""
TURNS = 50_000
INSTANT = 0.3
"""s, where the parts are evaluated; no part branches on contact but the memory's onset."""
SMALL = 1e-9
"""s, the step with which the parts move on."""


def time_of_parts(solver: diffrax.AbstractERK, repeats: int) -> list[float]:
    """Seconds a turn of each of `PARTS`; medians of as many loops in turn."""
    scene, state = cj.double_pendulum(0.5e-3, 0.9)
    landing = Landing(jnp.asarray(1e-12))
    method = Method(solver, default_controller(1e-6, 1e-9), Formulation(), landing)
    start, end, first = (jnp.asarray(time) for time in (0.0, 4.0, 1e-6))
    now = begin_compiled(method, scene, state, start, end, first, None, None)
    run = eqx.filter_jit(segment)
    step = run(method, scene, now, jnp.asarray(INSTANT), jnp.asarray(10**7)).step
    loops = [eqx.filter_jit(loop) for loop in (_right_hand_sides, _steps, _controlled_steps)]
    calls = [lambda loop=loop: loop(method, scene, step, jnp.asarray(TURNS)) for loop in loops]
    calls.append(lambda: run(method, scene, now, end, jnp.asarray(TURNS)))
    turns = [TURNS] * 3 + [int(calls[-1]().step.attempts)]
    taken = [[_seconds(call) for call in calls] for _ in range(repeats + 1)][1:]
    each = [median(times) / n for times, n in zip(zip(*taken, strict=True), turns, strict=True)]
    assert isinstance(solver.tableau, diffrax.ButcherTableau)
    return [each[0], (solver.tableau.num_stages - 1) * each[0], *each[1:]]


def _seconds(call: Any) -> float:
    start = time.perf_counter()
    jax.block_until_ready(call())
    return time.perf_counter() - start


def _rates(method: Method, scene: Any, step: Step, y: Variables) -> Variables:
    return Variables(*state_rates(scene, method.formulation, y.motion, step.memory, step.t))


def _repeat(turn: Any, turns: Any, *values: Any) -> Any:
    """As many turns in a native loop; `turn` takes and returns the values."""
    count = jnp.zeros((), int)
    return jax.lax.while_loop(
        lambda now: now[0] < turns, lambda now: (now[0] + 1, *turn(*now[1:])), (count, *values)
    )


def _right_hand_sides(method: Method, scene: Any, step: Step, turns: Any) -> Any:
    scene = unpack(scene)

    def turn(y: Variables) -> tuple[Any]:
        rates = _rates(method, scene, step, y)
        return (jax.tree.map(lambda value, rate: value + SMALL * rate, y, rates),)

    return _repeat(turn, turns, step.y)


def _solver_step(method: Method, scene: Any, step: Step, y: Any, solver_state: Any) -> Any:
    term = diffrax.ODETerm(lambda t, y, args: _rates(method, scene, step, y))
    return method.solver.step(term, step.t, step.t + SMALL, y, None, solver_state, False)


def _steps(method: Method, scene: Any, step: Step, turns: Any) -> Any:
    scene = unpack(scene)

    def turn(y: Any, solver_state: Any, total: Any) -> tuple[Any, ...]:
        y, error, _, solver_state, _ = _solver_step(method, scene, step, y, solver_state)
        return y, solver_state, sum(jax.tree.leaves(error), total)

    return _repeat(turn, turns, step.y, step.solver_state, jnp.zeros(()))


def _controlled_steps(method: Method, scene: Any, step: Step, turns: Any) -> Any:
    scene = unpack(scene)
    controller = method.controller.wrap(1)

    def turn(y: Any, solver_state: Any, state: Any, total: Any) -> tuple[Any, ...]:
        after, error, _, solver_state, _ = _solver_step(method, scene, step, y, solver_state)
        _, _, t_next, _, state, _ = controller.adapt_step_size(
            step.t, step.t + SMALL, y, after, None, error, jnp.asarray(5.0), state
        )
        return after, solver_state, state, total + t_next

    return _repeat(
        turn, turns, step.y, step.solver_state, step.controller_state, jnp.zeros(())
    )
