"""The planar and the spatial four-bar linkage."""

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from ..._fields.checks import as_number, require, require_shape
from ..._fields.types import TripleLike
from ..._math.vectors import Scalar
from ..bodies import GROUND, Body, State, body_state
from ..clearance_joints.ball_in_socket import BallInSocket
from ..clearance_joints.clearance import ClearanceJoint
from ..contact.friction import FrictionLaw
from ..contact.laws import AbstractContactLaw
from ..joints.base import AbstractConstraint, AbstractForce
from ..joints.ideal import InlineJoint, RevoluteJoint, SphericalJoint
from ..scene import Scene
from .common import ORIGIN, X_AXIS, Y_AXIS, Z_AXIS, Joints, planar_state, steel_law, with_motor

RODS = ("crank", "coupler", "rocker")
LENGTHS, MASSES = (0.1, 0.3, 0.25, 0.3), (0.2, 0.4, 0.35)
"""Default lengths, m, and masses, kg, of `four_bar`."""
PINS = {
    "crank foot": (GROUND, "crank"),
    "crank pin": ("crank", "coupler"),
    "rocker pin": ("coupler", "rocker"),
    "rocker foot": (GROUND, "rocker"),
}
"""Pins of `four_bar` by name, each with the bodies of its bearing and its journal."""


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
    friction: FrictionLaw | None = None,
    gravity: TripleLike | None = (0.0, -9.81, 0.0),
) -> tuple[Scene, State]:
    """Return a planar four-bar linkage with clearance at any of its pins, and its initial state.

    A "crank" rotates about the Z axis, a "rocker" about a parallel axis through a point of the
    positive X axis, and a "coupler" joins their ends. The rods are slender; default lengths and
    masses are an example. The pins are "crank foot", "crank pin", "rocker pin" and "rocker foot".
    Pins without clearance are `RevoluteJoint`s; if no pin has clearance, the "rocker pin" is an
    `InlineJoint`, so that no constraint is redundant.

    **Arguments:**

    - `clearance`: radial, m, by the pin's name; pins that are not named are ideal.
    - `law`: normal law of the pins with clearance; by default that of Lankarani and Nikravesh for
      `STEEL` with the requested `restitution`.
    - `lengths`: of crank, coupler and rocker, and distance between the axes of crank and rocker, m.
    - `masses`: of crank, coupler and rocker, kg.
    - `angle`, `speed`: of the crank at the start, from the X axis, rad and rad/s. The "rocker pin"
      is on the left of the line from the crank pin to the rocker foot, seen from +Z. The state is
      that of the ideal mechanism, with centred journals.
    - `motor`: an element that drives "crank" relative to "ground"; none by default.
    - `bearing_radius`, `journal_length`, `friction`: of each pin with clearance, as in
      `ClearanceJoint`.
    - `gravity`: (3,) m/s^2, 9.81 along -Y by default; ``None`` for none.

    **Raises:** `ValueError` if `clearance` is not a mapping, such as a single number, or names an
    unknown pin; or if the rods can't be connected at the angle.

    >>> scene, state = cj.mechanisms.four_bar({"crank pin": 0.1e-3, "rocker foot": 0.2e-3})
    """
    remedy = 'pass for example {"crank pin": 0.1e-3}'
    require(isinstance(clearance, Mapping), "clearance", clearance, "by the pin's name", remedy)
    for pin in clearance:
        remedy = "correct the name of the pin"
        require(pin in PINS, "clearance", pin, f"by the names {list(PINS)}", remedy)
    counts = {"lengths": (lengths, (4,)), "masses": (masses, (3,)), "speed": (speed, ())}
    for argument, (value, shape) in {**counts, "angle": (angle, ())}.items():
        remedy = f"give {shape[0] if shape else 'one'} number(s) in SI units"
        require_shape(argument, as_number(value, argument), shape, remedy)
    options = {
        "bearing_radius": bearing_radius,
        "journal_length": journal_length,
        "law": steel_law(restitution) if law is None else law,
        "friction": friction,
    }
    # Coordinates of each pin along the rods of its bearing and its journal, from their centres. On
    # the ground they are along X, from the origin.
    crank, coupler, rocker, base = lengths
    places = {
        "crank foot": (0.0, -0.5 * crank),
        "crank pin": (0.5 * crank, -0.5 * coupler),
        "rocker pin": (0.5 * coupler, 0.5 * rocker),
        "rocker foot": (base, -0.5 * rocker),
    }
    joints: Joints = {}
    for pin, pair in PINS.items():
        on_first, on_second = ((along, 0.0, 0.0) for along in places[pin])
        if pin in clearance:
            at = {"bearing_point": on_first, "journal_point": on_second}
            joints[pin] = ClearanceJoint(*pair, **at, **options, clearance=clearance[pin])
        # Four ideal pins with five constraints each would close the loop with three redundant ones.
        # An inline joint, which only keeps a point on a line along Z, has two constraints.
        elif pin == "rocker pin" and not clearance:
            joints[pin] = InlineJoint(*pair, on_first, on_second, Z_AXIS)
        else:
            joints[pin] = RevoluteJoint(*pair, on_first, on_second, Z_AXIS, Z_AXIS)
    joints, forces = with_motor(joints, motor)
    bodies = {}
    for name, mass, length in zip(RODS, masses, lengths[:3], strict=True):
        across = mass * length**2 / 12
        # The moment about the rod's own axis has no effect on the planar motion.
        bodies[name] = Body(mass, (1e-5, across, across))
    return Scene(bodies, joints, forces, gravity), _state(lengths, angle, speed)


def _state(lengths: tuple[float, ...], angle: float, speed: float) -> State:
    """Return the state of the ideal planar linkage at an angle, rad, and a speed, rad/s, of the
    crank; `lengths` as in `four_bar`."""
    crank, coupler, rocker, base = lengths
    # In the XY plane: the rocker's fixed end, the crank's moving end, and the rocker pin.
    foot = np.array([base, 0.0])
    tip = crank * np.array([math.cos(angle), math.sin(angle)])
    pin = _intersection(tip, foot, coupler, rocker)
    # Vectors along the coupler, to the rocker pin, and along the rocker, from its axis.
    along, arm = pin - tip, pin - foot
    tip_velocity = speed * _perpendicular(tip)
    # Coupler and rocker have the same velocity at their common pin, which gives two equations for
    # their angular velocities w_c and w_r: tip velocity + w_c x along = w_r x arm.
    directions = np.stack([_perpendicular(along), -_perpendicular(arm)], axis=1)
    coupler_speed, rocker_speed = np.linalg.solve(directions, -tip_velocity)
    coupler_velocity = tip_velocity + 0.5 * coupler_speed * _perpendicular(along)
    rocker_velocity = 0.5 * rocker_speed * _perpendicular(arm)
    angles = [math.atan2(rod[1], rod[0]) for rod in (tip, along, arm)]
    states = {
        "crank": planar_state(0.5 * tip, angles[0], 0.5 * tip_velocity, speed),
        "coupler": planar_state(0.5 * (tip + pin), angles[1], coupler_velocity, coupler_speed),
        "rocker": planar_state(0.5 * (foot + pin), angles[2], rocker_velocity, rocker_speed),
    }
    return State(states)


def _intersection(tip: np.ndarray, foot: np.ndarray, coupler: float, rocker: float) -> np.ndarray:
    """Return the rocker pin, (2,) m: where circles of the radii `coupler` and `rocker` about `tip`
    and `foot` meet, to the left of the line from `tip` to `foot`."""
    across = foot - tip
    distance = float(np.linalg.norm(across))
    # The pin's coordinate along the line between the centres, and the square of the pin's distance
    # from this line. If the centres coincide, an infinite coordinate leads to the error below.
    along = (coupler**2 - rocker**2 + distance**2) / (2.0 * distance) if distance else math.inf
    squared_height = coupler**2 - along**2
    expected = f"rods that span the {distance:.6g} m from the crank pin to the rocker foot"
    remedy = "choose another angle, or other lengths"
    require(squared_height > 0.0, "lengths", (coupler, rocker), expected, remedy)
    normal = _perpendicular(across) / distance
    return tip + along * across / distance + math.sqrt(squared_height) * normal


def _perpendicular(vector: np.ndarray) -> np.ndarray:
    """Return a vector of the plane, (2,), rotated by a quarter of a revolution to the left."""
    return np.array([-vector[1], vector[0]])


CRANK, COUPLER, ROCKER = 0.02, 0.122, 0.074
"""Lengths of crank, coupler and rocker of `spatial_four_bar`, m."""
BAR_RADIUS = 10e-3
"""Radius of the round bars that define the moments of inertia of `spatial_four_bar`, m."""


def spatial_four_bar(
    clearance: Scalar | None = 0.2e-3,
    restitution: Scalar = 0.9,
    *,
    speed: Scalar = 0.0,
    law: AbstractContactLaw | None = None,
    friction: FrictionLaw | None = None,
) -> tuple[Scene, State]:
    """Return a spatial four-bar linkage with clearance between coupler and rocker, and its state.

    A crank of 20 mm rotates about the X axis at the origin, a rocker of 74 mm about a line parallel
    to Z through (122, -54, 0) mm. A coupler of 122 mm connects their ends by ball joints: an ideal
    one at the crank, the "crank ball", and one with clearance in a socket of 10 mm radius at the
    rocker, the "tip". The coupler rotates freely about its axis. Gravity is 9.81 m/s^2 along -Z.

    Lengths, masses and radii follow P. Flores et al., Dynamics of multibody systems with spherical
    clearance joints, 2006, but were not checked against the publication. The positions of the axes
    are our choice: at the start crank and rocker point along +Y, from their axes to the coupler,
    and the coupler lies along X. The crank can make full revolutions.

    **Arguments:**

    - `clearance`: radial, m; ``None`` for an ideal ball joint. The ball starts centred.
    - `law`: normal law of the ball; by default that of Lankarani and Nikravesh for `STEEL` with the
      requested `restitution`.
    - `speed`: of the crank at the start, rad/s. The state is that of the ideal mechanism.
    - `friction`: of the ball; none by default.

    >>> scene, state = cj.mechanisms.spatial_four_bar()
    >>> list(scene.joints)
    ['crank bearing', 'rocker bearing', 'crank ball', 'tip']
    """
    # The coupler lies along its x axis, crank and rocker along their y axes.
    coupler_end, rocker_end = (0.5 * COUPLER, 0.0, 0.0), (0.0, 0.5 * ROCKER, 0.0)
    if clearance is None:
        tip = SphericalJoint("rocker", "coupler", rocker_end, coupler_end)
    else:
        tip = BallInSocket(
            "rocker",
            "coupler",
            socket_point=rocker_end,
            ball_point=coupler_end,
            socket_radius=10e-3,
            clearance=clearance,
            law=steel_law(restitution) if law is None else law,
            friction=friction,
        )
    # At the start crank and rocker point along Y, and their ends at the coupler have the same Y.
    pivot = (COUPLER, CRANK - ROCKER, 0.0)
    crank_foot, crank_end = (0.0, -0.5 * CRANK, 0.0), (0.0, 0.5 * CRANK, 0.0)
    rocker_foot, coupler_start = (0.0, -0.5 * ROCKER, 0.0), (-0.5 * COUPLER, 0.0, 0.0)
    joints = {
        "crank bearing": RevoluteJoint(GROUND, "crank", ORIGIN, crank_foot, X_AXIS, X_AXIS),
        "rocker bearing": RevoluteJoint(GROUND, "rocker", pivot, rocker_foot, Z_AXIS, Z_AXIS),
        "crank ball": SphericalJoint("crank", "coupler", crank_end, coupler_start),
        "tip": tip,
    }
    bodies = {
        "crank": _bar(0.1960, CRANK, Y_AXIS),
        "coupler": _bar(1.4158, COUPLER, X_AXIS),
        "rocker": _bar(0.3157, ROCKER, Y_AXIS),
    }
    # The crank points along Y and rotates about X, so that its end moves along Z. The coupler
    # rotates about the rocker's end, which is at rest. The centres of crank and coupler move at
    # half the velocity of their common end.
    velocity = 0.5 * np.array([0.0, 0.0, CRANK]) * speed
    spin_crank = np.array([1.0, 0.0, 0.0]) * speed
    spin_coupler = np.array([0.0, CRANK / COUPLER, 0.0]) * speed
    states = {
        "crank": body_state((0.0, 0.5 * CRANK, 0.0), velocity=velocity, spin=spin_crank),
        "coupler": body_state((0.5 * COUPLER, CRANK, 0.0), velocity=velocity, spin=spin_coupler),
        "rocker": body_state((COUPLER, CRANK - 0.5 * ROCKER, 0.0)),
    }
    return Scene(bodies, joints, gravity=(0.0, 0.0, -9.81)), State(states)


def _bar(mass: float, length: float, axis: tuple[float, float, float]) -> Body:
    """Return a round bar along a unit vector of the body's axes, with the radius `BAR_RADIUS`."""
    along = 0.5 * mass * BAR_RADIUS**2
    across = mass * (length**2 / 12.0 + 0.25 * BAR_RADIUS**2)
    return Body(mass, np.where(np.array(axis) == 1.0, along, across))
