"""A motor's shaft and a link with play between them: the numbers, and the exact motion.

Nothing drives them, so that all is known: they fly through the play at constant speeds, and each
contact is a damped oscillator that is let go where its force vanishes. The motor turns, the link
rests, in the middle of the play.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np

MOTOR, LINK = 1e-3, 4e-3
"""Moments of inertia, kg m^2."""
TOGETHER = MOTOR * LINK / (MOTOR + LINK)
PLAY, SPEED, END = 0.01, 2.0, 0.05
"""rad from flank to flank, rad/s of the motor at the start, and s."""
IMPACTS = 8
"""More than there are until then."""
FREQUENCY, DAMPING = 2000.0, 0.2
"""Of a contact: rad/s undamped, and over critical damping."""

REPEATS = 5
"""Of what is timed."""
T = TypeVar("T")


@dataclass(frozen=True)
class Motion:
    """Angles (motor, link) in rad and their rates at one time, and the mechanical energy in J."""

    angles: np.ndarray
    rates: np.ndarray

    @property
    def energy(self) -> float:
        """Kinetic energy, J."""
        return float(0.5 * (MOTOR * self.rates[0] ** 2 + LINK * self.rates[1] ** 2))


def relative(times: np.ndarray, play: jax.Array | float = PLAY) -> tuple[jax.Array, jax.Array]:
    """The motor's angle less the link's, rad, and its rate, at times (N,) in s, exactly."""
    damped = FREQUENCY * jnp.sqrt(1.0 - DAMPING**2)
    decay = DAMPING * FREQUENCY
    contact = 2.0 * jnp.arccos(DAMPING) / damped

    def within(since, entry):
        swing, fade = jnp.sin(damped * since) / damped, jnp.exp(-decay * since)
        rate = jnp.cos(damped * since) - decay * swing
        return entry * fade * swing, entry * fade * rate

    angle, rate = jnp.zeros(len(times)), jnp.zeros(len(times))
    begin, start, speed, side = 0.0, 0.0, SPEED, 1.0
    for _ in range(IMPACTS):
        onset = begin + (0.5 * play - start) / speed
        flies = (times >= begin) & (times < onset)
        angle = jnp.where(flies, side * (start + speed * (times - begin)), angle)
        rate = jnp.where(flies, side * speed, rate)
        depth, depth_rate = within(times - onset, speed)
        touches = (times >= onset) & (times < onset + contact)
        angle = jnp.where(touches, side * (0.5 * play + depth), angle)
        rate = jnp.where(touches, side * depth_rate, rate)
        left, left_rate = within(contact, speed)
        begin, start, speed, side = onset + contact, -0.5 * play - left, -left_rate, -side
    return angle, rate


def exact(times: np.ndarray) -> list[Motion]:
    """Both shafts at times (N,) in s."""
    angle, rate = (np.asarray(part) for part in relative(times))
    return [of_relative(*row) for row in zip(times, angle, rate, strict=True)]


def of_relative(time: float, angle: float, rate: float) -> Motion:
    """Both shafts by the angle and the rate between them: their momentum stays."""
    mean = MOTOR * SPEED / (MOTOR + LINK)
    shares = np.array([LINK, -MOTOR]) / (MOTOR + LINK)
    return Motion(mean * time + shares * angle, mean + shares * rate)


def exact_derivative(time: float) -> float:
    """Of the link's angle by the play."""
    _, change = jax.jvp(lambda play: relative(np.array([time]), play)[0][0], (PLAY,), (1.0,))
    return float(-MOTOR / (MOTOR + LINK) * change)


def timed(call: Callable[[], T]) -> tuple[T, float]:
    """What a call returns, and the least time that it takes in a few repeats, s."""
    seconds, result = [], call()
    for _ in range(REPEATS):
        begun = time.perf_counter()
        result = call()
        seconds.append(time.perf_counter() - begun)
    return result, min(seconds)
