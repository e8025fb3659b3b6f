"""A ball that bounces on a rigid floor, with a reference file of Siconos.

The example is BouncingBallED of siconos/siconos-tutorials, in examples/mechanics:
a ball of 1 kg falls from 1 m with a restitution of 0.9. Siconos finds the impacts as events.
"""

import numpy as np

import clearjoint as cj
from studies.real_bounces.ball import BALL, FLOOR, LOWEST, scene
from studies.validation.check import Check

RESTITUTION, RADIUS, END = 0.9, 0.1, 4.0
"""Newton's coefficient; m; s, between the sixth and the seventh impact."""
STEP, QUICK_STEP = 1e-6, 8e-6
"""Lengths of the steps, s."""
PUBLISHED = {
    "height of the ball at 4 s": ("m", 0.2805174716217552),
    "velocity of the ball at 4 s": ("m/s", 0.1936871511951985),
    "impulse of the first six impacts": ("N s", 39.433687151195194),
}
"""Unit and value of each quantity in the file."""


def rigid_ball(quick: bool) -> list[Check]:
    """Check height, velocity and impulses of a run."""
    ours = motion(QUICK_STEP if quick else STEP).tolist()
    return [
        Check("Siconos, BouncingBallED", name, unit, published, own)
        for (name, (unit, published)), own in zip(PUBLISHED.items(), ours, strict=True)
    ]


def motion(step: float) -> np.ndarray:
    """Return the final height, m, and velocity, m/s, and the sum of the impulses, N s, of a run
    with steps in s."""
    made = scene(cj.laws.ExactRestitution(RESTITUTION, 1e9), 1.0, 2.0 * RADIUS)
    start = cj.State({BALL: cj.body_state((0.0, 1.0 + RADIUS, 0.0))})
    found = cj.simulate_nonsmooth(made, start, END, step=step)
    ball, contact = found.final.bodies[BALL], found.contacts[FLOOR][LOWEST]
    assert contact.impacts == 6
    return np.array([ball.position[1] - RADIUS, ball.velocity[1], contact.impulse])
