"""Two spur gears on ideal bearings, with backlash."""

import math

from ...math.vectors import Scalar
from ..bodies import GROUND, Body, State, body_state
from ..clearance_joints.gear_backlash import GearBacklash
from ..contact.damping_factors import ExactRestitution
from ..contact.laws import AbstractContactLaw
from ..joints.ideal import RevoluteJoint
from ..scene import Scene
from .common import ORIGIN, Z_AXIS

DENSITY = 7850.0
"""Density of steel, kg/m^3."""
FACE_WIDTH = 20e-3
"""Width of the gears, m."""
MESH_STIFFNESS = 1.8e11
"""Stiffness K of the mesh, N/m^1.5. At a depth of 5 um the force K depth^1.5 is 2 kN, that of the
mean stiffness 20 N/(mm um) of ISO 6336-1 for steel on the width of the gears."""


def gear_pair(
    backlash: Scalar = 0.1e-3,
    restitution: Scalar = 0.8,
    *,
    teeth: tuple[int, int] = (20, 50),
    module: float = 3e-3,
    speeds: tuple[float, float] = (10.0, 0.0),
    law: AbstractContactLaw | None = None,
) -> tuple[Scene, State]:
    """Return two spur gears with backlash on ideal bearings, and their initial state.

    The "pinion" rotates about Z in the origin, the "wheel" in (m (z1 + z2)/2, 0, 0) for the module
    m and the numbers of teeth z1 and z2; the pressure angle is 20 degrees. Both are solid steel
    discs, 7850 kg/m^3, with the diameter of their pitch circles and 20 mm width. There is no drive:
    add one to the scene's forces, such as a `DriveTorque`.

    The default law has the stiffness 1.8e11 N/m^1.5, whose deflection at 2 kN is that of ISO 6336's
    mean stiffness of 20 N/(mm um), and free impacts have exactly the given restitution. If the
    teeth cross the backlash j at a speed v along the line of action, which takes the time j cos(20
    degrees)/v, they rebound at the restitution times v.

    **Arguments:**

    - `backlash`: along the pitch circle, m.
    - `restitution`: of the default law, above 0 and at most 1.
    - `teeth`: numbers of teeth of the pinion and the wheel.
    - `module`: m.
    - `speeds`: of the pinion and the wheel about Z at the start, rad/s.
    - `law`: replaces the default law.

    **Returns:** the scene and the initial state, in the middle of the play.

    **Raises:** `ValueError` if a value is outside its range.

    >>> scene, state = cj.mechanisms.gear_pair()
    >>> list(scene.joints)
    ['pinion bearing', 'wheel bearing', 'mesh']
    """
    # Radii of the pitch circles.
    first, second = (0.5 * module * number for number in teeth)
    if law is None:
        law = ExactRestitution(restitution=restitution, stiffness=MESH_STIFFNESS)
    names, centres = ("pinion", "wheel"), (ORIGIN, (first + second, 0.0, 0.0))
    bodies = {name: _disc(radius) for name, radius in zip(names, (first, second), strict=True)}
    bearings = {
        f"{name} bearing": RevoluteJoint(GROUND, name, centre, ORIGIN, Z_AXIS, Z_AXIS)
        for name, centre in zip(names, centres, strict=True)
    }
    mesh = GearBacklash(*names, ORIGIN, ORIGIN, Z_AXIS, Z_AXIS, *teeth, module, backlash, law)
    states = {
        name: body_state(centre, spin=(0.0, 0.0, speed))
        for name, centre, speed in zip(names, centres, speeds, strict=True)
    }
    return Scene(bodies, {**bearings, "mesh": mesh}), State(states)


def _disc(radius: float) -> Body:
    """Return a steel disc about Z from its radius, m."""
    mass = DENSITY * math.pi * radius**2 * FACE_WIDTH
    across = mass * (3.0 * radius**2 + FACE_WIDTH**2) / 12.0
    return Body(mass, (across, across, 0.5 * mass * radius**2))
