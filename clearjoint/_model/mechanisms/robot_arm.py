"""A robot arm, the first three links of the PUMA 560, with backlash in its joints."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from ..._fields.checks import as_number, require_shape
from ..._math.rotations import composed, rotation_matrix
from ..._math.vectors import EulerParameters, Scalar, pack
from ..bodies import GROUND, Body, BodyState, State, body_state
from ..clearance_joints.backlash import Backlash
from ..contact.hunt_crossley import ExactRestitution
from ..contact.laws import AbstractContactLaw
from ..drives.drivers import PrescribedRotation
from ..joints.ideal import RevoluteJoint
from ..scene import Scene
from .common import ORIGIN, Z_AXIS, Joints, turned_about_z

Components: TypeAlias = Float[np.ndarray, "3"]


@dataclass(frozen=True)
class ArmLink:
    """A link: its standard Denavit-Hartenberg parameters, its mass, kg, and its inertia, kg m^2.

    The frame of the link is at its far end. It is the parent's frame after a rotation about the z
    axis by the joint's angle, translations by `offset` d along this axis and by `length` a along
    the new x axis, and a rotation about the new x axis by `twist` alpha. `centre` of mass and the
    principal moments `inertia` about it are in this frame.
    """

    offset: float
    length: float
    twist: float
    mass: float
    centre: tuple[float, float, float]
    inertia: tuple[float, float, float]

    def tilt(self) -> EulerParameters:
        """Return the orientation of the link's frame in the parent's frame at joint angle zero."""
        return EulerParameters(math.cos(0.5 * self.twist), math.sin(0.5 * self.twist), 0.0, 0.0)

    def axis(self) -> Components:
        """Return the link's axis of rotation, a unit vector (3,) in the link's frame."""
        return np.array([0.0, math.sin(self.twist), math.cos(self.twist)])

    def joint(self) -> Components:
        """Return the position of the link's joint, (3,) m in the link's frame."""
        return -np.array([self.length, 0.0, 0.0]) - self.offset * self.axis()


LINKS = ("link 1", "link 2", "link 3")
FLANGES = ("flange 1", "flange 2", "flange 3")
QUARTER = 0.5 * math.pi
ARM = (
    ArmLink(0.0, 0.0, QUARTER, 13.0, (0.0, 0.0, 0.0), (0.2, 0.35, 0.2)),
    ArmLink(0.0, 0.4318, 0.0, 17.4, (-0.3638, 0.006, 0.2275), (0.13, 0.524, 0.539)),
    ArmLink(0.15005, 0.0203, -QUARTER, 4.8, (-0.0203, -0.0141, 0.070), (0.066, 0.086, 0.02)),
)
WRIST = (
    ArmLink(0.4318, 0.0, QUARTER, 0.82, (0.0, 0.019, 0.0), (1.8e-3, 1.3e-3, 1.8e-3)),
    ArmLink(0.0, 0.0, -QUARTER, 0.34, (0.0, 0.0, 0.0), (0.3e-3, 0.4e-3, 0.3e-3)),
    ArmLink(0.0, 0.0, 0.0, 0.09, (0.0, 0.0, 0.032), (0.15e-3, 0.15e-3, 0.04e-3)),
)
"""Links of the arm, and of the wrist that is fixed to its end.

Source: P. Corke, B. Armstrong-Helouvry, A search for consensus among model parameters reported for
the PUMA 560 robot, IEEE ICRA 1994, in the form of P. Corke, Robotics, Vision and Control.
Exceptions: the first link's mass and its moments about the two axes across its axis of rotation,
which have no effect on the motion; and the third link's last moment, 0.02 instead of 0.0125, which
would violate the triangle inequality."""
WRIST_ANGLES = (0.0, 0.25 * math.pi, 0.0)
"""Fixed angles of the wrist, rad: those of the nominal pose."""


@dataclass(frozen=True)
class LinkFrame:
    """A link's frame: origin, (3,) m, and orientation, relative to the start of the chain."""

    origin: Components
    orientation: EulerParameters

    @property
    def axes(self) -> Float[np.ndarray, "3 3"]:
        """Unit vectors along the axes as columns, (3, 3), in the frame where the chain starts."""
        return np.asarray(pack(rotation_matrix(self.orientation)))

    def turned(self, angle: float) -> EulerParameters:
        """Return the orientation after a rotation by an angle, rad, about the frame's z axis."""
        return composed(self.orientation, EulerParameters(*turned_about_z(angle)))

    def after(self, link: ArmLink, angle: float) -> "LinkFrame":
        """Return the frame of the next `link`, turned by `angle`, rad, about this frame's z."""
        orientation = composed(self.turned(angle), link.tilt())
        axes = LinkFrame(self.origin, orientation).axes  # these don't depend on the origin
        # The joint, whose position `link.joint()` is from the new origin, is at the present origin.
        return LinkFrame(self.origin - axes @ link.joint(), orientation)

    def state(self, centre: Components, velocity: Components, spin: Components) -> BodyState:
        """Return the state of a body with its axes parallel to the frame's and its centre of mass
        at `centre`, (3,) m in the frame, from the global `velocity`, m/s, of its point at the
        frame's origin and its global `spin`, rad/s."""
        arm, orientation = self.axes @ centre, np.asarray(pack(self.orientation))
        position, velocity = self.origin + arm, velocity + np.cross(spin, arm)
        return body_state(position, orientation, velocity, self.axes.T @ spin)


BASE = LinkFrame(np.zeros(3), EulerParameters(1.0, 0.0, 0.0, 0.0))
"""The frame of the ground."""


def frames(links: Sequence[ArmLink], angles: Sequence[float]) -> list[LinkFrame]:
    """Return `BASE`, from which a chain of links starts, and the frame of each link."""
    steps = zip(links, angles, strict=True)
    return list(accumulate(steps, lambda frame, step: frame.after(*step), initial=BASE))


@dataclass(frozen=True)
class Lump:
    """Mass, kg, centre of mass, (3,) m, and inertia about it, (3, 3) kg m^2, in a link's frame."""

    mass: float
    centre: Components
    inertia: Float[np.ndarray, "3 3"]


def lumps() -> list[Lump]:
    """Return mass, centre and inertia of each link of the arm; the third includes the wrist."""
    single = [Lump(link.mass, np.array(link.centre), np.diag(link.inertia)) for link in ARM]
    # The wrist is fixed to the third link.
    parts = [single[2]]
    for link, frame in zip(WRIST, frames(WRIST, WRIST_ANGLES)[1:], strict=True):
        centre = frame.origin + frame.axes @ np.array(link.centre)
        inertia = frame.axes @ np.diag(link.inertia) @ frame.axes.T
        # The chain of the wrist starts in the frame of the third link, to which all is referred.
        parts.append(Lump(link.mass, centre, inertia))
    mass = sum(part.mass for part in parts)
    centre = np.sum([part.mass * part.centre for part in parts], axis=0) / mass
    inertia = np.zeros((3, 3))
    for part in parts:
        # The parallel axis theorem.
        arm = part.centre - centre
        inertia += part.inertia + part.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return [*single[:2], Lump(mass, centre, inertia)]


PARENTS = (GROUND, *LINKS[:2])
"""Name of the parent body of each link."""
LUMPS = lumps()


def arm_states(angles: Sequence[float], speeds: Sequence[float]) -> dict[str, BodyState]:
    """Return the states of links and flanges by name, as if the joints had no backlash."""
    # The loop goes from the base outwards. Spin and velocity of the frame's origin, both in global
    # axes, are those of the preceding link until they are updated to those of link k.
    arm_frames, spin, velocity = frames(ARM, angles), np.zeros(3), np.zeros(3)
    states = {}
    for k, (lump, speed) in enumerate(zip(LUMPS, speeds, strict=True)):
        parent, frame = arm_frames[k], arm_frames[k + 1]
        spin = spin + speed * parent.axes[:, 2]
        # The flange only rotates about the parent's z axis; the link's frame is also tilted.
        flange = LinkFrame(parent.origin, parent.turned(angles[k]))
        states[FLANGES[k]] = flange.state(np.zeros(3), velocity, spin)
        velocity = velocity + np.cross(spin, frame.origin - parent.origin)
        states[LINKS[k]] = frame.state(lump.centre, velocity, spin)
    return states


def robot_arm(
    play: Scalar | None = 1e-3,
    restitution: Scalar = 0.5,
    *,
    angles: tuple[float, float, float] = (0.0, 0.5 * QUARTER, 2.0 * QUARTER),
    speeds: tuple[float, float, float] = (0.0, 0.0, 0.0),
    law: AbstractContactLaw | None = None,
) -> tuple[Scene, State]:
    """Return waist, shoulder and elbow of the PUMA 560 with backlash, and the initial state.

    The links have the parameters published by Corke and Armstrong-Helouvry (ICRA 1994). In the
    nominal pose the angles of the arm are 0, 45 and 180 degrees, and those of the fixed wrist 0, 45
    and 0 degrees. In this pose gravity loads the joints with 0, 31.6399 and 6.0351 N m (P. Corke,
    Robotics, Vision and Control). Gravity is 9.81 m/s^2 along -Z; the first joint's axis is Z.

    Each motor ("motor 1" to "motor 3", `PrescribedRotation`) prescribes the angle of the flange at
    the output of its gearbox ("flange 1" to "flange 3", 1 g). The backlash ("play 1" to "play 3")
    is between flange and link. Its angle and its contacts, which have a stiffness of 1e9 N/m^1.5
    and are 50 mm from the axis, are our choice. Revolute joints connect each flange ("bearing 1" to
    "bearing 3") and each link ("joint 1" to "joint 3") with the preceding link or the ground. The
    quantity `JointAngle` of "joint 1" to "joint 3" is the angle of Denavit and Hartenberg. The
    initial state is in the middle of the play.

    **Arguments:**

    - `play`: total angle of the backlash in each of the three joints, rad; with ``None`` there are
      no flanges, and the motors drive the links directly.
    - `restitution`: of the default `law` of the backlash, `ExactRestitution`, above 0.
    - `angles`: of the motors at the start, rad. `speeds`: of the motors, constant, rad/s.

    >>> scene, state = cj.mechanisms.robot_arm(play=1e-3)
    >>> list(scene.bodies)
    ['link 1', 'link 2', 'link 3', 'flange 1', 'flange 2', 'flange 3']
    """
    for argument, values in (("angles", angles), ("speeds", speeds)):
        require_shape(argument, as_number(values, argument), (3,), "give one for each motor")
    if law is None:
        # In the nominal pose, the weight rotates the elbow by half a mrad.
        law = ExactRestitution(restitution=restitution, stiffness=1e9)
    joints: Joints = {}
    bodies = {name: Body(lump.mass, lump.inertia) for name, lump in zip(LINKS, LUMPS, strict=True)}
    for k, (angle, speed) in enumerate(zip(angles, speeds, strict=True)):
        parent, link, flange, axis = PARENTS[k], LINKS[k], FLANGES[k], ARM[k].axis()
        # The hinge on the parent is the origin of the parent's Denavit-Hartenberg frame. Points of
        # a body are relative to its centre of mass.
        foot = np.zeros(3) if k == 0 else -LUMPS[k - 1].centre
        on_link = ARM[k].joint() - LUMPS[k].centre
        joints[f"joint {k + 1}"] = RevoluteJoint(parent, link, foot, on_link, Z_AXIS, axis)
        # The orientation of the driven body relative to its parent while the motor's angle is zero.
        driven, orientation_at_zero = link, ARM[k].tilt()
        if play is not None:
            # The motor drives the flange, which has a bearing of its own on the parent.
            driven, orientation_at_zero = flange, BASE.orientation
            bodies[flange] = Body(1e-3, (1e-6, 1e-6, 1e-6))
            joints[f"bearing {k + 1}"] = RevoluteJoint(parent, flange, foot, ORIGIN, Z_AXIS, Z_AXIS)
        orientation = np.asarray(pack(orientation_at_zero))
        motor = PrescribedRotation(parent, driven, Z_AXIS, speed, angle, orientation)
        joints[f"motor {k + 1}"] = motor
        if play is not None:
            backlash = Backlash(flange, link, axis_second=axis, play=play, radius=0.05, law=law)
            joints[f"play {k + 1}"] = backlash
    states = arm_states(angles, speeds)
    scene = Scene(bodies, joints, gravity=(0.0, 0.0, -9.81))
    return scene, State({name: states[name] for name in bodies})
