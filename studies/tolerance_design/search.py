"""Designs of the slider-crank, and the search for the largest clearance that keeps their limits.

See `studies.tolerance_design`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax.numpy as jnp
import numpy as np
from scipy.optimize import brentq

import clearjoint as cj
from clearjoint.extend import Instant
from clearjoint.quantities import Position
from studies.slider_crank.runs import PIN, Settings, closed_form
from studies.slider_crank.sweep import pin_force

POSITION, FORCE = "slider position", "pin force"
RANGE = (5e-6, 60e-6)
"""Radial clearances that are considered, m."""
TOLERANCE = 1e-5
"""Of a margin that is called zero."""
SAMPLES = 4000
"""Instants at which a run takes its outputs: in a revolution, some 10 a vibration on the wall."""

CLEARANCE = cj.Parameter(lambda scene: scene.joints[PIN].clearance, cj.Log())


def slider_error(now: Instant) -> Any:
    """Slider's position less the ideal mechanism's, m."""
    motor: Any = now.scene.joints["motor"]
    angle = motor.speed * now.time
    across = cj.CRANK_LENGTH * jnp.sin(angle)
    ideal = cj.CRANK_LENGTH * jnp.cos(angle) + jnp.sqrt(cj.ROD_LENGTH**2 - across**2)
    return Position("slider", "x")(now) - ideal


def distance(now: Instant) -> Any:
    """Of the slider from the ideal mechanism's, m."""
    return jnp.abs(slider_error(now))


OUTPUTS = {POSITION: distance, FORCE: pin_force, "error": slider_error}


@dataclass(frozen=True)
class Design:
    """The slider-crank at a crank speed in 1/min, run for so many revolutions, of which the last
    one counts; and what is allowed: distance from the ideal position, m, and pin force, N."""

    title: str
    speed: float
    revolutions: float
    position_tolerance: float
    force_limit: float

    @property
    def period(self) -> float:
        """Of one revolution, s."""
        return 60.0 / self.speed

    @property
    def limits(self) -> dict[str, float]:
        """Largest values allowed, by output."""
        return {POSITION: self.position_tolerance, FORCE: self.force_limit}

    def instants(self, revolutions: float = 1.0) -> np.ndarray:
        """Times in the last so many revolutions, s."""
        end = self.revolutions * self.period
        return np.linspace(end - revolutions * self.period, end, SAMPLES)

    def run(self, clearance: float, times: np.ndarray) -> cj.Sensitivities:
        """Outputs at times in s, at a radial clearance in m, and their derivatives to its
        logarithm."""
        scene, state = cj.slider_crank(clearance, speed=self.speed * np.pi / 30.0)
        return cj.sensitivities(
            scene,
            state,
            times[-1],
            {"clearance": CLEARANCE},
            OUTPUTS,
            times,
            throw=False,
        )

    def look(self, place: float) -> cj.Margins:
        """Margins at the logarithm of a clearance in m, by a run that finds the peaks and another
        that takes the outputs closely round them."""
        scene, state = cj.slider_crank(RANGE[0], speed=self.speed * np.pi / 30.0)
        end = self.revolutions * self.period
        return cj.margins(
            scene,
            state,
            end,
            CLEARANCE,
            {name: OUTPUTS[name] for name in self.limits},
            self.limits,
            value=float(np.exp(place)),
            after=end - self.period,
            samples=SAMPLES,
        )

    def largest(self, count: int) -> cj.Largest:
        """The largest clearance that keeps both limits, with rows of so many clearances."""
        scene, state = cj.slider_crank(RANGE[0], speed=self.speed * np.pi / 30.0)
        end = self.revolutions * self.period
        return cj.largest(
            scene,
            state,
            end,
            CLEARANCE,
            {name: OUTPUTS[name] for name in self.limits},
            self.limits,
            between=RANGE,
            after=end - self.period,
            lanes=count,
            tolerance=TOLERANCE,
            samples=SAMPLES,
        )


def start() -> Design:
    """The first revolution at 5000 1/min, with 20 kN allowed."""
    return Design("first revolution, 5000 1/min", 5000.0, 1.0, 30e-6, 20e3)


def settled(revolutions: float) -> Design:
    """A revolution after a transient at 7500 1/min, with 1.05 times the ideal joint's pin force.

    It ends half a turn from where the slider is farthest out and the force largest.
    """
    ideal = closed_form(Settings(revolutions_a_minute=7500.0))["force"]
    return Design("after a transient, 7500 1/min", 7500.0, revolutions, 30e-6, 1.05 * ideal)


@dataclass(frozen=True)
class Alone:
    """The search for one requirement, and how often bisection and Brent's method look in the same
    range to the same tolerance."""

    found: cj.MarginZero
    bisection: int
    brent: int


@dataclass(frozen=True)
class Answer:
    """What was found for a design: for each requirement alone and for both; the margins over the
    range; and what the library's search says of both."""

    design: Design
    alone: dict[str, Alone]
    both: cj.MarginZero
    lanes: list[cj.Margins]
    safest: cj.Largest

    @property
    def safe(self) -> float:
        """The clearance, m, up to which all hold."""
        return self.safest.value


def solve(design: Design, count: int) -> Answer:
    """Search, and look at so many clearances of the range."""
    low, high = np.log(RANGE)
    look = lru_cache(None)(design.look)
    both = cj.largest_within(look, low, high, TOLERANCE)
    lanes = [look(float(place)) for place in np.linspace(low, high, count)]
    alone = {name: search(look, name, low, high) for name in design.limits}
    return Answer(design, alone, both, lanes, design.largest(count))


def search(look: Callable[[float], cj.Margins], name: str, low: float, high: float) -> Alone:
    """For one requirement between two places."""
    found = cj.largest_within(lambda place: look(place).of(name), low, high, TOLERANCE)
    halvings = math.ceil(math.log2((high - low) / TOLERANCE))
    _, brent = brentq(
        lambda place: look(place).margins[name], low, high, xtol=TOLERANCE, full_output=True
    )
    return Alone(found, 2 + halvings, brent.function_calls)


def growth(design: Design, clearance: float) -> np.ndarray:
    """Largest derivative of the slider's position to the relative clearance in each revolution, in
    clearances."""
    run = design.run(clearance, design.instants(design.revolutions))
    turn = np.floor(run.times / design.period).astype(int)
    sizes = np.abs(run.derivatives["error"][:, 0]) / clearance
    return np.array([sizes[turn == k].max() for k in range(int(turn.max()))])
