"""The shafts in clearjoint: ideal hinges and a `Backlash`."""

import math
from dataclasses import replace

import numpy as np

import clearjoint as cj
from studies.backlash.shafts import (
    DAMPING,
    END,
    FREQUENCY,
    LINK,
    MOTOR,
    PLAY,
    SPEED,
    TOGETHER,
    Motion,
    timed,
)

AXIS, CLEARJOINT = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
RADIUS = 0.05
"""Radius of the flanks, m; without effect, as frequency and damping are given."""
PARAMETERS = {"play": cj.Parameter(lambda scene: scene.joints["play"].play)}
CHANNELS = {"link": cj.quantities.JointAngle("link")}


def shafts() -> tuple[cj.Scene, cj.State]:
    """Return the scene and its initial state."""
    mass = TOGETHER / RADIUS**2
    law = cj.laws.SpringDashpot(mass * FREQUENCY**2, 2.0 * DAMPING * mass * FREQUENCY)
    bodies = {
        "motor": cj.Body(1.0, (5e-3, 5e-3, MOTOR)),
        "link": cj.Body(1.0, (5e-3, 5e-3, LINK)),
    }
    hinges = {
        name: cj.RevoluteJoint("ground", name, CLEARJOINT, CLEARJOINT, AXIS, AXIS)
        for name in bodies
    }
    play = cj.Backlash("link", "motor", play=PLAY, radius=RADIUS, law=law)
    states = {
        "motor": cj.body_state(CLEARJOINT, spin=(0.0, 0.0, SPEED)),
        "link": cj.body_state(CLEARJOINT),
    }
    return cj.Scene(bodies, {**hinges, "play": play}), cj.State(states)


def run(rtol: float) -> tuple[Motion, float]:
    """Return the final motion, and the time of a compiled run, s."""
    scene, state = shafts()
    settings = cj.Settings(rtol=rtol, atol=1e-3 * rtol)
    solution, seconds = timed(lambda: cj.simulate(scene, state, END, settings, progress=False))
    pair = [solution.final.bodies[name] for name in ("motor", "link")]
    angles = [2.0 * math.atan2(body.orientation[3], body.orientation[0]) for body in pair]
    return Motion(np.array(angles), np.array([body.spin[2] for body in pair])), seconds


def path(times: np.ndarray) -> np.ndarray:
    """Return the motor's angle minus the link's, rad, at times (N,), s."""
    scene, state = shafts()
    states = cj.simulate(scene, state, END, save=cj.Saving(times), progress=False).states
    turned = {
        name: 2.0 * np.arctan2(body.orientation[:, 3], body.orientation[:, 0])
        for name, body in states.bodies.items()
    }
    return turned["motor"] - turned["link"]


def derivative(rtol: float) -> tuple[float, float]:
    """Return the derivative of the link's final angle by the backlash, and the time of a compiled
    run, s.
    """
    scene, state = shafts()
    # The derivatives are as accurate as the motion.
    settings = replace(cj.presets.derivatives, rtol=rtol, derivative_tolerance=1.0)
    found, seconds = timed(
        lambda: cj.sensitivities(
            scene, state, END, PARAMETERS, CHANNELS, [END], settings=settings, progress=False
        )
    )
    return float(np.ravel(found.derivatives["link"])[0]), seconds
