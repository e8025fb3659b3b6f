"""What an attempted step is made of: each part runs alone in a native loop of its own.

Run by ``python -m studies.benchmark profile``.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import clearjoint as cj
from clearjoint.testing import RunProgram, programs_of_sweeps
from studies.benchmark.sweep_programs import clearance_axis
from studies.common.loops import (
    controlled_steps,
    microseconds,
    repeated,
    right_hand_sides,
    solver_steps,
    tried_steps,
)
from studies.common.report import Record

TURNS = 50_000
"""Of a loop, shared out among the lanes."""
INSTANT, SPAN = 0.3, 4.0
"""s: the state at which the parts of a run are evaluated, none of which branches on contact; and
the run that is timed as a whole."""
PLACES = (8, 16, 32, 64, 128)


def of_run(solver: diffrax.AbstractERK, repeats: int) -> list[Record]:
    """Times of an attempt's parts in a single run; each contains the one before.

    An attempt in a run also lands, remembers impacts, and is kept or not; its time is that of a run
    of 4 s over their number. The last is what a call of `simulate` takes on the host: the time of a
    run of 0.1 ms, some ten steps.
    """
    scene, state = cj.double_pendulum(0.5e-3, 0.9)
    reached = cj.simulate(scene, state, INSTANT, progress=False).final
    settings = cj.Settings(solver=solver)
    program = RunProgram.of(scene, reached, settings, time=INSTANT)

    def run(span: float) -> int:
        return int(cj.simulate(scene, state, span, settings, progress=False).attempts)

    @eqx.filter_jit
    def repeat(loop: Callable[..., Any], program: RunProgram, turns: Any) -> Any:
        return loop(program.stepper(), program.step, turns)

    turns, attempts = jnp.asarray(TURNS), run(SPAN)
    parts = (right_hand_sides, solver_steps, controlled_steps)
    loops = [partial(repeat, part, program) for part in parts]
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
    with programs_of_sweeps() as programs:
        axes = {"clearance": clearance_axis(np.geomspace(5e-5, 1e-3, 256))}
        cj.sweep(scene, state, 0.5, axes, progress=False, threads=1)
    (program,) = programs

    @eqx.filter_jit
    def repeat(loop: Callable[..., Any], lanes: Any, turns: Any) -> Any:
        return jax.vmap(lambda lane: loop(lane, turns))(lanes)

    def of_step(part: Callable[..., Any], lane: Any, turns: Any) -> Any:
        return part(program.stepper(), lane.step, turns)

    def of_turn(lane: Any, turns: Any) -> Any:
        return repeated(lambda lane: (program.turn(lane),), turns, lane)

    parts = [right_hand_sides, solver_steps, controlled_steps, tried_steps]
    loops = [*(partial(of_step, part) for part in parts), of_turn]

    def on(count: int) -> list[Callable[..., Any]]:
        first = jax.tree.map(
            lambda leaf: jnp.broadcast_to(leaf, (count, *jnp.shape(leaf))), program.lane
        )
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
