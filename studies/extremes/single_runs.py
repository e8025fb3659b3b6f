"""Cases with separate runs: constraints, derivatives, single precision and late times."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

import clearjoint as cj
from studies.extremes.cases import BASE, decades, thrown, thrown_error
from studies.extremes.entries import REFUSED, Entry, Row, judged
from studies.extremes.runs import run

TIGHT = cj.Settings(rtol=1e-9, max_steps=100_000)
GRAVITY = 9.81


def single_rows() -> list[Row]:
    """Return the rows of all cases."""
    rows = (default_tolerances, late_start, singular_position, skew_hinge, centred_journal)
    return [*(row() for row in rows), single_precision()]


def four_bar(angle: float, skew: float = 0.0) -> tuple[cj.Scene, cj.State]:
    """Return a parallelogram of three rods of 1 m and 1 kg at rest.

    `angle`: of the cranks to the ground, rad; at zero all rods lie in one line, and the cranks may
    move apart. `skew`: tilt of one hinge, rad.
    """
    rod = cj.Body(1.0, (1e-3, 1 / 12, 1 / 12))
    axis, askew = (0.0, 0.0, 1.0), (np.sin(skew), 0.0, np.cos(skew))
    near, far = (-0.5, 0.0, 0.0), (0.5, 0.0, 0.0)

    def hinge(
        first: str, second: str, first_point: tuple, second_point: tuple, first_axis: tuple
    ) -> cj.RevoluteJoint:
        return cj.RevoluteJoint(first, second, first_point, second_point, first_axis, axis)

    joints: dict[str, Any] = {
        "left foot": hinge("ground", "left", (0.0, 0.0, 0.0), near, axis),
        "right foot": hinge("ground", "right", (1.0, 0.0, 0.0), near, axis),
        "left top": hinge("left", "beam", far, near, axis),
        "right top": hinge("beam", "right", far, far, askew),
    }
    along = np.array([np.cos(angle), np.sin(angle), 0.0])
    orientation = (np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2))
    state = cj.State(
        {
            "left": cj.body_state(0.5 * along, orientation),
            "right": cj.body_state(0.5 * along + [1.0, 0.0, 0.0], orientation),
            "beam": cj.body_state(along + [0.5, 0.0, 0.0]),
        }
    )
    bodies: dict[str, cj.Body] = dict.fromkeys(("left", "right", "beam"), rod)
    return cj.Scene(bodies, joints, gravity=(0.0, -GRAVITY, 0.0)), state


def crank_angle(start: float, duration: float) -> float:
    """Return the parallelogram's angle by SciPy's DOP853: 5/3 angle'' = -2 g cos(angle)."""

    def rates(t: float, y: np.ndarray) -> list[float]:
        del t
        return [y[1], -1.2 * GRAVITY * np.cos(y[0])]

    found = solve_ivp(rates, (0, duration), [start, 0.0], "DOP853", rtol=1e-12, atol=1e-14)
    return float(found.y[0, -1])


def _four_bar_entry(
    value: float, angle: float, skew: float, duration: float, bound: float
) -> Entry:
    try:
        bars = four_bar(angle, skew)
        solution = cj.simulate(*bars, duration, TIGHT, throw=False, progress=False)
    except ValueError as error:
        return Entry(value, REFUSED, np.nan, _refusal(error))
    w, _, _, z = np.asarray(solution.final.bodies["left"].orientation)
    off = 2 * np.arctan2(z, w) - crank_angle(angle, duration)
    apart = abs(np.remainder(off + np.pi, 2 * np.pi) - np.pi)
    return judged(value, _name(solution), float(apart), bound)


def _refusal(error: ValueError) -> str:
    return f"ValueError, {str(error).split('`')[1]}"


def _name(solution: cj.results.Solution) -> str:
    return "successful" if solution.result == cj.RESULTS.successful else "failed"


def singular_position() -> Row:
    """Return the row of a parallelogram that falls through its singular position."""
    angles = (0.7, 0.1, 1e-3, 1e-5, 1e-7, 1e-9, 0.0)
    entries = tuple(_four_bar_entry(a, a, 0.0, 1.5, 1e-6) for a in angles)
    return Row("four-bar, start angle", "rad", "parallel motion", 1e-6, entries)


def skew_hinge() -> Row:
    """Return the row of a skew hinge, which makes redundant constraints inconsistent."""
    skews = (0.0, 1e-12, 1e-10, 1e-8, 1e-7, 1e-6, 1e-5, 1e-3)
    entries = tuple(_four_bar_entry(s, 0.7, s, 1.0, 1e-6) for s in skews)
    return Row("four-bar, skew hinge", "rad", "parallel motion", 1e-6, entries)


def default_tolerances() -> Row:
    """Return the row of the thrown journal with default tolerances, from slow to fast."""
    entries = []
    for speed in decades(1e-9, 1e2, 12):
        draw = BASE | {"speed": speed}
        trial = replace(thrown(draw), atol=None)
        (lane,) = run("thrown journal", [trial], 100_000, rtol=1e-6)
        entries.append(judged(speed, lane.result, thrown_error(draw, lane.outcome), 0.03))
    check = "restitution, depth"
    return Row("entry speed, default tolerances", "m/s", check, 0.03, tuple(entries))


def late_start() -> Row:
    """Return the row of the thrown journal at late times, where the resolution of the time is
    coarse.
    """
    entries = []
    for start in (0.0, 1.0, 1e3, 1e5, 1e7, 1e9, 1e11):
        (lane,) = run("thrown journal", [thrown(BASE)], 100_000, start_time=start)
        error = thrown_error(BASE, lane.outcome)
        entries.append(judged(start, lane.result, error, 1e-4))
    return Row("late start", "s", "restitution, depth", 1e-4, tuple(entries))


def centred_journal() -> Row:
    """Return the row of derivatives of a flight from the exact centre: 1 and t."""
    trial = thrown(BASE)
    entries = []

    @eqx.filter_jit
    def final_position(start: jax.Array, speed: jax.Array, duration: jax.Array) -> jax.Array:
        body = trial.state.bodies["journal"]
        position, velocity = jnp.asarray(body.position), jnp.asarray(body.velocity)
        body = eqx.tree_at(
            lambda b: (b.position, b.velocity),
            body,
            (position.at[0].set(start), velocity.at[0].set(speed)),
        )
        state = cj.State({"journal": body})
        run = cj.simulate(trial.scene, state, duration, cj.Settings(rtol=1e-9))
        return run.final.bodies["journal"].position[0]

    for duration in (1e-6, 1e-3, 4e-3):
        slopes = jax.jacfwd(final_position, argnums=(0, 1))(
            jnp.zeros(()), jnp.asarray(0.1), duration
        )
        by_start, by_speed = (float(slope) for slope in slopes)
        error = max(abs(by_start - 1), abs(by_speed / duration - 1))
        entries.append(judged(duration, "successful", error, 1e-9))
    return Row("centred journal, flight", "s", "derivatives 1 and t", 1e-9, tuple(entries))


FIRST_IMPACT = {"onset": 10.0964e-3, "entry_speed": 0.0990454, "peak_force": 1466.376}
"""First impact of the paper's pendulum by the event-exact reference solver."""


def single_precision() -> Row:
    """Return the row of the first impact in 32-bit floats, in a separate process."""
    environment = os.environ | {"PYTHONWARNINGS": "error::RuntimeWarning"}
    command = [sys.executable, "-m", "studies.extremes.single_precision"]
    found = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    entries = []
    for entry in json.loads(found.stdout):
        errors = [abs(entry[name] / value - 1) for name, value in FIRST_IMPACT.items()]
        errors.append(entry["ledger"])
        entries.append(judged(entry["rtol"], entry["result"], max(errors), 1e-3))
    return Row("float32, rtol", "1", "first impact, ledger", 1e-3, tuple(entries))
