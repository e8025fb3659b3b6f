"""Designs of the slider-crank, and the search for the largest clearance that keeps their limits."""

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np

import clearjoint as cj
from clearjoint.extend import Instant
from clearjoint.quantities import Position
from studies.slider_crank.runs import PIN, Settings, closed_form
from studies.slider_crank.sweep import pin_force

POSITION, FORCE = "slider position", "pin force"
RANGE = (5e-6, 60e-6)
"""Range of the radial clearance, m."""
TOLERANCE = 1e-5
"""Relative tolerance of the largest clearance."""
SAMPLES = 4000
"""Number of output times in a revolution, about 10 for each vibration on the wall."""

CLEARANCE = cj.Parameter(lambda scene: scene.joints[PIN].clearance, cj.Log())


def slider_error(now: Instant) -> Any:
    """Return the position of the slider minus the ideal one, m."""
    motor: Any = now.scene.joints["motor"]
    angle = motor.speed * now.time
    across = cj.mechanisms.CRANK_LENGTH * jnp.sin(angle)
    ideal = cj.mechanisms.CRANK_LENGTH * jnp.cos(angle) + jnp.sqrt(
        cj.mechanisms.ROD_LENGTH**2 - across**2
    )
    return Position("slider", "x")(now) - ideal


def distance(now: Instant) -> Any:
    """Return the distance of the slider from its ideal position, m."""
    return jnp.abs(slider_error(now))


OUTPUTS = {POSITION: distance, FORCE: pin_force, "error": slider_error}


@dataclass(frozen=True)
class Design:
    """A slider-crank at a speed in 1/min over some revolutions, with limits in the last one.

    The limits are the distance of the slider from its ideal position, m, and the pin force, N.
    """

    title: str
    speed: float
    revolutions: float
    position_tolerance: float
    force_limit: float

    @property
    def period(self) -> float:
        """Duration of a revolution, s."""
        return 60.0 / self.speed

    @property
    def limits(self) -> dict[str, float]:
        """Return the largest allowed values by output."""
        return {POSITION: self.position_tolerance, FORCE: self.force_limit}

    def instants(self, revolutions: float = 1.0) -> np.ndarray:
        """Return times in the last revolutions, s."""
        end = self.revolutions * self.period
        return np.linspace(end - revolutions * self.period, end, SAMPLES)

    def run(self, clearance: float, times: np.ndarray) -> cj.results.Sensitivities:
        """Return outputs at times in s for a radial clearance in m, and their derivatives by its
        logarithm.
        """
        scene, state = cj.mechanisms.slider_crank(clearance, speed=self.speed * np.pi / 30.0)
        return cj.sensitivities(
            scene,
            state,
            times[-1],
            {"clearance": CLEARANCE},
            OUTPUTS,
            times,
            throw=False,
        )

    def margins(self, clearances: np.ndarray) -> dict[str, np.ndarray]:
        """Return log(limit / peak) of each output at radial clearances in m, by one sweep."""
        scene, state = cj.mechanisms.slider_crank(RANGE[0], speed=self.speed * np.pi / 30.0)
        end = self.revolutions * self.period
        units = {POSITION: "m", FORCE: "N"}
        swept = cj.sweep(
            scene,
            state,
            end,
            {"clearance": cj.Axis(CLEARANCE.variation, clearances)},
            {name: cj.Peak(OUTPUTS[name], units[name], after=end - self.period) for name in units},
            cj.presets.derivatives,
        )
        return {name: np.log(limit / swept[name].values) for name, limit in self.limits.items()}

    def largest(self, names: list[str]) -> cj.results.LargestFeasible:
        """Return the largest clearance that keeps the limits of some outputs."""
        scene, state = cj.mechanisms.slider_crank(RANGE[0], speed=self.speed * np.pi / 30.0)
        end = self.revolutions * self.period
        return cj.largest_feasible(
            scene,
            state,
            end,
            CLEARANCE,
            {name: OUTPUTS[name] for name in names},
            {name: self.limits[name] for name in names},
            between=RANGE,
            after=end - self.period,
            tolerance=TOLERANCE,
        )


def start() -> Design:
    """Return the design of the first revolution at 5000 1/min, with a limit of 20 kN."""
    return Design("first revolution, 5000 1/min", 5000.0, 1.0, 30e-6, 20e3)


def settled(revolutions: float) -> Design:
    """Return the design of a revolution after a transient at 7500 1/min, with a limit of 1.05 times
    the ideal pin force.

    The revolution ends half a turn from the outer dead centre, where the force is largest.
    """
    ideal = closed_form(Settings(revolutions_a_minute=7500.0))["force"]
    return Design("after a transient, 7500 1/min", 7500.0, revolutions, 30e-6, 1.05 * ideal)


@dataclass(frozen=True)
class Answer:
    """Results of a design: the largest clearance for each limit and for both, and margins at
    clearances over the range, m.
    """

    design: Design
    alone: dict[str, cj.results.LargestFeasible]
    both: cj.results.LargestFeasible
    clearances: np.ndarray
    margins: dict[str, np.ndarray]


def solve(design: Design, count: int) -> Answer:
    """Search, and compute the margins at a number of clearances of the range."""
    clearances = np.geomspace(*RANGE, count)
    alone = {name: design.largest([name]) for name in design.limits}
    both = design.largest(list(design.limits))
    return Answer(design, alone, both, clearances, design.margins(clearances))


def growth(design: Design, clearance: float) -> np.ndarray:
    """Return the largest derivative of the slider's position by the relative clearance in each
    revolution, in clearances.
    """
    run = design.run(clearance, design.instants(design.revolutions))
    turn = np.floor(run.times / design.period).astype(int)
    sizes = np.abs(run.derivatives["error"][:, 0]) / clearance
    return np.array([sizes[turn == k].max() for k in range(int(turn.max()))])
