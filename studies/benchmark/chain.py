"""A chain of rods hung on the ground, each by a joint with clearance: cost against its length."""

import tempfile
import time
from typing import Any

import equinox as eqx
import jax.numpy as jnp

import clearjoint as cj
from clearjoint.testing import RunProgram
from studies.common.loops import microseconds, right_hand_sides
from studies.common.operations import jaxpr_operations

LENGTH, MASS, CLEARANCE, RESTITUTION = 0.2, 1.0, 5e-4, 0.9
"""m, kg, m and 1."""
SPAN, TURNS = 0.1, 20_000
"""Simulated time, s; and evaluations that are timed together."""
REPEATS = 3


def chain(rods: int) -> tuple[cj.Scene, cj.State]:
    """Slender rods in a row along X, at rest, with joints about Z; gravity along -Y."""
    across = MASS * LENGTH**2 / 12
    law = cj.LankaraniNikravesh(restitution=RESTITUTION, stiffness=cj.STEEL)
    bodies, joints, states = {}, {}, {}
    before, end = "ground", (0.0, 0.0, 0.0)
    for k in range(rods):
        name = f"rod {k + 1}"
        bodies[name] = cj.Body(MASS, (1e-3 * across, across, across))
        states[name] = cj.body_state(((k + 0.5) * LENGTH, 0.0, 0.0))
        joints[f"joint {k + 1}"] = cj.ClearanceJoint(
            before,
            name,
            bearing_point=end,
            journal_point=(-0.5 * LENGTH, 0.0, 0.0),
            bearing_radius=10e-3,
            clearance=CLEARANCE,
            journal_length=20e-3,
            law=law,
        )
        before, end = name, (0.5 * LENGTH, 0.0, 0.0)
    return cj.Scene(bodies, joints, gravity=(0.0, -9.81, 0.0)), cj.State(states)


def chain_cost(rods: int) -> dict[str, Any]:
    """Costs of a chain in this process, nothing compiled before."""
    with tempfile.TemporaryDirectory() as cache:
        cj.configure(threads=1, cache=cache)
        scene, state = chain(rods)
        compiling, _ = _timed(scene, state, 1e-4)
        base, first = min(_timed(scene, state, 1e-4) for _ in range(REPEATS))
        seconds, attempts = min(_timed(scene, state, SPAN) for _ in range(REPEATS))
        program = RunProgram.of(scene, state)

        @eqx.filter_jit
        def evaluations(program: RunProgram, turns: Any) -> Any:
            return right_hand_sides(program.stepper(), program.step, turns)

        evaluations(program, jnp.asarray(1))
        evaluation = microseconds(TURNS, evaluations, program, jnp.asarray(TURNS))
        traced = eqx.filter_make_jaxpr(evaluations)(program, jnp.asarray(1))[0]
    return {
        "rods": rods,
        "operations traced of a right-hand side": jaxpr_operations(traced.jaxpr),
        "first call, s": compiling,
        "µs a right-hand side": evaluation,
        "µs an attempt": 1e6 * (seconds - base) / (attempts - first),
        "attempts": attempts,
    }


def _timed(scene: cj.Scene, state: cj.State, span: float) -> tuple[float, int]:
    """Time of a call, s, and its attempts."""
    start = time.perf_counter()
    solution = cj.simulate(scene, state, span, progress=False)
    return time.perf_counter() - start, int(solution.attempts)
