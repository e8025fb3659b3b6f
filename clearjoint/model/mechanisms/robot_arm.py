"""A robot arm with play in three joints."""

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
"""Angles of the nominal pose, rad."""
FLANK_RADIUS = 0.05
"""m."""
FLANK_STIFFNESS = 1e9
"""N/m^1.5: the elbow, at its load in the nominal pose, turns by half a mrad."""
FLANGE = Body(1e-3, (1e-6, 1e-6, 1e-6))
"""Of a gearbox: so light that it is the arm's that counts."""
GRAVITY = (0.0, 0.0, -9.81)
BEFORE = (GROUND, *LINKS[:2])
"""What carries each link."""
LUMPS = lumps()
NO_TURN = BASE.turn
Joints = dict[str, AbstractConstraint | AbstractContactJoint]


def robot_arm(
    play: Scalar | None = 1e-3,
    restitution: Scalar = 0.5,
    *,
    angles: tuple[float, float, float] = NOMINAL,
    speeds: tuple[float, float, float] = (0.0, 0.0, 0.0),
    law: AbstractContactLaw | None = None,
) -> tuple[Scene, State]:
    """The PUMA 560's waist, shoulder and elbow with backlash, and its state in their middle.

    Links by Corke and Armstrong-Helouvry's published parameters (ICRA 1994): upper arm and forearm
    0.4318 m long, of 17.4 kg and, with the wrist, 6.05 kg. The wrist is held as in the nominal pose
    (0, 45 deg, 180 deg; 0, 45 deg, 0), where gravity loads the joints with 0, 31.6399 and 6.0351
    N m (P. Corke, Robotics, Vision and Control). Gravity 9.81 along -Z, the first joint's axis.

    The motors are stiff: each turns the flange of its gearbox, "flange 1" to "flange 3" (1 g), as
    told (`PrescribedRotation` "motor 1" to "motor 3"), and the "play 1" to "play 3" lies between
    flange and link. Its angle, and the flanks' 1e9 N/m^1.5 at 50 mm, are ours. Hinges are
    "joint 1" to "joint 3", whose `JointAngle` is that of Denavit and Hartenberg.

    **Arguments:** `play` in rad, of all three joints, from flank to flank; ``None`` lets the motors
    turn the links themselves. `angles` and `speeds` of the motors at the start, rad and rad/s.
    `law` replaces one that delivers the restitution.

    >>> scene, state = cj.mechanisms.robot_arm(play=1e-3)
    >>> list(scene.bodies)
    ['link 1', 'link 2', 'link 3', 'flange 1', 'flange 2', 'flange 3']
    """
    if law is None:
        law = ExactRestitution(restitution=restitution, stiffness=FLANK_STIFFNESS)
    joints: Joints = {}
    bodies = {name: Body(lump.mass, lump.inertia) for name, lump in zip(LINKS, LUMPS, strict=True)}
    for k, (angle, speed) in enumerate(zip(angles, speeds, strict=True)):
        parent, flange = BEFORE[k], FLANGES[k]
        joints[f"joint {k + 1}"] = _hinge(k)
        if play is None:
            joints[f"motor {k + 1}"] = _motor(parent, LINKS[k], speed, angle, ARM[k].tilt())
            continue
        bodies[flange] = FLANGE
        joints[f"bearing {k + 1}"] = _flange_bearing(k)
        joints[f"motor {k + 1}"] = _motor(parent, flange, speed, angle, NO_TURN)
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
    """That of a link on the one before it."""
    on_link = ARM[k].joint() - LUMPS[k].centre
    return RevoluteJoint(BEFORE[k], LINKS[k], _foot(k), on_link, Z_AXIS, ARM[k].axis())


def _flange_bearing(k: int) -> RevoluteJoint:
    return RevoluteJoint(BEFORE[k], FLANGES[k], _foot(k), ORIGIN, Z_AXIS, Z_AXIS)


def _foot(k: int) -> Components:
    """Where a link stands on the one before it, m in its body axes."""
    return np.zeros(3) if k == 0 else -LUMPS[k - 1].centre
