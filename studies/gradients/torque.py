"""A torque of 100 numbers that turns a four-bar with play with the least peak of contact force."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import clearjoint as cj
from clearjoint.extend import Instant
from clearjoint.plot import style
from studies.gradients.searches import Problem, Search

SPAN, KNOTS, ITERATIONS = 0.4, 100, 30
QUICK_ITERATIONS = 2
CLEARANCE, START, TORQUE = 0.1e-3, 0.3, 0.25
POWER, FORCE = 16, 30.0
"""Exponent of the mean force that approximates its peak, and unit of the force, N."""
ANGLE, SPEED = 0.03, 0.3
"""Units of the final angle's error, rad, and of the final speed, rad/s."""
PIN = "rocker pin"
force = cj.quantities.ContactForce(PIN)
speed = cj.quantities.AngularVelocity("crank", "z")
SAMPLES = np.linspace(0.0, SPAN, 4001)


def high_power(now: Instant) -> jax.Array:
    """Return a high power of the contact force, as a fraction of `FORCE`."""
    return jnp.asarray((force(now) / FORCE) ** POWER)


OUTPUTS = {
    "turned": cj.Integral(speed, "rad"),
    "power": cj.Integral(high_power, "s"),
    "speed": speed,
}


def linkage(torque: np.ndarray) -> tuple[cj.Scene, cj.State]:
    """Return a horizontal four-bar at rest with play at one pin, in a plastic bush, and a torque on
    its crank, N m, at evenly spaced times."""
    law = cj.laws.LankaraniNikravesh(restitution=0.3, stiffness=cj.laws.RavnStiffness(3e9, 0.4))
    times = np.linspace(0.0, SPAN, len(torque))
    motor = cj.DriveTorque("ground", "crank", (0, 0, 1), cj.PiecewiseLinear(times, torque))
    return cj.mechanisms.four_bar({PIN: CLEARANCE}, law=law, angle=START, motor=motor, gravity=None)


def objective(outputs: dict[str, jax.Array]) -> jax.Array:
    """Return the sum of the squares of the final angle's error, the final speed and a mean force
    close to its peak."""
    mean = (outputs["power"] / SPAN) ** (1.0 / POWER)
    miss, rest = (outputs["turned"] - np.pi) / ANGLE, outputs["speed"][-1] / SPEED
    return miss**2 + rest**2 + mean**2


@dataclass(frozen=True)
class Motion:
    """The motion by a torque.

    - `torque` (N,): at its knots, N m; `force` (samples,): contact force, N.
    - `peak`: largest contact force, N; `impacts`: number of onsets of contact.
    - `turned`: angle of the crank at the end less that at the start, rad; `speed`:
      at the end, rad/s.
    """

    torque: np.ndarray
    force: np.ndarray
    peak: float
    impacts: int
    turned: float
    speed: float

    @staticmethod
    def of(torque: np.ndarray) -> "Motion":
        """Simulate the motion by a torque."""
        outputs = {
            "peak": cj.Peak(force, "N"), "turned": OUTPUTS["turned"], "force": force,
            "speed": speed,
        }  # fmt: skip
        save = cj.Saving(SAMPLES, impacts=True)
        found = cj.simulate(
            *linkage(torque), SPAN, cj.presets.derivatives, save, outputs=outputs, progress=False
        )
        assert found.impacts is not None
        onsets = len(np.unique(found.impacts.onset))
        peak, turned = (float(found.outputs[name]) for name in ("peak", "turned"))
        end = float(found.outputs["speed"][-1])
        return Motion(torque, np.asarray(found.outputs["force"]), peak, onsets, turned, end)


@dataclass(frozen=True)
class Torque:
    """Motions before and after a search, and the search."""

    before: Motion
    after: Motion
    search: Search


def measure(quick: bool) -> Torque:
    """Search from a torque that is constant and changes its sign after half the time."""
    knots = np.arange(KNOTS)
    first = np.where(knots < KNOTS // 2, TORQUE, -TORQUE)
    problem = Problem(
        *linkage(first),
        path=lambda scene: scene.forces["motor"].torque.values,
        outputs=OUTPUTS,
        times=np.array([SPAN]),
        objective=objective,
        step=1e-6,
    )
    torque, search = problem.searched(QUICK_ITERATIONS if quick else ITERATIONS, range(5, 100, 20))
    return Torque(Motion.of(first), Motion.of(torque), search)


def table(torque: Torque) -> list[tuple[str, ...]]:
    """Return the table of both motions as text."""
    head = (
        "torque", "largest contact force, N", "impacts", "error of the final angle, mrad",
        "final speed, rad/s",
    )  # fmt: skip
    cells = [
        (
            name, f"{motion.peak:.1f}", f"{motion.impacts}", f"{1e3 * (motion.turned - np.pi):.1f}",
            f"{motion.speed:.2f}",
        )
        for name, motion in (("before", torque.before), ("after", torque.after))
    ]  # fmt: skip
    return [head, *cells]


def figure(torque: Torque) -> Figure:
    """Draw torque and contact force before and after the search."""
    drawn = Figure(figsize=(9.0, 5.0), layout="constrained")
    upper, lower = drawn.subplots(2, 1, sharex=True)
    cases = (("before", torque.before, style.VERMILLION), ("after", torque.after, style.BLUE))
    for name, motion, colour in cases:
        knots = np.linspace(0.0, SPAN, len(motion.torque))
        upper.plot(knots, motion.torque, color=colour, linewidth=1.2, label=name)
        lower.plot(SAMPLES, motion.force, color=colour, linewidth=0.8, label=name)
    upper.legend()
    style.dress(upper, "", "torque, N m")
    style.dress(lower, "time, s", "contact force, N")
    return drawn
