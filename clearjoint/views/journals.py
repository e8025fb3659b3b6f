"""Journals and balls in their bearings, with the clearance as wide as it is drawn."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..model.clearance_joints.journal_bases import BASES, SIDES
from ..model.pen import Marker
from .motion import BodyPoses
from .parts import frames

WALL = 0.22
"""Thickness of a bearing's wall as drawn, over its radius."""
STICKS_OUT = 1.3
"""Length of a journal as drawn, over that of its bearing."""


@dataclass(frozen=True)
class DrawnJournal:
    """Where a journal is drawn.

    - `ends`: (2, N, 3) m, the centres of its bases V and W, global.
    - `poses`: (N, 4, 4), its centre, with its axis along z.
    - `radius`: m.
    """

    ends: Float[np.ndarray, "2 N 3"]
    poses: Float[np.ndarray, "N 4 4"]
    radius: float

    def touching_point(
        self, contact: str, normal: Float[np.ndarray, "N 3"]
    ) -> Float[np.ndarray, "N 3"] | None:
        """Where a base touches in the direction of a normal; ``None`` for any other contact."""
        if contact not in BASES:
            return None
        return self.ends[BASES.index(contact)] + self.radius * normal


def drawn_journal(
    poses: BodyPoses,
    bearing: Marker,
    journal: Marker,
    *,
    radius: float,
    length: float,
    clearance_scale: float,
    bearing_scale: float,
) -> DrawnJournal:
    """A journal whose bases are farther from the bearing's axis than they are by a factor.

    **Arguments:** `radius` of the journal as drawn, m; `length` of the real one, m.
    """
    axis = poses.direction(bearing.body, bearing.along())
    own = poses.direction(journal.body, journal.along())
    centre = poses.point(bearing.body, bearing.point)
    reach = poses.point(journal.body, journal.point) - centre
    sense = np.where(np.sum(own * axis, axis=1, keepdims=True) < 0.0, -1.0, 1.0)
    ends = []
    for side in SIDES:
        offset = reach + own * (0.5 * side * length)
        across = offset - axis * np.sum(offset * axis, axis=1, keepdims=True)
        along = np.sum(reach * axis, axis=1, keepdims=True)
        along = along + 0.5 * side * sense * length * bearing_scale
        ends.append(centre + axis * along + across * clearance_scale)
    between = ends[1] - ends[0]
    between /= np.linalg.norm(between, axis=1, keepdims=True)
    drawn = frames(between, _across(poses, journal))
    drawn[:, :3, 3] = 0.5 * (ends[0] + ends[1])
    return DrawnJournal(np.array(ends), drawn, radius)


def _across(poses: BodyPoses, journal: Marker) -> Float[np.ndarray, "N 3"]:
    """A direction across the journal's axis that turns with it, global."""
    axis = journal.along()
    return poses.direction(journal.body, np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))]))


def drawn_ball(
    poses: BodyPoses, socket: Marker, ball: Marker, clearance_scale: float
) -> Float[np.ndarray, "N 4 4"]:
    """Poses of a ball that is farther from the socket's centre than it is by a factor."""
    drawn = poses.poses[ball.body].copy()
    centre = poses.point(socket.body, socket.point)
    drawn[:, :3, 3] = centre + clearance_scale * (poses.point(ball.body, ball.point) - centre)
    return drawn
