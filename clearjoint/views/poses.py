"""Compute positions and orientations of all bodies in the frames that `clearjoint.view` shows."""

from collections.abc import Mapping
from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Float, Int

from ..fields.checks import require
from ..model.bodies import GROUND, BodyState, State
from ..simulation.results.solution import Trajectory


@dataclass(frozen=True)
class BodyPoses:
    """Poses of all bodies and of the ground in N frames.

    - `times`: (N,) s, of the frames, or ``None`` for a single state (N = 1).
    - `poses`: homogeneous matrices (N, 4, 4) from body axes to global axes, m, by the body's name.
    """

    times: Float[np.ndarray, " N"] | None
    poses: Mapping[str, Float[np.ndarray, "N 4 4"]]

    @property
    def count(self) -> int:
        """Number of frames, N."""
        return len(self.poses[GROUND])

    def point(self, body: str, local: np.ndarray) -> Float[np.ndarray, "N 3"]:
        """Return the global positions (N, 3), m, of a point of a body, `local` (3,) m in body
        axes."""
        pose = self.poses[body]
        return pose[:, :3, :3] @ np.asarray(local, dtype=float) + pose[:, :3, 3]

    def direction(self, body: str, local: np.ndarray) -> Float[np.ndarray, "N 3"]:
        """Return the global unit vectors (N, 3) of a direction, `local` (3,) in body axes."""
        vector = np.asarray(local, dtype=float)
        return self.poses[body][:, :3, :3] @ (vector / np.linalg.norm(vector))


def standing(state: State) -> BodyPoses:
    """Return the poses of a single state, without a time."""
    poses = {name: _poses(body)[None] for name, body in state.bodies.items()}
    return BodyPoses(None, poses | {GROUND: np.eye(4)[None]})


def moving(trajectory: Trajectory) -> BodyPoses:
    """Return the poses at all times of a trajectory."""
    times = np.asarray(trajectory.times, dtype=float)
    poses = {name: _poses(body) for name, body in trajectory.states.bodies.items()}
    return BodyPoses(times, poses | {GROUND: np.tile(np.eye(4), (len(times), 1, 1))})


def instants_to_show(times: np.ndarray, most: int) -> Int[np.ndarray, " M"]:
    """Return the indices (M,) of at most `most` times that are about equally spaced.

    The first and the last time are among them. All times are chosen if there are at most `most`.

    **Arguments:** `times`: (N,) s, increasing.
    """
    if len(times) <= most:
        return np.arange(len(times))
    wanted = np.linspace(times[0], times[-1], most)
    after = np.clip(np.searchsorted(times, wanted), 1, len(times) - 1)
    nearer = wanted - times[after - 1] < times[after] - wanted
    return np.unique(np.where(nearer, after - 1, after))


def at_instants(trajectory: Trajectory, chosen: np.ndarray) -> Trajectory:
    """Return the states of a trajectory at the indices `chosen`, (M,)."""
    return jax.tree.map(lambda rows: np.asarray(rows)[chosen], trajectory)


def require_bodies(state: State, bodies: Mapping[str, object]) -> None:
    """Raise `ValueError` unless a state has exactly the bodies of a scene."""
    require(
        set(state.bodies) == set(bodies),
        "motion",
        sorted(state.bodies),
        f"of the scene's bodies {sorted(bodies)}",
        "pass a state or a solution of this scene",
    )


def require_instants(trajectory: Trajectory) -> None:
    """Raise `ValueError` unless a trajectory has a state of each body for each time."""
    count = len(np.asarray(trajectory.times))
    for name, body in trajectory.states.bodies.items():
        shape = np.shape(body.position)
        is_valid = count > 0 and shape == (count, 3)
        remedy = "pass a State, or a trajectory whose arrays have the times as first axis"
        argument = f"motion.states.bodies[{name!r}].position"
        require(is_valid, argument, shape, f"of shape ({count}, 3), one row for each time", remedy)


def _poses(body: BodyState) -> Float[np.ndarray, "*N 4 4"]:
    """Return homogeneous matrices (N, 4, 4), or (4, 4) for a single state, from the position of a
    body and its Euler parameters of any length except zero."""
    from scipy.spatial.transform import Rotation

    position, orientation = np.asarray(body.position), np.asarray(body.orientation)
    poses = np.broadcast_to(np.eye(4), (*position.shape[:-1], 4, 4)).copy()
    poses[..., :3, :3] = Rotation.from_quat(orientation, scalar_first=True).as_matrix()
    poses[..., :3, 3] = position
    return poses
