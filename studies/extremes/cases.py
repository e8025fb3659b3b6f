"""Cases that vary one number over its range, where the answer is known in closed form.

Each case varies one number of a draw of a family; its scenes run in the batch of the family,
together with the random ones.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import clearjoint as cj
from studies.extremes.families import FAMILIES, RADIUS, Draw, Trial, contact_time
from studies.extremes.invariants import LONG, Poses

BASE: Draw = {
    "clearance": 0.5e-3,
    "stiffness": 6.61e10,
    "speed": 0.1,
    "length": 2 * RADIUS,
    "mass": 1.0,
    "mass_ratio": 1.0,
    "crank_speed": 100 * np.pi,
    "restitution": 0.9,
    "friction": 0.0,
    "eccentricity": 0.0,
    "heading": 0.0,
    "tilt": 0.5,
    "spin_x": 0.5,
    "spin_y": 0.5,
    "spin_z": 0.5,
}
"""The paper's steel journal, thrown at the wall along X."""

FLOOR = 1e-6
"""Floor of the entry speed, m/s: the default of the laws."""

GRAVITY = 9.81

BOUND = 1e-4
"""Largest relative error of a case, unless it states another."""


@dataclass(frozen=True)
class Case:
    """Values of one number over its range.

    - `family`: family of the scenes.
    - `unit`, `values`: values as they are shown.
    - `trial`: function that returns the scene of a value.
    - `error`: function that returns the relative error of an outcome against the closed form named
      in `check`. An outcome contains the outputs of the family's sweep, the final state as "poses",
      and the relative energy error.
    - `bound`: largest allowed error.
    """

    name: str
    family: str
    unit: str
    values: tuple[float, ...]
    check: str
    bound: float
    trial: Callable[[float], Trial]
    error: Callable[[float, Any], float]


def decades(low: float, high: float, count: int) -> tuple[float, ...]:
    """Return values evenly spaced in the logarithm, rounded to be readable."""
    return tuple(float(f"{value:.1e}") for value in np.geomspace(low, high, count))


def damping_factor(restitution: float) -> Any:
    """Return the factor chi of Lankarani and Nikravesh."""
    return LONG(3) * (1 - LONG(restitution) ** 2) / 4


def delivered(chi: Any) -> Any:
    """Return the e that solves chi (1 + e) = ln[(1 + chi)/(1 - chi e)], by bisection in extended
    precision.
    """
    if chi < 1e-9:
        return 1 - 2 * chi / 3
    low, high = LONG(0), min(LONG(1), (1 - LONG(1e-18)) / chi)
    for _ in range(80):
        middle = (low + high) / 2
        above = chi * (1 + middle) - np.log1p(chi) + np.log1p(-chi * middle) > 0
        low, high = (middle, high) if above else (low, middle)
    return low


def greatest_depth(chi: Any, mass: float, stiffness: float, speed: float) -> Any:
    """Return the largest penetration of a free impact with exponent 1.5, m."""
    scale = (LONG(mass) * LONG(speed) ** 2 / LONG(stiffness)) ** LONG(0.4)
    shape = LONG(0.5) if chi < 1e-6 else (chi - np.log1p(chi)) / chi**2
    return scale * (LONG(2.5) * shape) ** LONG(0.4)


def thrown(draw: Draw) -> Trial:
    """Return a trial with one impact."""
    trial = FAMILIES["thrown journal"].trial(draw)
    both = draw | {"stiffness": 2 * draw["stiffness"]}
    flight = draw["clearance"] / draw["speed"]
    return replace(trial, end_time=flight + 1.5 * contact_time(both, draw["mass"]))


def thrown_error(draw: Draw, outcome: Any) -> float:
    """Return the larger relative error of rebound speed and largest penetration."""
    speed = LONG(draw["speed"])
    chi = damping_factor(draw["restitution"]) * speed / max(speed, LONG(FLOOR))
    depth = greatest_depth(chi, draw["mass"], 2 * draw["stiffness"], draw["speed"])
    rebound = outcome["rebound"] / (delivered(chi) * speed) - 1
    return float(max(abs(rebound), abs(outcome["depth"] / depth - 1)))


def thrown_case(name: str, key: str, unit: str, values: Any, scale: float = 1.0) -> Case:
    """Return the case of a thrown journal with one number of the draw varied."""

    def draw(value: float) -> Draw:
        return BASE | {key: value * scale}

    return Case(
        name,
        "thrown journal",
        unit,
        tuple(values),
        "restitution identity, depth",
        BOUND,
        lambda value: thrown(draw(value)),
        lambda value, outcome: thrown_error(draw(value), outcome),
    )


def _deep(value: float) -> Trial:
    """Return a trial at rest with a penetration of `value` journal radii."""
    depth = value * (RADIUS - BASE["clearance"])
    draw = BASE | {"eccentricity": 1 + depth / BASE["clearance"], "speed": 1e-30}
    trial = FAMILIES["thrown journal"].trial(draw)
    return replace(trial, end_time=2.0 * depth / float(_release(depth)), atol=None)


def _release(depth: float) -> Any:
    """Return the speed of an elastic release from rest, m/s."""
    energy = 2 * LONG(BASE["stiffness"]) * LONG(depth) ** LONG(2.5) / LONG(2.5)
    return np.sqrt(2 * energy / LONG(BASE["mass"]))


def _deep_error(value: float, outcome: Any) -> float:
    speed = _release(value * (RADIUS - BASE["clearance"]))
    return float(abs(outcome["rebound"] / speed - 1))


def _tilted(value: float) -> Trial:
    """Return a centred trial at rest, tilted in the bearing by degrees; four radii long."""
    draw = BASE | {"length": 4 * RADIUS, "speed": 1e-30}
    trial = FAMILIES["thrown journal"].trial(draw)
    half = np.deg2rad(value) / 2
    turned = cj.body_state((0, 0, 0), (np.cos(half), np.sin(half), 0, 0))
    return Trial(trial.scene, cj.State({"journal": turned}), 1e-3)


def _ledger(value: float, outcome: Any) -> float:
    """Return the energy error over the energy exchanged."""
    del value
    return outcome["ledger"]


def _pair(value: float) -> Trial:
    draw = BASE | {"mass_ratio": value, "friction": 0.0}
    trial = FAMILIES["free pair"].trial(draw)
    both = draw | {"stiffness": 2 * draw["stiffness"]}
    flight = draw["clearance"] / draw["speed"]
    return replace(trial, end_time=flight + 1.5 * contact_time(both, value / (1 + value)))


def _pair_error(value: float, outcome: Any) -> float:
    """Return the error of the relative speed after the impact."""
    at: Poses = outcome["poses"]
    parting = at["bearing"].velocity[0] - at["journal"].velocity[0]
    wanted = delivered(damping_factor(BASE["restitution"])) * LONG(BASE["speed"])
    return float(abs(parting / wanted - 1))


def _chattering(value: float) -> Trial:
    """Return a trial dropped from the centre, long enough that a rigid body with a restitution of
    up to 0.95 would have bounced infinitely often.
    """
    draw = BASE | {"restitution": value, "speed": 1e-30, "heading": 0.75}
    return replace(FAMILIES["journal"].trial(draw), end_time=1.0)


def _static_depth() -> Any:
    return (LONG(BASE["mass"]) * LONG(GRAVITY) / (2 * LONG(BASE["stiffness"]))) ** (LONG(2) / 3)


def _chattering_error(value: float, outcome: Any) -> float:
    """Return the distance from rest at the static depth, in fall heights (one clearance)."""
    del value
    height = -outcome["poses"]["journal"].position[1] - LONG(BASE["clearance"])
    return float(abs(height - _static_depth()) / LONG(BASE["clearance"]))


SLIDING_SPEED, SLIDING_TIME, REGULARISATION = 0.1, 0.02, 1e-3


def _sliding(value: float) -> Trial:
    """Return a trial at the static depth that slides along the bearing, with too much inertia to
    tip.
    """
    trial = FAMILIES["journal"].trial(BASE | {"friction": value})
    position = (0.0, -float(BASE["clearance"] + _static_depth()), 0.0)
    state = cj.State({"journal": cj.body_state(position, velocity=(0, 0, SLIDING_SPEED))})
    bodies = {"journal": cj.Body(BASE["mass"], [1e6] * 3)}
    scene = cj.Scene(bodies, trial.scene.joints, gravity=trial.scene.gravity)
    return Trial(scene, state, SLIDING_TIME)


def _sliding_error(value: float, outcome: Any) -> float:
    """Return the error of the speed: v' = -mu g tanh(v/v_d) has the solution sinh(v/v_d) =
    sinh(v_0/v_d) exp(-mu g t/v_d).
    """
    reach = LONG(SLIDING_SPEED) / LONG(REGULARISATION)
    fallen = LONG(value) * LONG(GRAVITY) * LONG(SLIDING_TIME) / LONG(REGULARISATION)
    speed = LONG(REGULARISATION) * np.arcsinh(np.sinh(reach) * np.exp(-fallen))
    found = outcome["poses"]["journal"].velocity[2]
    return float(abs(found - speed) / LONG(SLIDING_SPEED))


RPM = np.pi / 30


def _crank(value: float) -> Trial:
    return FAMILIES["slider-crank"].trial(BASE | {"crank_speed": value * RPM, "heading": 0.0})


def _crank_error(value: float, outcome: Any) -> float:
    """Return the error of the crank's angle after a revolution, rad."""
    del value
    w, _, _, z = outcome["poses"]["crank"].orientation
    angle = 2 * np.arctan2(z, w)
    return float(abs(np.remainder(angle + np.pi, 2 * np.pi) - np.pi))


CASES = (
    thrown_case("clearance", "clearance", "m", decades(1e-9, 5e-3, 8)),
    thrown_case("stiffness", "stiffness", "N/m^1.5", decades(1e3, 1e14, 12)),
    thrown_case("restitution", "restitution", "1", (0.0, 1e-3, 0.1, 0.5, 0.9, 0.999, 1.0)),
    thrown_case("entry speed", "speed", "m/s", decades(1e-9, 1e2, 12)),
    thrown_case("journal's length", "length", "radii", decades(1e-3, 1e2, 6), RADIUS),
    thrown_case("mass", "mass", "kg", decades(1e-6, 1e6, 7)),
    Case(
        "deep start",
        "thrown journal",
        "journal radii",
        (1e-9, 1e-6, 1e-3, 0.1, 0.5, 0.9, 1.1, 10.0),
        "energy released",
        BOUND,
        _deep,
        _deep_error,
    ),
    Case(
        "tilted journal",
        "thrown journal",
        "degrees",
        (0.0, 1e-6, 1.0, 5.0, 20.0, 30.0, 45.0, 90.0),
        "ledger",
        BOUND,
        _tilted,
        _ledger,
    ),
    Case(
        "mass ratio",
        "free pair",
        "1",
        decades(1e-6, 1e6, 7),
        "restitution identity",
        BOUND,
        _pair,
        _pair_error,
    ),
    Case(
        "chattering to rest",
        "journal",
        "restitution",
        (0.0, 0.1, 0.5, 0.8, 0.9),
        "static depth",
        BOUND,
        _chattering,
        _chattering_error,
    ),
    Case(
        "friction",
        "journal",
        "1",
        (0.0, 1e-3, 0.1, 0.5, 1.0, 2.0),
        "sliding block",
        BOUND,
        _sliding,
        _sliding_error,
    ),
    Case(
        "crank speed",
        "slider-crank",
        "rpm",
        (1.0, 10.0, 100.0, 1e3, 5e3, 1e4, 3e4, 6e4),
        "crank's angle, ledger",
        BOUND,
        _crank,
        _crank_error,
    ),
)
