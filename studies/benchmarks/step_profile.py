"""What an attempted step is made of: each part runs alone in a native loop of its own.

Run by ``python -m studies.benchmark profile``.
"""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp

import clearjoint as cj
from clearjoint.dynamics import state_rates
from clearjoint.solvers import default_controller, ready_solver
from clearjoint.vectors import unpack

PARTS = (
    "right-hand side, µs",
    "as many as an attempt takes, µs",
    "solver's step, µs",
    "with controller, µs",
    "attempt in a run, µs",
    "call without steps, ms",
)
"""Each but the last contains the one before. An attempt also lands, remembers impacts, and is kept
or not; its time is that of a run of 4 s over their number. The last is what a call of `simulate`
takes on the host: the time of a run of 0.1 ms, some ten steps."""
TURNS = 50_000
INSTANT = 0.3
"""s, the state at which the parts are evaluated; none of them branches on contact."""
SMALL = 1e-9
"""s, the step with which the parts move on."""


def time_of_parts(solver: diffrax.AbstractERK, repeats: int) -> list[dict[str, Any]]:
    """The times of `PARTS`, repeated; the loops take turns."""
    scene, start = cj.double_pendulum(0.5e-3, 0.9)
    reached = cj.simulate(scene, start, INSTANT, progress=False)
    ready: Any = ready_solver(solver, 1e-6, 1e-9)
    loops = [
        eqx.filter_jit(partial(loop, ready))
        for loop in (_right_hand_sides, _steps, _controlled_steps)
    ]

    def run(span: float) -> int:
        return int(cj.simulate(scene, start, span, solver=solver, progress=False).attempts)

    turns, attempts = jnp.asarray(TURNS), run(4.0)
    for loop in loops:
        loop(scene, reached, turns)
    assert isinstance(solver.tableau, diffrax.ButcherTableau)
    stages, found = solver.tableau.num_stages - 1, []
    for _ in range(repeats):
        parts = [_microseconds(TURNS, loop, scene, reached, turns) for loop in loops]
        parts.append(_microseconds(attempts, run, 4.0))
        parts.append(1e-3 * _microseconds(1, run, 1e-4))
        times = zip(PARTS, (parts[0], stages * parts[0], *parts[1:]), strict=True)
        found.append({"solver": type(solver).__name__, **dict(times)})
    return found


def _microseconds(turns: int, call: Callable[..., Any], *arguments: Any) -> float:
    """Time of a call for each of the turns it makes."""
    start = time.perf_counter()
    jax.block_until_ready(call(*arguments))
    return (time.perf_counter() - start) / turns * 1e6


def _prepared(scene: Any, reached: cj.Solution) -> tuple[Any, diffrax.ODETerm]:
    """The variables at the end of a run, and their rates with the memory there."""
    scene, formulation = unpack(scene), reached.formulation
    y = formulation.coordinates.encode(scene, unpack(reached.final.bodies))

    def rates(t: Any, y: Any, args: Any) -> Any:
        del args
        found, _ = state_rates(scene, formulation, y, reached.final.memory, t)
        return jax.tree.map(lambda rate: jnp.asarray(rate, dtype=float), found)

    return y, diffrax.ODETerm(rates)


def _repeat(turn: Callable[..., Any], turns: Any, *values: Any) -> Any:
    """As many turns in a native loop; `turn` takes and returns the values."""

    def go(now: Any) -> Any:
        return (now[0] + 1, *turn(*now[1:]))

    return jax.lax.while_loop(lambda now: now[0] < turns, go, (jnp.zeros((), int), *values))


def _right_hand_sides(solver: diffrax.AbstractERK, scene: Any, reached: Any, turns: Any) -> Any:
    del solver
    y, term = _prepared(scene, reached)

    def turn(y: Any) -> tuple[Any]:
        rates = term.vf(jnp.asarray(INSTANT), y, None)
        return (jax.tree.map(lambda value, rate: value + SMALL * rate, y, rates),)

    return _repeat(turn, turns, y)


def _steps(solver: diffrax.AbstractERK, scene: Any, reached: Any, turns: Any) -> Any:
    y, term = _prepared(scene, reached)
    t0, t1 = jnp.asarray(INSTANT), jnp.asarray(INSTANT + SMALL)

    def turn(y: Any, solver_state: Any, total: Any) -> tuple[Any, ...]:
        after, error, _, solver_state, _ = solver.step(term, t0, t1, y, None, solver_state, False)
        assert error is not None
        return after, solver_state, sum(jax.tree.leaves(error), total)

    return _repeat(turn, turns, y, solver.init(term, t0, t1, y, None), jnp.zeros(()))


def _controlled_steps(solver: diffrax.AbstractERK, scene: Any, reached: Any, turns: Any) -> Any:
    y, term = _prepared(scene, reached)
    t0, t1 = jnp.asarray(INSTANT), jnp.asarray(INSTANT + SMALL)
    controller: Any = default_controller(1e-6, 1e-9).wrap(1)
    order = solver.error_order(term)

    def turn(y: Any, solver_state: Any, past: Any, total: Any) -> tuple[Any, ...]:
        after, error, _, solver_state, _ = solver.step(term, t0, t1, y, None, solver_state, False)
        _, _, t_next, _, past, _ = controller.adapt_step_size(
            t0, t1, y, after, None, error, order, past
        )
        return after, solver_state, past, total + t_next

    first = controller.init(term, t0, t1, y, t1 - t0, None, solver.func, order)[1]
    solver_state = solver.init(term, t0, t1, y, None)
    return _repeat(turn, turns, y, solver_state, first, jnp.zeros(()))
