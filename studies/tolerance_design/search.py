"""Designs of the slider-crank, and the search for the largest clearance that keeps their limits.

See `studies.tolerance_design`.
"""

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
"""Radial clearances that are considered, m."""
TOLERANCE = 1e-5
"""Of the largest clearance, relative to itself."""
SAMPLES = 4000
"""Instants at which a run takes its outputs: in a revolution, some 10 a vibration on the wall."""

CLEARANCE = cj.Parameter(lambda scene: scene.joints[PIN].clearance, cj.Log())


def slider_error(now: Instant) -> Any:
    """Slider's position less the ideal mechanism's, m."""
    motor: Any = now.scene.joints["motor"]
    angle = motor.speed * now.time
    across = cj.mechanisms.CRANK_LENGTH * jnp.sin(angle)
    ideal = cj.mechanisms.CRANK_LENGTH * jnp.cos(angle) + jnp.sqrt(
        cj.mechanisms.ROD_LENGTH**2 - across**2
    )
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

    def run(self, clearance: float, times: np.ndarray) -> cj.results.Sensitivities:
        """Outputs at times in s, at a radial clearance in m, and their derivatives to its
        logarithm."""
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
        """log(limit / peak) of each output at radial clearances in m, by one sweep."""
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
        """The largest clearance that keeps the limits of some outputs."""
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
    """The first revolution at 5000 1/min, with 20 kN allowed."""
    return Design("first revolution, 5000 1/min", 5000.0, 1.0, 30e-6, 20e3)


def settled(revolutions: float) -> Design:
    """A revolution after a transient at 7500 1/min, with 1.05 times the ideal joint's pin force.

    It ends half a turn from where the slider is farthest out and the force largest.
    """
    ideal = closed_form(Settings(revolutions_a_minute=7500.0))["force"]
    return Design("after a transient, 7500 1/min", 7500.0, revolutions, 30e-6, 1.05 * ideal)


@dataclass(frozen=True)
class Answer:
    """What was found for a design: the largest clearance for each limit alone and for both; and
    margins at clearances over the range, m."""

    design: Design
    alone: dict[str, cj.results.LargestFeasible]
    both: cj.results.LargestFeasible
    clearances: np.ndarray
    margins: dict[str, np.ndarray]


def solve(design: Design, count: int) -> Answer:
    """Search, and look at so many clearances of the range."""
    clearances = np.geomspace(*RANGE, count)
    alone = {name: design.largest([name]) for name in design.limits}
    both = design.largest(list(design.limits))
    return Answer(design, alone, both, clearances, design.margins(clearances))


def growth(design: Design, clearance: float) -> np.ndarray:
    """Largest derivative of the slider's position to the relative clearance in each revolution, in
    clearances."""
    run = design.run(clearance, design.instants(design.revolutions))
    turn = np.floor(run.times / design.period).astype(int)
    sizes = np.abs(run.derivatives["error"][:, 0]) / clearance
    return np.array([sizes[turn == k].max() for k in range(int(turn.max()))])
