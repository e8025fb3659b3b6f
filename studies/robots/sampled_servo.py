"""A joint with a servo, simulated by SciPy from sample to sample."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

Rates = Callable[[float, np.ndarray, float], Any]
"""Rates of the state, given time, s, state, and the torque, N m, in effect."""
SAMPLE, COMMAND, OUTPUT = range(3)
"""Kinds of instants, in the order in which equal ones come: a sample precedes the command that
takes effect."""
COINCIDE = 1e-12
"""Instants that differ by at most this time, s, are equal."""


@dataclass(frozen=True)
class SampledPid:
    """The sampled law. The first command, which is computed at time zero, acts from there on until
    the one of the first sample after it takes effect."""

    rate: float
    proportional: float
    derivative: float
    integral: float = 0.0
    delay: float = 0.0
    limit: float = np.inf
    goal: Callable[[float], float] = lambda t: 0.0
    goal_rate: Callable[[float], float] = lambda t: 0.0
    largest_goal_step: float = np.inf
    by_difference: bool = True
    drivable: Callable[[float], tuple[float, float]] = lambda speed: (-np.inf, np.inf)
    """Least and largest torque at a speed of the motor, for the integral only."""

    def run(
        self,
        rates: Rates,
        start: Sequence[float] | np.ndarray,
        end: float,
        read: Callable[[np.ndarray], tuple[float, float]],
        times: Sequence[float] | np.ndarray,
        motor_speed: Callable[[np.ndarray], float] = lambda y: 0.0,
        method: str = "DOP853",
        **tolerances: float,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the states at times, s, and the torque in effect there. `read` returns the angle,
        rad, and the speed, rad/s, that the encoder measures."""
        period, y = 1.0 / self.rate, np.array(start, float)
        last = read(y)[0]
        # With a limited goal, it starts at the present angle.
        goal = last if np.isfinite(self.largest_goal_step) else self.goal(0.0)
        integral = 0.0

        def command(t: float, y: np.ndarray, angle: float, speed: float) -> float:
            nonlocal goal, integral
            wanted, goal_rate = self.goal(t), self.goal_rate(t)
            if np.isfinite(self.largest_goal_step):
                step = np.clip(wanted - goal, -self.largest_goal_step, self.largest_goal_step)
                goal, goal_rate = goal + step, step * self.rate
            else:
                goal = wanted
            error = goal - angle
            torque = self.proportional * error + self.derivative * (goal_rate - speed)
            grown = integral + self.integral * error * period
            low, high = self.drivable(motor_speed(y))
            low, high = max(low, -self.limit), min(high, self.limit)
            pushes = (torque + grown > high and error > 0) or (torque + grown < low and error < 0)
            integral = integral if pushes else grown
            return float(np.clip(torque + integral, -self.limit, self.limit))

        torque, commands = command(0.0, y, *read(y)), {}
        now, states = 0.0, {}
        for t, kind, k in self._instants(end, times):
            if t > end + COINCIDE:
                break
            if t > now + COINCIDE:
                options: dict[str, Any] = {"rtol": 1e-11, "atol": 1e-13, **tolerances}
                solution = solve_ivp(
                    lambda t, y, u=torque: rates(t, y, u), (now, t), y, method, **options
                )
                y, now = solution.y[:, -1], t
            if kind == SAMPLE:
                angle, speed = read(y)
                speed = (angle - last) * self.rate if self.by_difference else speed
                last = angle
                commands[k] = command(t, y, angle, speed)
            elif kind == COMMAND:
                torque = commands[k]
            else:
                states[t] = y, torque
        rows = [states[round(t / COINCIDE) * COINCIDE] for t in times]
        return np.array([row[0] for row in rows]), np.array([row[1] for row in rows])

    def _instants(
        self, end: float, times: Sequence[float] | np.ndarray
    ) -> list[tuple[float, int, int]]:
        """Return the instants in order: time, s, kind, and the number of the sample."""
        numbers = range(1, int(np.ceil(end * self.rate)) + 1)
        instants = [(k / self.rate, SAMPLE, k) for k in numbers]
        instants += [(k / self.rate + self.delay, COMMAND, k) for k in numbers]
        instants += [(t, OUTPUT, 0) for t in (end, *times)]
        return sorted((round(t / COINCIDE) * COINCIDE, kind, k) for t, kind, k in instants)
