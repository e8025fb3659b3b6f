"""Solids of a view, and their colours.

A view has N frames, each of which shows the mechanism at one instant; a single state is one frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from .meshes import Mesh, frames

BODIES = (
    "#0072B2",
    "#009E73",
    "#CC79A7",
    "#56B4E9",
    "#F0E442",
    "#16324F",
    "#999933",
    "#44AA99",
    "#882255",
)
"""Colours of bodies, which colour-blind people can distinguish (after M. Okabe and K. Ito)."""
GROUND_COLOUR, METAL = "#8C8C8C", "#4D4D4D"
"""Colours of the ground, and of pins, balls and springs."""
FORCE, LOAD = "#D55E00", "#7A1F8C"
"""Colours of the arrows of contact forces and of loads."""
MODES = {0: "#FFF3D6", 1: "#E69F00", 2: "#8A3B00", 3: "#000000"}
"""Colours of a journal by the number of its `MotionMode`, from free flight to contact at opposite
sides: darker for more contact."""
CLEAR = 0.3
"""Opacity of transparent parts, from 0, invisible, to 1, opaque."""


@dataclass(frozen=True)
class DrawnPart:
    """A rigid solid of a view, with its pose in each frame.

    - `name`: name of its body, joint or force.
    - `mesh`: triangles in the solid's own axes, m.
    - `poses`: homogeneous matrices from the solid's to global axes, which may also stretch it:
      (N, 4, 4), one for each frame, or (1, 4, 4) for a solid at rest.
    - `colour`: "#rrggbb".
    - `opacity`: from 0.0, invisible, to 1.0, opaque.
    - `modes`: (N,) keys of `MODES`, whose colours replace `colour` in each frame; ``None`` for a
      solid of one colour.
    - `is_journal`: whether the solid is the journal or ball of a clearance joint.
    """

    name: str
    mesh: Mesh
    poses: Float[np.ndarray, "N 4 4"]
    colour: str
    opacity: float = 1.0
    modes: Int[np.ndarray, " N"] | None = None
    is_journal: bool = False

    def pose(self, k: int) -> Float[np.ndarray, "4 4"]:
        """Return the pose in frame `k`."""
        return self.poses[min(k, len(self.poses) - 1)]

    def colour_at(self, k: int) -> str:
        """Return the colour in frame `k`, "#rrggbb"."""
        return self.colour if self.modes is None else MODES[int(self.modes[k])]


def between(
    starts: Float[np.ndarray, "N 3"], ends: Float[np.ndarray, "N 3"], width: float
) -> Float[np.ndarray, "N 4 4"]:
    """Return the poses of a solid, such as a spring, that connects two moving points.

    The solid reaches from z = 0 to z = 1 in its own axes. The poses stretch it so that it reaches
    from the start to the end, and multiply its x and y by `width`.

    **Arguments:** `starts`, `ends`: (N, 3) m, in global axes, one row for each frame.

    **Returns:** (N, 4, 4), or (1, 4, 4) if all poses are equal.
    """
    along = ends - starts
    # A minimum of 1e-12 m, since equal points have no direction.
    length = np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    poses = frames(along / length)
    poses[:, :3, :2] *= width
    poses[:, :3, 2] *= length
    poses[:, :3, 3] = starts
    return still(poses)


def corners(parts: Sequence[DrawnPart], instants: Sequence[int]) -> Float[np.ndarray, "N 3"]:
    """Return the corners, (M, 3) m in global axes, of the boxes around all parts.

    The camera must show these points. Each box is in the axes of its part, around the vertices.

    **Arguments:** `instants`: indices of the frames in which moving parts are evaluated; parts at
    rest are evaluated once.
    """
    result = []
    for part in parts:
        ends = part.mesh.vertices.min(axis=0), part.mesh.vertices.max(axis=0)
        grid = np.stack(np.meshgrid(*zip(*ends, strict=True)), -1).reshape(-1, 3)
        for k in instants if len(part.poses) > 1 else (0,):
            result.append(Mesh(grid, part.mesh.faces).moved(part.pose(k)).vertices)
    return np.vstack(result)


def still(poses: Float[np.ndarray, "N 4 4"]) -> Float[np.ndarray, "M 4 4"]:
    """Return the poses, or only the first one, (1, 4, 4), if all are equal."""
    return poses[:1] if np.array_equal(poses, np.broadcast_to(poses[:1], poses.shape)) else poses
