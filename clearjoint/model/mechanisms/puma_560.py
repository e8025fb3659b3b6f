"""Published numbers of the PUMA 560's first three links, and where they are."""

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
    """A link by its standard Denavit-Hartenberg parameters, and its mass.

    `offset` d and `length` a in m, `twist` alpha in rad; in its frame, mass in kg, `centre` of mass
    (3,) m, and principal `inertia` (3,) kg m^2 about it.
    """

    offset: float
    length: float
    twist: float
    mass: float
    centre: tuple[float, float, float]
    inertia: tuple[float, float, float]

    def tilt(self) -> EulerParameters:
        """What turns components in the link's frame into the one before it, at an angle of zero."""
        return EulerParameters(math.cos(0.5 * self.twist), math.sin(0.5 * self.twist), 0.0, 0.0)

    def axis(self) -> Components:
        """The axis about which the link turns, in its own frame."""
        return np.array([0.0, math.sin(self.twist), math.cos(self.twist)])

    def joint(self) -> Components:
        """The frame before it, where it turns, from its own; m in its axes."""
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
"""P. Corke, B. Armstrong-Helouvry, A search for consensus among model parameters reported for the
PUMA 560 robot, IEEE ICRA 1994, in the form of P. Corke, Robotics, Vision and Control. Not theirs:
the first link's mass, and its moments but that about the joint, which don't enter; and the third
link's last moment, 0.02 for 0.0125, without which it were no rigid body's."""
WRIST_ANGLES = (0.0, 0.25 * math.pi, 0.0)
"""rad, at which the wrist is held: those of the nominal pose."""


@dataclass(frozen=True)
class LinkFrame:
    """A link's frame: its origin (3,) m, and Euler parameters that turn its axes' components into
    global ones."""

    origin: Components
    turn: EulerParameters

    @property
    def axes(self) -> Float[np.ndarray, "3 3"]:
        """The axes as columns, global."""
        return np.asarray(pack(rotation_matrix(self.turn)))

    def turned(self, angle: float) -> EulerParameters:
        """The frame's turn after one by an angle, rad, about its last axis."""
        about_z = EulerParameters(math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle))
        return composed(self.turn, about_z)

    def after(self, link: ArmLink, angle: float) -> "LinkFrame":
        """The frame of the next link, turned by an angle in rad."""
        turn = composed(self.turned(angle), link.tilt())
        here = LinkFrame(self.origin, turn)
        return LinkFrame(self.origin - here.axes @ link.joint(), turn)


BASE = LinkFrame(np.zeros(3), EulerParameters(1.0, 0.0, 0.0, 0.0))
"""That of the ground."""


def frames(links: Sequence[ArmLink], angles: Sequence[float]) -> list[LinkFrame]:
    """The base, and the frame of each link after it, turned by angles in rad."""
    found = [BASE]
    for link, angle in zip(links, angles, strict=True):
        found.append(found[-1].after(link, angle))
    return found


@dataclass(frozen=True)
class Lump:
    """Mass kg, centre of mass (3,) m and inertia (3, 3) kg m^2 about it, in one frame."""

    mass: float
    centre: Components
    inertia: Float[np.ndarray, "3 3"]


def lumps() -> list[Lump]:
    """The three links in their own frames, the wrist a part of the third."""
    single = [Lump(one.mass, np.array(one.centre), np.diag(one.inertia)) for one in ARM]
    places = frames(WRIST, WRIST_ANGLES)[1:]
    parts = [single[2]]
    for link, place in zip(WRIST, places, strict=True):
        centre = place.origin + place.axes @ np.array(link.centre)
        inertia = place.axes @ np.diag(link.inertia) @ place.axes.T
        parts.append(Lump(link.mass, centre, inertia))
    return [*single[:2], _together(parts)]


def _together(parts: Sequence[Lump]) -> Lump:
    mass = sum(part.mass for part in parts)
    centre = np.sum([part.mass * part.centre for part in parts], axis=0) / mass
    inertia = np.zeros((3, 3))
    for part in parts:
        arm = part.centre - centre
        inertia += part.inertia + part.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Lump(mass, centre, inertia)


def arm_states(angles: Sequence[float], speeds: Sequence[float]) -> dict[str, BodyState]:
    """States of the links, and of the flanges that turn with them, at angles in rad and with
    speeds in rad/s."""
    places, spin, velocity = frames(ARM, angles), np.zeros(3), np.zeros(3)
    states = {}
    for k, (lump, speed) in enumerate(zip(lumps(), speeds, strict=True)):
        before, place = places[k], places[k + 1]
        spin = spin + speed * before.axes[:, 2]
        flange = LinkFrame(before.origin, before.turned(angles[k]))
        states[FLANGES[k]] = _state(flange, np.zeros(3), velocity, spin)
        velocity = velocity + np.cross(spin, place.origin - before.origin)
        states[LINKS[k]] = _state(place, lump.centre, velocity, spin)
    return states


def _state(
    frame: LinkFrame, centre: Components, velocity: Components, spin: Components
) -> BodyState:
    """Of a body whose centre of mass (3,) m is in a frame with a velocity (3,) m/s and a spin (3,)
    rad/s, both global."""
    arm = frame.axes @ centre
    turn = np.asarray(pack(frame.turn))
    return body_state(frame.origin + arm, turn, velocity + np.cross(spin, arm), frame.axes.T @ spin)
