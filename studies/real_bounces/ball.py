"""Ball that bounces on a floor: flights in closed form, and the scene that simulates it.

Drag and law are user-defined: short subclasses of base classes in `clearjoint.extend`.
"""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from scipy.optimize import root_scalar

import clearjoint as cj
from clearjoint.extend import (
    Motion,
    Scalar,
    Vector,
    Wrench,
    norm_and_direction,
    quantity,
)

GRAVITY = 9.81
BALL, FLOOR, LOWEST = "ball", "floor", "point"
SLOWEST = 1e-3
"""Speed below which impacts have constant damping, m/s."""
START_HEIGHT = 1e-7
"""Initial height above the floor, m, so that a run begins in flight."""


def flight_time(launch: float, terminal: float) -> float:
    """Return the time of a flight after a launch upwards, s, with quadratic drag.

    **Arguments:** `launch`, m/s; `terminal`: terminal speed, m/s, infinite without drag.
    """
    if np.isinf(terminal):
        return 2.0 * launch / GRAVITY
    ratio = launch / terminal
    return terminal / GRAVITY * float(np.arctan(ratio) + np.arcsinh(ratio))


def launch_speed(interval: float, terminal: float) -> float:
    """Return the launch speed of a flight that lasts an interval in s, m/s."""
    vacuum = 0.5 * GRAVITY * interval
    if np.isinf(terminal):
        return vacuum
    bracket = (0.0, 10.0 * vacuum)
    return float(root_scalar(lambda v: flight_time(v, terminal) - interval, bracket=bracket).root)


def landing_speed(launch: float, terminal: float) -> float:
    """Return the speed at the end of a flight, m/s."""
    return launch / float(np.hypot(1.0, launch / terminal))


def fall_speed(height: Any, terminal: float) -> Any:
    """Return the speed after a fall from rest from a height in m, m/s."""
    if np.isinf(terminal):
        return np.sqrt(2.0 * GRAVITY * height)
    return terminal * np.sqrt(-np.expm1(-2.0 * GRAVITY * height / terminal**2))


def rise_speed(height: Any, terminal: float) -> Any:
    """Return the launch speed with which a ball rises to a height in m, m/s."""
    if np.isinf(terminal):
        return np.sqrt(2.0 * GRAVITY * height)
    return terminal * np.sqrt(np.expm1(2.0 * GRAVITY * height / terminal**2))


class Drag(cj.extend.AbstractForce):
    """Air drag m g (v/terminal speed)^2 against a body's velocity."""

    body: str = eqx.field(static=True)
    weight: Any = quantity("N")
    terminal_speed: Any = quantity("m/s")

    def body_names(self) -> tuple[str, ...]:
        """Return the body."""
        return (self.body,)

    def wrenches(self, motions: Mapping[str, Motion], t: Scalar) -> dict[str, Wrench]:
        """Return the force at the centre of mass."""
        del t
        motion = motions[self.body]
        speed, direction = norm_and_direction(motion.velocity)
        force = direction * (-self.weight * (speed / self.terminal_speed) ** 2)
        return {self.body: motion.wrench(force, Vector(0.0, 0.0, 0.0))}


def damping_factor(delivered: Any) -> Any:
    """Return the factor chi of Hunt and Crossley's family that delivers a restitution.

    Accurate to 1e-3 from 0.4 to 1: 3 (1 - e)(11 - e)/(2 (1 + 9 e)) (M. Carvalho, J. Martins 2019).
    """
    return 1.5 * (1.0 - delivered) * (11.0 - delivered) / (1.0 + 9.0 * delivered)


class RestitutionOverSpeed(cj.extend.AbstractContactLaw):
    """Law that delivers 1 - loss (v/(1 m/s))^power at the entry speed v of each impact.

    **Arguments:** `loss`: one minus the restitution at 1 m/s; `power`; `elastic`: law of the force
    without loss.
    """

    loss: Any = quantity("1")
    power: Any = quantity("1")
    elastic: cj.laws.Hertz  # pyright: ignore[reportGeneralTypeIssues]
    uses_entry_speed = True
    force_jumps = False

    def force(self, gap: cj.extend.Gap, entry_speed: Scalar | None) -> Scalar:
        """Return the normal force, N."""
        assert entry_speed is not None
        speed = jnp.maximum(entry_speed, SLOWEST)
        damping = damping_factor(1.0 - self.loss * speed**self.power)
        return self.elastic.force(gap, None) * jnp.maximum(1.0 + damping * gap.rate / speed, 0.0)

    def elastic_force(self, gap: cj.extend.Gap) -> Scalar:
        """Return the elastic force K delta^n, N."""
        return self.elastic.elastic_force(gap)

    def stored_energy(self, gap: cj.extend.Gap) -> Scalar:
        """Return the elastic energy K delta^(n+1)/(n+1), J."""
        return self.elastic.stored_energy(gap)


def scene(
    law: cj.extend.AbstractContactLaw, mass: float, diameter: float, terminal: float = np.inf
) -> cj.Scene:
    """Return a ball (mass, kg, diameter, m) above a floor in still air, with a terminal speed in
    m/s.
    """
    radius = 0.5 * diameter
    drag: dict[str, cj.extend.AbstractForce] = (
        {} if np.isinf(terminal) else {"drag": Drag(BALL, mass * GRAVITY, terminal)}
    )
    return cj.Scene(
        bodies={BALL: cj.Body(mass, (0.4 * mass * radius**2,) * 3)},
        joints={FLOOR: cj.Stop(cj.GROUND, BALL, normal=(0.0, 1.0, 0.0), radius=radius, law=law)},
        forces=drag,
        gravity=(0.0, -GRAVITY, 0.0),
    )


def simulated_intervals(made: cj.Scene, first: float, terminal: float, count: int) -> np.ndarray:
    """Return intervals between impacts, (count,) s, from a launch whose first flight lasts `first`
    s.
    """
    floor = made.joints[FLOOR]
    assert isinstance(floor, cj.Stop) and floor.radius is not None
    launch = launch_speed(first, terminal)
    start = cj.State(
        {
            BALL: cj.body_state(
                position=(0.0, floor.radius + START_HEIGHT, 0.0), velocity=(0.0, launch, 0.0)
            )
        }
    )
    impacts = cj.simulate(
        made, start, first * (count + 0.5), save=cj.Saving(impacts=True), progress=False
    ).impacts
    assert impacts is not None
    onsets = impacts.of(FLOOR, LOWEST).onset[:count]
    return np.diff(onsets, prepend=0.0)
