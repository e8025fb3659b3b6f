"""Families of random extreme scenes: one structure each, with numbers drawn over many decades.

Ranges: radial clearance 1 nm to 5 mm, stiffness 1e3 to 1e14 N/m^1.5, restitution 0 to 1 with both
ends, entry speed 1e-9 to 100 m/s, journals of a thousandth of the radius to 100 radii, mass ratios
1e-6 to 1e6, friction 0 to 2, crank speeds 1 to 60 000 rpm.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import equinox as eqx
import numpy as np
from scipy.stats import qmc

import clearjoint as cj

RADIUS = 10e-3
"""Radius of all bearings, m."""

GRAVITY = (0.0, -9.81, 0.0)

LOGARITHMIC = {
    "clearance": (1e-9, 5e-3),
    "stiffness": (1e3, 1e14),
    "speed": (1e-9, 1e2),
    "length": (1e-3 * RADIUS, 1e2 * RADIUS),
    "mass": (1e-3, 1e3),
    "mass_ratio": (1e-6, 1e6),
    "crank_speed": (np.pi / 30.0, 60_000.0 * np.pi / 30.0),
}
"""Ranges drawn uniformly in the logarithm, SI units."""

LINEAR = {"restitution": (-0.1, 1.1), "friction": (-0.2, 2.2), "eccentricity": (0.0, 1.3)}
"""Ranges drawn uniformly. Restitution and friction are clipped to their limits, so that some scenes
have a limit as value. The eccentricity is in clearances, so that a quarter of the scenes begins
in contact.
"""

CLIPPED = {"restitution": (0.0, 1.0), "friction": (0.0, 2.0)}

TURNS = ("heading", "tilt", "spin_x", "spin_y", "spin_z")

NAMES = (*LOGARITHMIC, *LINEAR, *TURNS)

Draw = dict[str, float]

CRAWL, CRAWLING = 1e-4, 1e-16
"""Speed below which a motion without gravity gets another absolute tolerance, m/s, and that
tolerance: the default, a hundred-thousandth of the relative one in m and m/s, is large for such
speeds.
"""


def draws(count: int, seed: int) -> list[Draw]:
    """Return points of a scrambled Sobol sequence over all ranges."""
    exponent = int(np.ceil(np.log2(count)))
    unit = qmc.Sobol(len(NAMES), rng=seed).random_base2(exponent)[:count]
    return [_scaled(dict(zip(NAMES, row, strict=True))) for row in unit]


def _scaled(row: Draw) -> Draw:
    found = {}
    for name, (low, high) in LOGARITHMIC.items():
        found[name] = float(low * (high / low) ** row[name])
    for name, (low, high) in LINEAR.items():
        value = low + (high - low) * row[name]
        found[name] = float(np.clip(value, *CLIPPED.get(name, (low, high))))
    return found | {name: row[name] for name in TURNS}


@dataclass(frozen=True)
class Family:
    """Scenes of one structure.

    - `make`: function that returns scene and state of a draw.
    - `end_time`: function that returns the end of the run, s.
    - `free`: whether no joint holds the bodies, so that momentum is conserved.
    - `outputs`: outputs of the sweep in addition to the ledger.
    - `coordinates`: coordinates of the run.
    """

    make: Callable[[Draw], tuple[cj.Scene, cj.State]]
    end_time: Callable[[Draw], float]
    free: bool = False
    outputs: Mapping[str, cj.extend.AbstractReduction] = field(default_factory=dict)
    coordinates: cj.JointCoordinates | cj.AbsoluteCoordinates = cj.JointCoordinates()

    def trial(self, draw: Draw) -> "Trial":
        """Return the trial of a draw."""
        scene, state = self.make(draw)
        crawls = scene.gravity is None and draw["speed"] < CRAWL
        return Trial(scene, state, self.end_time(draw), CRAWLING if crawls else None)


@dataclass(frozen=True)
class Trial:
    """A scene, its initial state, the end of the run, s, and its absolute tolerance, or ``None``
    for the default.
    """

    scene: cj.Scene
    state: cj.State
    end_time: float
    atol: float | None = None


def _heading(draw: Draw) -> np.ndarray:
    angle = 2 * np.pi * draw["heading"]
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def _spin(draw: Draw) -> np.ndarray:
    """Return a spin as fast at the bearing's wall as the body, rad/s."""
    parts = np.array([draw[name] for name in ("spin_x", "spin_y", "spin_z")])
    return (2 * parts - 1) * draw["speed"] / RADIUS


def _orientation(draw: Draw) -> np.ndarray:
    """Return the Euler parameters of a tilt about X, small if a long journal leaves no room for
    more.
    """
    room = min(1.0, draw["clearance"] / draw["length"])
    half = 0.5 * room * (draw["tilt"] - 0.5)
    return np.array([np.cos(half), np.sin(half), 0.0, 0.0])


def _block(mass: float) -> cj.Body:
    """Return a cube as wide as the bearing."""
    return cj.Body(mass, [mass * RADIUS**2 / 6] * 3)


def _joint(draw: Draw, law: Any, bearing: str, **options: Any) -> cj.ClearanceJoint:
    return cj.ClearanceJoint(
        bearing,
        "journal",
        bearing_radius=RADIUS,
        clearance=draw["clearance"],
        journal_length=draw["length"],
        law=law,
        **options,
    )


def _start(draw: Draw) -> cj.BodyState:
    """Return a state off the centre along the heading, moving along it and slightly across."""
    heading = _heading(draw)
    across = np.array([-heading[1], heading[0], 0.0])
    velocity = draw["speed"] * (heading + 0.3 * (draw["tilt"] - 0.5) * across)
    position = draw["eccentricity"] * draw["clearance"] * heading
    return cj.body_state(position, _orientation(draw), velocity, _spin(draw))


def contact_time(draw: Draw, mass: float) -> float:
    """Return the duration of a free elastic impact, s: 3.218 (m^2/(K^2 v))^(1/5)."""
    return 3.218 * (mass**2 / (draw["stiffness"] ** 2 * draw["speed"])) ** 0.2


def _some_impacts(draw: Draw, mass: float, gravity: float) -> float:
    """Return the time of three crossings of the bearing and five contacts, s."""
    crossing = 2 * draw["clearance"] / draw["speed"]
    if gravity:
        crossing = min(crossing, np.sqrt(4 * draw["clearance"] / gravity))
    return float(3 * crossing + 5 * contact_time(draw, mass))


def _damping(draw: Draw) -> dict[str, Any]:
    return {"restitution": draw["restitution"], "stiffness": draw["stiffness"]}


def _free_pair(draw: Draw) -> tuple[cj.Scene, cj.State]:
    law = cj.laws.LankaraniNikravesh(**_damping(draw))
    friction = cj.frictions.Ambrosio(draw["friction"])
    bodies = {"bearing": _block(1.0), "journal": _block(draw["mass_ratio"])}
    scene = cj.Scene(bodies, {"pin": _joint(draw, law, "bearing", friction=friction)})
    return scene, cj.State({"bearing": cj.body_state((0, 0, 0)), "journal": _start(draw)})


def _reduced_mass(draw: Draw) -> float:
    return draw["mass_ratio"] / (1 + draw["mass_ratio"])


def _journal(draw: Draw) -> tuple[cj.Scene, cj.State]:
    law = cj.laws.HuntCrossley(**_damping(draw))
    joint = _joint(draw, law, "ground", friction=cj.frictions.RegularisedCoulomb(draw["friction"]))
    scene = cj.Scene({"journal": _block(draw["mass"])}, {"pin": joint}, gravity=GRAVITY)
    return scene, cj.State({"journal": _start(draw)})


def _end_play(draw: Draw) -> tuple[cj.Scene, cj.State]:
    law = cj.laws.Flores2011(**_damping(draw | {"restitution": max(draw["restitution"], 0.01)}))
    shoulder = cj.laws.LankaraniNikravesh(**_damping(draw))
    axial = cj.EndPlay(draw["clearance"], shoulder)
    joint = _joint(draw, law, "ground", axial=axial)
    gravity = (0.0, -9.81, 3.0)
    scene = cj.Scene({"journal": _block(draw["mass"])}, {"pin": joint}, gravity=gravity)
    return scene, cj.State({"journal": _start(draw)})


def _thrown(draw: Draw) -> tuple[cj.Scene, cj.State]:
    law = cj.laws.LankaraniNikravesh(**_damping(draw))
    joint = _joint(draw, law, "ground")
    scene = cj.Scene({"journal": _block(draw["mass"])}, {"pin": joint})
    return scene, cj.State({"journal": _start(draw)})


ARM = 1.0


def _pendulum(draw: Draw) -> tuple[cj.Scene, cj.State]:
    mass = draw["mass"]
    joint = _joint(
        draw, cj.laws.Hertz(stiffness=cj.laws.RavnStiffness(draw["stiffness"], 0.3)), "ground"
    )
    joint = eqx.tree_at(lambda j: j.journal_point, joint, np.array([-0.5 * ARM, 0.0, 0.0]))
    inertia = mass * ARM**2 / 12 * np.array([1e-2, 1.0, 1.0])
    scene = cj.Scene({"journal": cj.Body(mass, inertia)}, {"pin": joint}, gravity=GRAVITY)
    position = 0.5 * ARM * np.array([1.0, 0, 0]) + min(1.0, draw["eccentricity"]) * draw[
        "clearance"
    ] * _heading(draw)
    spin = np.array([0.0, 0.0, 1.0]) * draw["speed"] / ARM
    velocity = np.array([0.0, 0.5 * draw["speed"], 0.0])
    return scene, cj.State({"journal": cj.body_state(position, velocity=velocity, spin=spin)})


def _fall(draw: Draw, mass: float) -> float:
    """Return the time of three falls across the bearing and five contacts at the speed of a fall,
    s.
    """
    speed = max(np.sqrt(2 * 9.81 * draw["clearance"]), 1e-6)
    falling = draw | {"speed": speed}
    return float(3 * np.sqrt(4 * draw["clearance"] / 9.81) + 5 * contact_time(falling, mass))


def _double_pendulum(draw: Draw) -> tuple[cj.Scene, cj.State]:
    scene, state = cj.mechanisms.double_pendulum(
        draw["clearance"],
        journal_length=draw["length"],
        law=cj.laws.LankaraniNikravesh(**_damping(draw)),
        axial=cj.FixedAxially(),
    )
    ratio = draw["mass_ratio"]
    arm = scene.bodies["arm 3"]
    bodies = {**scene.bodies, "arm 3": cj.Body(arm.mass * ratio, arm.inertia * ratio)}
    return cj.Scene(bodies, scene.joints, gravity=scene.gravity), state


def _slider_crank(draw: Draw) -> tuple[cj.Scene, cj.State]:
    return cj.mechanisms.slider_crank(
        draw["clearance"],
        speed=draw["crank_speed"],
        angle=2 * np.pi * draw["heading"],
        journal_length=draw["length"],
        law=cj.laws.LankaraniNikravesh(**_damping(draw)),
        friction=cj.frictions.RegularisedCoulomb(draw["friction"]),
    )


def _backwards(now: Any) -> Any:
    """Return the speed of the journal against its heading along X, m/s."""
    return -now.motions["journal"].velocity.x


FAMILIES = {
    "thrown journal": Family(
        _thrown,
        lambda d: _some_impacts(d, d["mass"], 0.0),
        outputs={
            "rebound": cj.Peak(_backwards, "m/s"),
            "depth": cj.Peak(cj.quantities.Penetration("pin", "V"), "m"),
        },
    ),
    "free pair": Family(_free_pair, lambda d: _some_impacts(d, _reduced_mass(d), 0.0), free=True),
    "journal": Family(_journal, lambda d: _some_impacts(d, d["mass"], 9.81)),
    "end play": Family(_end_play, lambda d: _some_impacts(d, d["mass"], 9.81)),
    "pendulum": Family(_pendulum, lambda d: _fall(d, d["mass"])),
    "double pendulum": Family(
        _double_pendulum,
        lambda d: _fall(d, 7.02),
        coordinates=cj.AbsoluteCoordinates(),
    ),
    "slider-crank": Family(_slider_crank, lambda d: 2 * np.pi / d["crank_speed"]),
}
