"""Where one looks from."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .parts import DrawnPart, corners
from .proportions import Proportions

FIELD_OF_VIEW, FLAT = 30.0, 0.3
"""Degrees, from the lower to the upper edge; and the sine of the angle between the axis of a
mechanism and the vertical, up to which one looks at it from above."""
ROOM = 1.1
"""Room around what is seen."""
WIDE = 1.25
"""Width of a picture over its height, at least."""
TILTED, OBLIQUE, ABOVE = (0.3, 0.2), (0.75, 0.42), (0.5, 1.2)
"""How far to the right and up the viewer stands, over how far in front: of a planar mechanism, to
see it as it is drawn in books and yet in space; of any other; and of one that lies flat."""


class Camera(NamedTuple):
    """Where the viewer is, the point that is looked at, m, and the direction upwards, (3,) each;
    and half the height of a picture, m, in which everything is seen from afar."""

    eye: np.ndarray
    target: np.ndarray
    up: np.ndarray
    reach: float

    def axes(self) -> np.ndarray:
        """Unit vectors to the right, upwards and to the viewer, the rows of a (3, 3) matrix."""
        towards = self.eye - self.target
        return _axes(towards / np.linalg.norm(towards), self.up)


def camera(parts: Sequence[DrawnPart], proportions: Proportions, count: int) -> Camera:
    """One from which all parts are seen at all of so many instants."""
    instants = np.unique(np.linspace(0, count - 1, min(count, 30)).astype(int)).tolist()
    axes = _axes(_direction(proportions), proportions.up)
    seen = corners(parts, instants) @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    target, half = axes.T @ (0.5 * (low + high)), 0.5 * (high - low)
    reach = ROOM * max(half[1], half[0] / WIDE)
    distance = reach / np.tan(np.radians(0.5 * FIELD_OF_VIEW)) + half[2]
    return Camera(target + distance * axes[2], target, axes[1], float(reach))


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
