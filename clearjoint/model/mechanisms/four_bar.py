"""The planar four-bar."""

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from ...fields.checks import require
from ...fields.types import TripleLike
from ...math.vectors import Scalar
from ..bodies import GROUND, Body, BodyState, State, body_state
from ..clearance_joints.clearance import ClearanceJoint
from ..contact.bristles import AbstractBristleFriction
from ..contact.friction import AbstractFriction
from ..contact.laws import AbstractContactLaw
from ..joints.base import AbstractConstraint, AbstractForce
from ..joints.ideal import InlineJoint, RevoluteJoint
from ..scene import Scene
from .common import Z_AXIS, Joints, steel_law, turned_about_z, with_motor

RODS = ("crank", "coupler", "rocker")
LENGTHS = (0.1, 0.3, 0.25, 0.3)
"""Of crank, coupler and rocker, and the distance of the feet, m."""
MASSES = (0.2, 0.4, 0.35)
"""Of crank, coupler and rocker, kg."""
PINS = {
    "crank foot": (GROUND, "crank"),
    "crank pin": ("crank", "coupler"),
    "rocker pin": ("coupler", "rocker"),
    "rocker foot": (GROUND, "rocker"),
}
"""The bodies of bearing and journal."""


def four_bar(
    clearance: Mapping[str, Scalar] = MappingProxyType({}),
    restitution: Scalar = 0.9,
    *,
    lengths: tuple[float, float, float, float] = LENGTHS,
    masses: tuple[float, float, float] = MASSES,
    angle: float = 0.9,
    speed: float = 0.0,
    motor: AbstractConstraint | AbstractForce | None = None,
    bearing_radius: Scalar = 10e-3,
    journal_length: Scalar = 20e-3,
    law: AbstractContactLaw | None = None,
    friction: AbstractFriction | AbstractBristleFriction | None = None,
    gravity: TripleLike | None = (0.0, -9.81, 0.0),
) -> tuple[Scene, State]:
    """A planar four-bar with clearance at any of its pins, and its state in the ideal pins' motion.

    A "crank" turns about Z in the origin, a "rocker" about Z on the X axis, and a "coupler" joins
    their ends. The rods are slender; about their own axes they have 1e-5 kg m^2, which does not
    enter the planar motion. The pins are "crank foot", "crank pin", "rocker pin" and "rocker foot",
    ideal `RevoluteJoint`s unless they have clearance; if none has, the "rocker pin" is an
    `InlineJoint`, so that no constraint is redundant.

    ```python
    import clearjoint as cj

    scene, state = cj.mechanisms.four_bar({"crank pin": 0.1e-3, "rocker foot": 0.2e-3})
    ```

    **Arguments:**

    - `clearance`: radial, m, by the pin's name.
    - `lengths`: of crank, coupler and rocker, and the distance of the feet, m.
    - `masses`: of crank, coupler and rocker, kg.
    - `angle`, `speed`: of the crank from the X axis at the start, rad and rad/s, with the other
      pin of the coupler above the line from the crank's to the rocker's foot. Journals start
      centred.
    - `motor`: what drives "crank" against "ground"; nothing unless given.
    - `bearing_radius`, `journal_length`: m. `gravity`: (3,) m/s^2.
    - `law` replaces Lankarani-Nikravesh with the given restitution.

    **Raises:** `ValueError` for a pin that there is not, and rods that do not meet at the angle.
    """
    for pin in clearance:
        remedy = "correct the name of the pin"
        require(pin in PINS, "clearance", pin, f"by the names {list(PINS)}", remedy)
    play = {
        "bearing_radius": bearing_radius,
        "journal_length": journal_length,
        "law": steel_law(restitution) if law is None else law,
        "friction": friction,
    }
    joints: Joints = {}
    for pin, pair in PINS.items():
        ends = _ends(pin, lengths)
        if pin in clearance:
            at = {"bearing_point": ends[0], "journal_point": ends[1]}
            joints[pin] = ClearanceJoint(*pair, **at, **play, clearance=clearance[pin])
        elif pin == "rocker pin" and not clearance:
            joints[pin] = InlineJoint(*pair, *ends, Z_AXIS)
        else:
            joints[pin] = RevoluteJoint(*pair, *ends, Z_AXIS, Z_AXIS)
    forces: dict[str, AbstractForce] = {}
    if motor is not None:
        joints, forces = with_motor(joints, motor)
    rods = zip(RODS, masses, lengths[:3], strict=True)
    bodies = {name: _rod(mass, length) for name, mass, length in rods}
    return Scene(bodies, joints, forces, gravity), _state(lengths, angle, speed)


def _rod(mass: float, length: float) -> Body:
    across = mass * length**2 / 12
    return Body(mass, (1e-5, across, across))


def _ends(pin: str, lengths: tuple[float, ...]) -> tuple[TripleLike, TripleLike]:
    """The places of a pin on its bodies, m."""
    crank, coupler, rocker, feet = lengths
    here, there = {
        "crank foot": (0.0, -0.5 * crank),
        "crank pin": (0.5 * crank, -0.5 * coupler),
        "rocker pin": (0.5 * coupler, 0.5 * rocker),
        "rocker foot": (feet, -0.5 * rocker),
    }[pin]
    return (here, 0.0, 0.0), (there, 0.0, 0.0)


def _state(lengths: tuple[float, ...], angle: float, speed: float) -> State:
    """The closed linkage at an angle, rad, and speed, rad/s, of the crank."""
    crank, coupler, rocker, feet = lengths
    foot = np.array([feet, 0.0])
    tip = crank * np.array([math.cos(angle), math.sin(angle)])
    pin = _meeting(tip, foot, coupler, rocker)
    along, arm = pin - tip, pin - foot
    tip_velocity = speed * _quarter_turned(tip)
    turns = np.stack([_quarter_turned(along), -_quarter_turned(arm)], axis=1)
    coupler_speed, rocker_speed = np.linalg.solve(turns, -tip_velocity)
    return State(
        {
            "crank": _moving(tip, 0.5 * tip, speed, 0.5 * tip_velocity),
            "coupler": _moving(
                along,
                0.5 * (tip + pin),
                coupler_speed,
                tip_velocity + 0.5 * coupler_speed * _quarter_turned(along),
            ),
            "rocker": _moving(
                arm, 0.5 * (foot + pin), rocker_speed, 0.5 * rocker_speed * _quarter_turned(arm)
            ),
        }
    )


def _meeting(tip: np.ndarray, foot: np.ndarray, coupler: float, rocker: float) -> np.ndarray:
    """The upper point at such distances from two points."""
    across = foot - tip
    reach = float(np.linalg.norm(across))
    along = (coupler**2 - rocker**2 + reach**2) / (2.0 * reach)
    height = coupler**2 - along**2
    reaching = f"rods that reach over the {reach:.6g} m from the crank to the rocker's foot"
    remedy = "choose another angle, or other lengths"
    require(height > 0.0, "lengths", (coupler, rocker), reaching, remedy)
    normal = _quarter_turned(across) / reach
    return tip + along * across / reach + math.sqrt(height) * normal


def _quarter_turned(vector: np.ndarray) -> np.ndarray:
    return np.array([-vector[1], vector[0]])


def _moving(along: np.ndarray, centre: np.ndarray, speed: float, velocity: np.ndarray) -> BodyState:
    """The state of a rod that lies along a vector of the plane."""
    turned = turned_about_z(math.atan2(along[1], along[0]))
    return body_state((*centre, 0.0), turned, (*velocity, 0.0), (0.0, 0.0, speed))
