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
from studies.tolerance_design.margins import (
    Found,
    Margins,
    first_failure,
    largest_within,
    margins_of,
)

POSITION, FORCE = "slider position", "pin force"
RANGE = (5e-6, 60e-6)
"""Radial clearances that are considered, m."""
TOLERANCE = 1e-5
"""Of a margin that is called zero."""
SAMPLES = 4000
"""Instants at which a run takes its outputs: in a revolution, some 10 a vibration on the wall."""

CLOSE = 0.25
"""How far below what was found clearances are looked at closely, in their logarithm."""
NEIGHBOURS = 20
"""Instants on either side of a peak, of those taken closely round it, that say where it is."""


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
            {"clearance": cj.Parameter(lambda scene: scene.joints[PIN].clearance, cj.Log())},
            OUTPUTS,
            times,
            throw=False,
        )

    def look(self, place: float) -> Margins:
        """Margins at the logarithm of a clearance in m, by a run that finds the peaks and another
        that takes the outputs closely round them."""
        clearance = float(np.exp(place))
        coarse = self.run(clearance, self.instants())
        if coarse.result != cj.RESULTS.successful:
            return margins_of(coarse, place, self.limits)
        fine = self.run(clearance, times_round_peaks(coarse, tuple(self.limits)))
        return margins_of(fine, place, self.limits, NEIGHBOURS)


def times_round_peaks(run: cj.Sensitivities, names: tuple[str, ...]) -> np.ndarray:
    """As many instants as the run has, within one of its intervals round the largest value of each
    output, s."""
    interval = run.times[1] - run.times[0]
    shifts = np.linspace(-interval, interval, len(run.times) // len(names))
    peaks = [run.times[np.argmax(run.values[name])] for name in names]
    return np.sort(np.clip(np.concatenate([peak + shifts for peak in peaks]), *run.times[[0, -1]]))


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

    found: Found
    bisection: int
    brent: int


@dataclass(frozen=True)
class Answer:
    """What was found for a design: for each requirement alone and for both; the margins over the
    range; and the clearance, m, up to which all of those hold."""

    design: Design
    alone: dict[str, Alone]
    both: Found
    lanes: list[Margins]
    safe: float


def solve(design: Design, count: int) -> Answer:
    """Search, and look at so many clearances of the range, and as many just below what was found.

    If one of these fails, the search is for the zero next to the first that does.
    """
    low, high = np.log(RANGE)
    look = lru_cache(None)(design.look)
    both = largest_within(look, low, high, TOLERANCE)
    lanes = [look(float(place)) for place in np.linspace(low, high, count)]
    closer = [look(float(place)) for place in both.place - np.linspace(CLOSE, 0.0, count)]
    gap = first_failure(sorted([*lanes, *closer], key=lambda lane: lane.place), both.place)
    safe = both if gap is None else largest_within(look, *gap, TOLERANCE)
    alone = {name: search(look, name, low, high) for name in design.limits}
    return Answer(design, alone, both, lanes, float(np.exp(safe.place)))


def search(look: Callable[[float], Margins], name: str, low: float, high: float) -> Alone:
    """For one requirement between two places."""
    found = largest_within(lambda place: look(place).of(name), low, high, TOLERANCE)
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
