"""A robot arm with backlash in three joints."""

import numpy as np

from ...math.vectors import EulerParameters, Scalar, pack
from ..bodies import GROUND, Body, State
from ..clearance_joints.backlash import Backlash
from ..contact.damping_factors import ExactRestitution
from ..contact.laws import AbstractContactLaw
from ..drives.rotation import PrescribedRotation
from ..joints.base import AbstractConstraint, AbstractContactJoint
from ..joints.ideal import RevoluteJoint
from ..scene import Scene
from .common import ORIGIN, Z_AXIS
from .puma_560 import ARM, BASE, FLANGES, LINKS, QUARTER, Components, arm_states, lumps

NOMINAL = (0.0, 0.5 * QUARTER, 2.0 * QUARTER)
"""Joint angles of the nominal pose, rad."""
FLANK_RADIUS = 0.05
"""Radius of the flanks, m."""
FLANK_STIFFNESS = 1e9
"""Stiffness of a flank, N/m^1.5: the load of the nominal pose rotates the elbow by half a mrad."""
FLANGE = Body(1e-3, (1e-6, 1e-6, 1e-6))
"""Flange of a gearbox, with negligible mass."""
GRAVITY = (0.0, 0.0, -9.81)
PARENTS = (GROUND, *LINKS[:2])
"""Parent of each link."""
LUMPS = lumps()
IDENTITY = BASE.orientation
Joints = dict[str, AbstractConstraint | AbstractContactJoint]


def robot_arm(
    play: Scalar | None = 1e-3,
    restitution: Scalar = 0.5,
    *,
    angles: tuple[float, float, float] = NOMINAL,
    speeds: tuple[float, float, float] = (0.0, 0.0, 0.0),
    law: AbstractContactLaw | None = None,
) -> tuple[Scene, State]:
    """Return waist, shoulder and elbow of the PUMA 560 with backlash, and the initial state.

    The links have the parameters published by Corke and Armstrong-Helouvry (ICRA 1994): upper arm
    and forearm are 0.4318 m long and have 17.4 kg and, with the wrist, 6.05 kg. The wrist is fixed
    as in the nominal pose (0, 45 deg, 180 deg; 0, 45 deg, 0), where gravity loads the joints with
    0, 31.6399 and 6.0351 N m (P. Corke, Robotics, Vision and Control). Gravity is 9.81 m/s^2 along
    -Z, the axis of the first joint.

    Each motor ("motor 1" to "motor 3", `PrescribedRotation`) prescribes the angle of its gearbox
    flange ("flange 1" to "flange 3", 1 g). The backlash ("play 1" to "play 3") is between flange
    and link; its angle and the flanks' stiffness of 1e9 N/m^1.5 at 50 mm are our choice. The hinges
    are "joint 1" to "joint 3"; their `JointAngle` is that of Denavit and Hartenberg.

    **Arguments:**

    - `play`: rad, from flank to flank, of all three joints; with ``None`` the motors drive the
      links directly.
    - `restitution`: of the default law.
    - `angles`, `speeds`: of the motors at the start, rad and rad/s.
    - `law`: replaces the default law.

    **Returns:** the scene and the initial state, in the middle of the play.

    >>> scene, state = cj.mechanisms.robot_arm(play=1e-3)
    >>> list(scene.bodies)
    ['link 1', 'link 2', 'link 3', 'flange 1', 'flange 2', 'flange 3']
    """
    if law is None:
        law = ExactRestitution(restitution=restitution, stiffness=FLANK_STIFFNESS)
    joints: Joints = {}
    bodies = {name: Body(lump.mass, lump.inertia) for name, lump in zip(LINKS, LUMPS, strict=True)}
    for k, (angle, speed) in enumerate(zip(angles, speeds, strict=True)):
        parent, flange = PARENTS[k], FLANGES[k]
        joints[f"joint {k + 1}"] = _hinge(k)
        if play is None:
            joints[f"motor {k + 1}"] = _motor(parent, LINKS[k], speed, angle, ARM[k].tilt())
            continue
        bodies[flange] = FLANGE
        joints[f"bearing {k + 1}"] = _flange_bearing(k)
        joints[f"motor {k + 1}"] = _motor(parent, flange, speed, angle, IDENTITY)
        axes = {"axis_first": Z_AXIS, "axis_second": ARM[k].axis()}
        joints[f"play {k + 1}"] = Backlash(
            flange, LINKS[k], **axes, play=play, radius=FLANK_RADIUS, law=law
        )
    states = arm_states(angles, speeds)
    return Scene(bodies, joints, gravity=GRAVITY), State({name: states[name] for name in bodies})


def _motor(
    first: str, second: str, speed: float, angle: float, zero: EulerParameters
) -> PrescribedRotation:
    return PrescribedRotation(first, second, Z_AXIS, speed, angle, np.asarray(pack(zero)))


def _hinge(k: int) -> RevoluteJoint:
    """Return the hinge between link k, counted from 0, and its parent."""
    on_link = ARM[k].joint() - LUMPS[k].centre
    return RevoluteJoint(PARENTS[k], LINKS[k], _foot(k), on_link, Z_AXIS, ARM[k].axis())


def _flange_bearing(k: int) -> RevoluteJoint:
    return RevoluteJoint(PARENTS[k], FLANGES[k], _foot(k), ORIGIN, Z_AXIS, Z_AXIS)


def _foot(k: int) -> Components:
    """Return the position of hinge k, counted from 0, on the parent, (3,) m in body axes."""
    return np.zeros(3) if k == 0 else -LUMPS[k - 1].centre
