"""Published parameters and kinematics of the PUMA 560's first three links."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from ...math.rotations import composed, rotation_matrix
from ...math.vectors import EulerParameters, pack
from ..bodies import BodyState, body_state

Components: TypeAlias = Float[np.ndarray, "3"]


@dataclass(frozen=True)
class ArmLink:
    """A link: its standard Denavit-Hartenberg parameters and its mass.

    - `offset` d and `length` a: m. `twist` alpha: rad.
    - `mass`: kg.
    - `centre`: of mass, (3,) m in the link's frame.
    - `inertia`: principal moments about the centre of mass, (3,) kg m^2.
    """

    offset: float
    length: float
    twist: float
    mass: float
    centre: tuple[float, float, float]
    inertia: tuple[float, float, float]

    def tilt(self) -> EulerParameters:
        """Return the orientation of the link's frame in the parent's at angle zero."""
        return EulerParameters(math.cos(0.5 * self.twist), math.sin(0.5 * self.twist), 0.0, 0.0)

    def axis(self) -> Components:
        """Return the link's axis of rotation, a unit vector (3,) in the link's frame."""
        return np.array([0.0, math.sin(self.twist), math.cos(self.twist)])

    def joint(self) -> Components:
        """Return the origin of the parent's frame, (3,) m in the link's frame."""
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
"""P. Corke, B. Armstrong-Helouvry, A search for consensus among model parameters reported for
the PUMA 560 robot, IEEE ICRA 1994, in the form of P. Corke, Robotics, Vision and Control.
Exceptions: the first link's mass and its moments about the other axes, which have no effect; and
the third link's last moment, 0.02 instead of 0.0125, which would violate the triangle
inequality."""
WRIST_ANGLES = (0.0, 0.25 * math.pi, 0.0)
"""Fixed angles of the wrist, rad: those of the nominal pose."""


@dataclass(frozen=True)
class LinkFrame:
    """A link's frame: its origin (3,) m, and the orientation of its axes as Euler parameters."""

    origin: Components
    orientation: EulerParameters

    @property
    def axes(self) -> Float[np.ndarray, "3 3"]:
        """Unit vectors along the axes as columns, (3, 3), in global components."""
        return np.asarray(pack(rotation_matrix(self.orientation)))

    def turned(self, angle: float) -> EulerParameters:
        """Return the orientation after a rotation by an angle, rad, about the frame's z axis."""
        about_z = EulerParameters(math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle))
        return composed(self.orientation, about_z)

    def after(self, link: ArmLink, angle: float) -> "LinkFrame":
        """Return the frame of the next link of a chain.

        **Arguments:** `link`: the next link; `angle`: of its joint, rad, about the z axis of this
        frame.
        """
        orientation = composed(self.turned(angle), link.tilt())
        axes = LinkFrame(self.origin, orientation).axes
        return LinkFrame(self.origin - axes @ link.joint(), orientation)


BASE = LinkFrame(np.zeros(3), EulerParameters(1.0, 0.0, 0.0, 0.0))
"""The frame of the ground."""


def frames(links: Sequence[ArmLink], angles: Sequence[float]) -> list[LinkFrame]:
    """Return the base frame, and the frames of the links of a chain from the base.

    **Arguments:** `angles`: of each link relative to the one before, rad.
    """
    frames = [BASE]
    for link, angle in zip(links, angles, strict=True):
        frames.append(frames[-1].after(link, angle))
    return frames


@dataclass(frozen=True)
class Lump:
    """Mass, kg, centre of mass, (3,) m, and inertia about the centre of mass, (3, 3) kg m^2.

    All components are in the frame of one link.
    """

    mass: float
    centre: Components
    inertia: Float[np.ndarray, "3 3"]


def lumps() -> list[Lump]:
    """Return mass and inertia of each link in its own frame; the third link includes the wrist."""
    single = [Lump(link.mass, np.array(link.centre), np.diag(link.inertia)) for link in ARM]
    parts = [single[2]]
    for link, frame in zip(WRIST, frames(WRIST, WRIST_ANGLES)[1:], strict=True):
        centre = frame.origin + frame.axes @ np.array(link.centre)
        inertia = frame.axes @ np.diag(link.inertia) @ frame.axes.T
        parts.append(Lump(link.mass, centre, inertia))
    return [*single[:2], _combined(parts)]


def _combined(parts: Sequence[Lump]) -> Lump:
    mass = sum(part.mass for part in parts)
    centre = np.sum([part.mass * part.centre for part in parts], axis=0) / mass
    inertia = np.zeros((3, 3))
    for part in parts:
        arm = part.centre - centre
        inertia += part.inertia + part.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Lump(mass, centre, inertia)


def arm_states(angles: Sequence[float], speeds: Sequence[float]) -> dict[str, BodyState]:
    """Return states of links and flanges by name, for three angles, rad, and speeds, rad/s."""
    arm_frames, spin, velocity = frames(ARM, angles), np.zeros(3), np.zeros(3)
    states = {}
    for k, (lump, speed) in enumerate(zip(lumps(), speeds, strict=True)):
        parent, frame = arm_frames[k], arm_frames[k + 1]
        spin = spin + speed * parent.axes[:, 2]
        flange = LinkFrame(parent.origin, parent.turned(angles[k]))
        states[FLANGES[k]] = _state(flange, np.zeros(3), velocity, spin)
        velocity = velocity + np.cross(spin, frame.origin - parent.origin)
        states[LINKS[k]] = _state(frame, lump.centre, velocity, spin)
    return states


def _state(
    frame: LinkFrame, centre: Components, velocity: Components, spin: Components
) -> BodyState:
    """Return the state of a body from its frame and the centre of mass, (3,) m, in that frame.

    `velocity`, (3,) m/s of the frame's origin, and `spin`, (3,) rad/s, are global.
    """
    arm = frame.axes @ centre
    orientation, spin_in_frame = np.asarray(pack(frame.orientation)), frame.axes.T @ spin
    return body_state(
        frame.origin + arm, orientation, velocity + np.cross(spin, arm), spin_in_frame
    )
