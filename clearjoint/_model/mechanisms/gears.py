"""Spur gears with backlash, and the output stage of a cycloid drive."""

import math

import numpy as np

from ..._fields.cautions import quiet
from ..._fields.checks import as_number, require_count, require_positive, require_shape
from ..._math.vectors import Scalar
from ..bodies import GROUND, Body, State, body_state
from ..clearance_joints.clearance import ClearanceJoint
from ..clearance_joints.gear_backlash import GearBacklash
from ..contact.hunt_crossley import ExactRestitution, HuntCrossley
from ..contact.laws import AbstractContactLaw, GivenStiffness
from ..densities import STEEL
from ..drives.drivers import DriveTorque, PrescribedRotation
from ..joints.couplings import GearJoint
from ..joints.ideal import RevoluteJoint
from ..scene import Scene
from .common import ORIGIN, X_AXIS, Z_AXIS, Joints, turned_about_z

FACE_WIDTH = 20e-3
"""Width of the gears of `gear_pair`, m."""


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

    The "pinion" rotates about the Z axis, the "wheel" about a parallel axis through (m (z1 + z2)/2,
    0, 0) with the module m and the numbers of teeth z1 and z2. The pressure angle is 20 degrees.
    Both gears are solid steel discs of 20 mm width. There is no gravity and no drive: add a drive,
    such as a `DriveTorque`, to the scene's forces. The initial state is in the middle of the play.

    With the default law, teeth that approach at the speed v along the line of action rebound at the
    restitution times v. They cross the backlash j in the time j cos(20 degrees)/v. Under 2 kN, they
    yield by as much as with the mean mesh stiffness of ISO 6336, 20 N/(mm um).

    **Arguments:**

    - `backlash`: along the pitch circle, m.
    - `restitution`: of the default law, above 0 and at most 1; `law` replaces it.
    - `teeth`: numbers of teeth of the pinion and the wheel. `module`: m.
    - `speeds`: of the pinion and the wheel about Z at the start, rad/s.

    >>> scene, state = cj.mechanisms.gear_pair()
    >>> list(scene.joints)
    ['pinion bearing', 'wheel bearing', 'mesh']
    """
    for argument, pair in (("teeth", teeth), ("speeds", speeds)):
        remedy = "give one number for the pinion and one for the wheel"
        require_shape(argument, as_number(pair, argument), (2,), remedy)
    require_positive("module", module, "give it in m; 3 mm is 3e-3 m")
    # Radii of the pitch circles.
    radii = [0.5 * module * number for number in teeth]
    if law is None:
        # At a penetration of 5 um the force is 2 kN.
        law = ExactRestitution(restitution=restitution, stiffness=1.8e11)
    names, bodies, joints, states = ("pinion", "wheel"), {}, {}, {}
    for name, radius, x, speed in zip(names, radii, (0.0, sum(radii)), speeds, strict=True):
        # A solid disc of the width b: m (3 r^2 + b^2)/12 across the axis and m r^2/2 about it.
        mass = STEEL * math.pi * radius**2 * FACE_WIDTH
        across = mass * (3.0 * radius**2 + FACE_WIDTH**2) / 12.0
        bodies[name] = Body(mass, (across, across, 0.5 * mass * radius**2))
        centre = (x, 0.0, 0.0)
        joints[f"{name} bearing"] = RevoluteJoint(GROUND, name, centre, ORIGIN, Z_AXIS, Z_AXIS)
        states[name] = body_state(centre, spin=(0.0, 0.0, speed))
    joints["mesh"] = GearBacklash(
        *names, ORIGIN, ORIGIN, Z_AXIS, Z_AXIS, *teeth, module=module, backlash=backlash, law=law
    )
    return Scene(bodies, joints), State(states)


def cycloid_stage(
    play: Scalar = 0.02e-3,
    *,
    pins: int = 6,
    lobes: int = 10,
    eccentricity: Scalar = 1e-3,
    pitch_radius: Scalar = 25e-3,
    pin_radius: Scalar = 4e-3,
    speed: Scalar = 10.0,
    angle: float = 0.0,
    torque: Scalar = 0.0,
    law: AbstractContactLaw | None = None,
) -> tuple[Scene, State]:
    """Return the stage of a cycloid drive with play at its output pins, and its initial state.

    The "shaft" rotates about the Z axis at constant speed, and its eccentric carries the "disc",
    whose L lobes roll in a ring of L + 1 fixed ring pins: the disc rotates -1/L times as fast as
    the shaft. The meshing of lobes and ring pins is ideal, a `GearJoint` named "ring". The pins of
    the "output", on a circle of `pitch_radius`, are in holes of the disc. The radius of a hole is
    the pin's radius plus the eccentricity plus the play. Each pin and its hole form a joint, "pin
    1" and so on: a `ClearanceJoint` with the clearance eccentricity + play. There is no gravity.
    Sizes and masses are an example.

    While the output has the same angle as the disc, all pins are at the distance `play` from the
    walls of their holes. The output may rotate against the disc by about play/(pitch_radius cos(q))
    to either side. Here q is the angle between the motion of the first pin that touches its hole
    and the line from the disc's centre to the shaft's axis, at most pi/`pins`; one or two pins do
    not limit the rotation at all angles.

    **Arguments:**

    - `play`: radius of a hole, less the radius of a pin and less the eccentricity, m.
    - `pins`: number of output pins. `lobes`: number L of lobes of the disc.
    - `eccentricity`, `pitch_radius`, `pin_radius`: m.
    - `speed`, `angle`: of the shaft, rad/s, and rad at the start. The output begins with the angle
      and the speed of the disc.
    - `torque`: on the output about Z, N m.
    - `law`: of the contact of a pin with its hole at each of the pin's two ends; by default Hunt
      and Crossley's with the exponent 1, a restitution of 0.8 and a stiffness of 5e8 N/m. Both ends
      together are about as stiff as a line contact of 10 mm between steel parts.

    >>> scene, state = cj.mechanisms.cycloid_stage(pins=2)
    >>> list(scene.joints)
    ['shaft bearing', 'disc bearing', 'output bearing', 'ring', 'motor', 'pin 1', 'pin 2']
    """
    require_count("pins", pins, "give a number of pins")
    require_count("lobes", lobes, "give a number of lobes")
    eccentric = np.array(X_AXIS) * eccentricity
    joints: Joints = {
        "shaft bearing": RevoluteJoint(GROUND, "shaft", ORIGIN, ORIGIN, Z_AXIS, Z_AXIS),
        "disc bearing": RevoluteJoint("shaft", "disc", eccentric, ORIGIN, Z_AXIS, Z_AXIS),
        "output bearing": RevoluteJoint(GROUND, "output", ORIGIN, ORIGIN, Z_AXIS, Z_AXIS),
        # Seen from the shaft, the ring and the disc are a ring gear and a pinion inside it.
        "ring": GearJoint("shaft", GROUND, "disc", Z_AXIS, Z_AXIS, lobes + 1, lobes, internal=True),
        "motor": PrescribedRotation(GROUND, "shaft", Z_AXIS, speed, initial_angle=angle),
    }
    if law is None:
        # The force of a line contact is nearly proportional to the depth.
        law = HuntCrossley(restitution=0.8, stiffness=GivenStiffness(5e8), exponent=1.0)
    # Each clearance includes the eccentricity, and is therefore unusually large for a bearing.
    # `quiet` suppresses the warnings about it.
    with quiet():
        for k in range(pins):
            around = 2.0 * math.pi * k / pins
            point = np.array([math.cos(around), math.sin(around), 0.0]) * pitch_radius
            joints[f"pin {k + 1}"] = ClearanceJoint(
                "disc",
                "output",
                bearing_point=point,
                journal_point=point,
                bearing_radius=pin_radius + eccentricity + play,
                clearance=eccentricity + play,
                journal_length=10e-3,
                law=law,
            )
    bodies = {
        "shaft": Body(0.2, (2e-5, 2e-5, 1e-5)),
        "disc": Body(0.25, (6e-5, 6e-5, 1.2e-4)),
        "output": Body(0.4, (1.2e-4, 1.2e-4, 2e-4)),
    }
    axis, outwards = np.array([0.0, 0.0, 1.0]), np.array([math.cos(angle), math.sin(angle), 0.0])
    # The disc rotates -1/lobes times as fast as the shaft, and the output like the disc.
    orientation, spin = turned_about_z(-angle / lobes), axis * (-speed / lobes)
    centre = outwards * eccentricity
    velocity = np.cross(axis, outwards) * (eccentricity * speed)
    states = {
        "shaft": body_state(ORIGIN, turned_about_z(angle), spin=axis * speed),
        "disc": body_state(centre, orientation, velocity, spin),
        "output": body_state(ORIGIN, orientation, spin=spin),
    }
    forces = {"load": DriveTorque(GROUND, "output", Z_AXIS, torque)}
    return Scene(bodies, joints, forces), State(states)
