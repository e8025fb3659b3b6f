"""Motor shaft and link with backlash between them: numbers, and the exact motion.

Nothing drives them: they move at constant speeds between contacts, and each contact is a damped
oscillator that ends where its force vanishes. At the start the motor turns and the link rests, in
the middle of the backlash.
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
"""Backlash from flank to flank, rad, initial speed of the motor, rad/s, and end time, s."""
IMPACTS = 8
"""Number of computed impacts, more than there are until the end."""
FREQUENCY, DAMPING = 2000.0, 0.2
"""Undamped frequency, rad/s, and damping ratio of a contact."""

REPEATS = 5
"""Number of timed calls."""
T = TypeVar("T")


@dataclass(frozen=True)
class Motion:
    """Angles of motor and link, rad, and their rates at one time, with the mechanical energy, J."""

    angles: np.ndarray
    rates: np.ndarray

    @property
    def energy(self) -> float:
        """Kinetic energy, J."""
        return float(0.5 * (MOTOR * self.rates[0] ** 2 + LINK * self.rates[1] ** 2))


def relative(times: np.ndarray, play: jax.Array | float = PLAY) -> tuple[jax.Array, jax.Array]:
    """Return the motor's angle minus the link's, rad, and its rate, at times (N,), s, in closed
    form.
    """
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
    """Return the motion of both shafts at times (N,), s."""
    angle, rate = (np.asarray(part) for part in relative(times))
    return [of_relative(*row) for row in zip(times, angle, rate, strict=True)]


def of_relative(time: float, angle: float, rate: float) -> Motion:
    """Return the motion of both shafts from their relative motion: the momentum is constant."""
    mean = MOTOR * SPEED / (MOTOR + LINK)
    shares = np.array([LINK, -MOTOR]) / (MOTOR + LINK)
    return Motion(mean * time + shares * angle, mean + shares * rate)


def exact_derivative(time: float) -> float:
    """Return the derivative of the link's angle by the backlash."""
    _, change = jax.jvp(lambda play: relative(np.array([time]), play)[0][0], (PLAY,), (1.0,))
    return float(-MOTOR / (MOTOR + LINK) * change)


def timed(call: Callable[[], T]) -> tuple[T, float]:
    """Return the result of a call, and the least time of at least `REPEATS` calls, s."""
    seconds, result = [], call()
    # Short calls are repeated for 0.3 s: clearjoint compiles its checks of a scene at the eighth.
    while len(seconds) < REPEATS or sum(seconds) < 0.3:
        begun = time.perf_counter()
        result = call()
        seconds.append(time.perf_counter() - begun)
    return result, min(seconds)
