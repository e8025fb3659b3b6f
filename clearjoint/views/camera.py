"""Where one looks from."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .parts import FORCE, LOAD, DrawnPart, corners
from .proportions import Proportions

FIELD_OF_VIEW, FLAT = 30.0, 0.3
"""Degrees, from the lower to the upper edge; and the sine of the angle between the axis of a
mechanism and the vertical, up to which one looks at it from above."""
ROOM = 1.1
"""Room around what is seen."""
INSTANTS = 120
"""At which it is looked where parts are."""
ROUNDS = 12
"""In which the camera finds its place: where it is depends on what seems large from there."""
WIDE = 1.25
"""Width of a picture over its height, at least."""
TILTED, OBLIQUE, ABOVE = (0.3, 0.2), (0.75, 0.42), (0.5, 1.2)
"""How far to the right and up the viewer stands, over how far in front: of a planar mechanism, to
see it as it is drawn in books and yet in space; of any other; and of one that lies flat."""


class Camera(NamedTuple):
    """Where the viewer is, the point that is looked at, m, and the direction upwards, (3,) each;
    and half the height of the picture in the plane of that point, m."""

    eye: np.ndarray
    target: np.ndarray
    up: np.ndarray
    reach: float

    def axes(self) -> np.ndarray:
        """Unit vectors to the right, upwards and to the viewer, the rows of a (3, 3) matrix."""
        towards = self.eye - self.target
        return _axes(towards / np.linalg.norm(towards), self.up)


def camera(parts: Sequence[DrawnPart], proportions: Proportions, count: int) -> Camera:
    """One from which all parts are seen at all of so many instants, with the mechanism, without the
    arrows of forces, in the middle of the picture."""
    instants = np.unique(np.linspace(0, count - 1, min(count, INSTANTS)).astype(int)).tolist()
    axes = _axes(_direction(proportions), proportions.up)
    bodies = [part for part in parts if part.colour not in (FORCE, LOAD)]
    mechanism, everything = (corners(some, instants) @ axes.T for some in (bodies, parts))
    slope = np.tan(np.radians(0.5 * FIELD_OF_VIEW))
    target = 0.5 * (mechanism.min(axis=0) + mechanism.max(axis=0))
    high = np.abs(everything - target).max()
    distance = high / slope + high
    for _ in range(ROUNDS):
        seen = in_perspective(mechanism - target, distance)
        target[:2] += 0.5 * (seen.min(axis=0) + seen.max(axis=0))
        away = np.abs(in_perspective(everything - target, distance)).max(axis=0)
        nearest = np.max(everything[:, 2] - target[2])
        distance = max(ROOM * max(away[1], away[0] / WIDE) / slope, 1.1 * nearest)
    target = axes.T @ target
    return Camera(target + distance * axes[2], target, axes[1], float(distance * slope))


def in_perspective(
    corners: Float[np.ndarray, "*N 3"], distance: float
) -> Float[np.ndarray, "*N 2"]:
    """Where points are seen in the plane of the target, m to the right and upwards.

    **Arguments:** `corners`: m from the target, to the right, upwards and to the viewer, who stands
    at the `distance`, m.
    """
    return corners[..., :2] * (distance / (distance - corners[..., 2:]))


def _direction(proportions: Proportions) -> np.ndarray:
    """From the mechanism to the viewer, a unit vector."""
    up = proportions.up
    front = proportions.front - up * (proportions.front @ up)
    rightwards, upwards = TILTED if proportions.planar else OBLIQUE
    if np.linalg.norm(front) < FLAT:
        front = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
        rightwards, upwards = ABOVE
    front = front / np.linalg.norm(front)
    towards = front + rightwards * np.cross(up, front) + upwards * up
    return towards / np.linalg.norm(towards)


def _axes(towards: np.ndarray, up: np.ndarray) -> np.ndarray:
    right = np.cross(up, towards)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(towards, right), towards])
