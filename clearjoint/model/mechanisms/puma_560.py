"""Published numbers of the PUMA 560's first three links, and where they are."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

Row = Float[np.ndarray, "3"]
Square = Float[np.ndarray, "3 3"]


@dataclass(frozen=True)
class Link:
    """A link by its standard Denavit-Hartenberg parameters, and its mass.

    `offset` d and `length` a in m, `twist` alpha in rad; in its frame, mass in kg, `centre` of mass
    (3,) m, principal `inertia` (3,) kg m^2 about it. `rotor` kg m^2 is that of its motor times the
    gear ratio squared.
    """

    offset: float
    length: float
    twist: float
    mass: float
    centre: tuple[float, float, float]
    inertia: tuple[float, float, float]
    rotor: float = 0.0


QUARTER = 0.5 * math.pi
ARM = (
    Link(0.0, 0.0, QUARTER, 13.0, (0.0, 0.0, 0.0), (0.2, 0.35, 0.2), 200e-6 * 62.6111**2),
    Link(
        0.0,
        0.4318,
        0.0,
        17.4,
        (-0.3638, 0.006, 0.2275),
        (0.13, 0.524, 0.539),
        200e-6 * 107.815**2,
    ),
    Link(
        0.15005,
        0.0203,
        -QUARTER,
        4.8,
        (-0.0203, -0.0141, 0.070),
        (0.066, 0.086, 0.02),
        200e-6 * 53.7063**2,
    ),
)
WRIST = (
    Link(0.4318, 0.0, QUARTER, 0.82, (0.0, 0.019, 0.0), (1.8e-3, 1.3e-3, 1.8e-3)),
    Link(0.0, 0.0, -QUARTER, 0.34, (0.0, 0.0, 0.0), (0.3e-3, 0.4e-3, 0.3e-3)),
    Link(0.0, 0.0, 0.0, 0.09, (0.0, 0.0, 0.032), (0.15e-3, 0.15e-3, 0.04e-3)),
)
"""P. Corke, B. Armstrong-Helouvry, A search for consensus among model parameters reported for the
PUMA 560 robot, IEEE ICRA 1994, in the form of P. Corke, Robotics, Vision and Control. Not theirs:
the first link's mass, and its moments but that about the joint, which don't enter; and the third
link's last moment, 0.02 for 0.0125, without which it were no rigid body's."""
WRIST_ANGLES = (0.0, 0.25 * math.pi, 0.0)
"""rad, at which the wrist is held: those of the nominal pose."""


@dataclass(frozen=True)
class Frame:
    """A link's frame: its origin (3,) m, and its axes as columns, global."""

    origin: Row
    axes: Square

    def after(self, link: Link, angle: float) -> "Frame":
        """The frame of the next link, turned by an angle in rad."""
        c, s = math.cos(angle), math.sin(angle)
        ct, st = math.cos(link.twist), math.sin(link.twist)
        turn = np.array([[c, -s * ct, s * st], [s, c * ct, -c * st], [0.0, st, ct]])
        reach = np.array([link.length * c, link.length * s, link.offset])
        return Frame(self.origin + self.axes @ reach, self.axes @ turn)


def frames(links: Sequence[Link], angles: Sequence[float], base: Frame) -> list[Frame]:
    """The base, and the frame of each link after it."""
    found = [base]
    for link, angle in zip(links, angles, strict=True):
        found.append(found[-1].after(link, angle))
    return found


@dataclass(frozen=True)
class Lump:
    """Mass kg, centre of mass (3,) m and inertia (3, 3) kg m^2 about it, in one frame."""

    mass: float
    centre: Row
    inertia: Square


def lumps() -> list[Lump]:
    """The three links in their own frames, the wrist a part of the third."""
    single = [Lump(one.mass, np.array(one.centre), np.diag(one.inertia)) for one in ARM]
    places = frames(WRIST, WRIST_ANGLES, Frame(np.zeros(3), np.eye(3)))[1:]
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
