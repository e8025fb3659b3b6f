"""Compute positions and orientations of all bodies in the frames of a view."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from .._dynamics.assembly import assemble
from .._fields.checks import require
from .._model.bodies import GROUND, State
from .._model.scene import Scene


@dataclass(frozen=True)
class BodyPoses:
    """Poses of all bodies and the ground in N frames at `times`, s, ``None`` for a single state."""

    times: Float[np.ndarray, " N"] | None
    poses: Mapping[str, Float[np.ndarray, "N 4 4"]]

    def point(self, body: str, local: np.ndarray) -> Float[np.ndarray, "N 3"]:
        """Return the positions of a point of a body, `local` (3,) in body axes."""
        pose = self.poses[body]
        return pose[:, :3, :3] @ np.asarray(local, dtype=float) + pose[:, :3, 3]

    def direction(self, body: str, local: np.ndarray) -> Float[np.ndarray, "N 3"]:
        """Return the unit vectors, in global axes, of a direction, `local` (3,) in body axes."""
        vector = np.asarray(local, dtype=float)
        return self.poses[body][:, :3, :3] @ (vector / np.linalg.norm(vector))


def body_poses(states: State, times: np.ndarray | None = None) -> BodyPoses:
    from scipy.spatial.transform import Rotation

    ground = np.tile(np.eye(4), (1 if times is None else len(times), 1, 1))
    poses = {GROUND: ground}
    for name, body in states.bodies.items():
        # The Euler parameters may have any length except zero.
        rotation = Rotation.from_quat(np.atleast_2d(body.orientation), scalar_first=True)
        poses[name] = ground.copy()
        poses[name][:, :3, :3] = rotation.as_matrix()
        poses[name][:, :3, 3] = np.asarray(body.position)
    return BodyPoses(times, poses)


def initial_state(scene: Scene) -> tuple[State, bool]:
    """Return a state at rest to show a scene, and whether it satisfies all joints.

    Bodies are placed by following the joints from the ground. If loops stay open, `assemble` closes
    them; if it can't, they stay open in the result.
    """
    from .._model.arrangement import arranged_state, satisfies_joints  # imports SciPy

    # Most scenes need no `assemble`, which compiles the equations of motion.
    straight = arranged_state(scene)
    if satisfies_joints(scene, straight):
        return straight, True
    # Angles of the first joint, rad, from which `assemble` is tried. At zero, links may be in a
    # dead-centre position, which it can't leave.
    for angle in (0.0, 0.7, -0.7, 1.6):
        try:
            return assemble(scene, arranged_state(scene, angle=angle)), True
        except ValueError:
            continue
    return straight, False


def instants_to_show(times: np.ndarray, most: int) -> Int[np.ndarray, " M"]:
    """Return indices of the instants that become frames: at most `most`, about equally spaced in
    time, with the first and, unless `most` is 1, the last."""
    if len(times) <= most:
        return np.arange(len(times))
    wanted = np.linspace(times[0], times[-1], most)
    after = np.clip(np.searchsorted(times, wanted), 1, len(times) - 1)
    is_before_nearer = wanted - times[after - 1] < times[after] - wanted
    # An instant that is the nearest of several wanted times becomes one frame.
    return np.unique(np.where(is_before_nearer, after - 1, after))


def require_bodies(
    states: State, bodies: Mapping[str, object], times: np.ndarray | None = None
) -> None:
    """Raise a `ValueError` unless `states` has exactly the given bodies and, if `times` are given,
    their positions at each time: a user's trajectory may have other shapes."""
    in_motion, in_scene = sorted(states.bodies), sorted(bodies)
    remedy = "pass a state or a solution of this scene"
    require(in_motion == in_scene, "motion", in_motion, f"of the scene's bodies {in_scene}", remedy)
    if times is not None:
        expected = f"of shape ({len(times)}, 3), one row for each time"
        remedy = "pass a State, or a trajectory whose arrays have the times as first axis"
        for name, body in states.bodies.items():
            argument, shape = f"motion.states.bodies[{name!r}].position", np.shape(body.position)
            is_valid = len(times) > 0 and shape == (len(times), 3)
            require(is_valid, argument, shape, expected, remedy)
