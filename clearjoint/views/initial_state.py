"""Find a state in which a scene can be drawn, by following its joints from the ground."""

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from ..dynamics.assembly import assemble
from ..model.bodies import GROUND, State, body_state
from ..model.pen import Marker
from ..model.scene import Scene
from .survey import survey

CLOSED = 1e-6
"""A joint counts as closed if the distance of its two points, relative to their distance from the
bodies' centres, and the sine of the angle between its axes are at most this number."""
TURNS = (0.0, 0.7, -0.7, 1.6)
"""Angles of hinges, rad, which are tried one after another until the loops can be closed: at zero,
links may be in a dead-centre position."""
Pose: TypeAlias = tuple[np.ndarray, Rotation]
"""Position of a body's centre, (3,) m in global axes, and rotation from body to global axes."""


def initial_state(scene: Scene) -> tuple[State, bool]:
    """Return a state at rest that satisfies a scene's joints, and whether it satisfies all of them.

    Joints are followed from the ground: each places the next body so that points coincide and axes
    are parallel. `assemble` then closes loops.
    """
    joined = survey(scene).joined
    straight = _chained(scene, joined, TURNS[0])
    if all(_fits(straight, *pair) for pair in joined):
        return _state(scene, straight), True
    for turn in TURNS:
        try:
            return assemble(scene, _state(scene, _chained(scene, joined, turn))), True
        except ValueError:
            continue
    return _state(scene, straight), False


def _chained(scene: Scene, joined: Sequence[tuple[Marker, Marker]], turn: float) -> dict[str, Pose]:
    """Return the poses of all bodies, found by following the joints from the ground.

    **Arguments:** `joined`: markers on two bodies that a joint brings together; `turn`: angle of
    the first hinge, rad. Further hinges have angles of alternating sign and growing size.
    """
    poses: dict[str, Pose] = {GROUND: (np.zeros(3), Rotation.identity())}
    while len(poses) <= len(scene.bodies):
        pairs = [pair for pair in joined if (pair[0].body in poses) != (pair[1].body in poses)]
        if not pairs:
            unconnected = next(name for name in scene.bodies if name not in poses)
            poses[unconnected] = np.zeros(3), Rotation.identity()
            continue
        known, other = pairs[0] if pairs[0][0].body in poses else pairs[0][::-1]
        poses[other.body] = _joined(poses[known.body], known, other, turn)
        turn = -1.3 * turn
    return poses


def _state(scene: Scene, poses: Mapping[str, Pose]) -> State:
    numbers = {name: (poses[name][0], poses[name][1].as_quat(scalar_first=True)) for name in poses}
    return State({name: body_state(*numbers[name]) for name in scene.bodies})


def _joined(pose: Pose, known: Marker, other: Marker, angle: float) -> Pose:
    """Return the pose of the body of `other`, such that both markers coincide.

    **Arguments:** `pose`: of the body of `known`; `angle`: turn about the common axis, rad.
    """
    position, rotation = pose
    other_rotation = rotation
    if known.axis is not None and other.axis is not None:
        target, axis = rotation.apply(known.axis), rotation.apply(other.axis)
        about_hinge = Rotation.from_rotvec(angle * target / np.linalg.norm(target))
        other_rotation = about_hinge * _shortest(axis, target) * rotation
    point = position + rotation.apply(known.point)
    return point - other_rotation.apply(other.point), other_rotation


def _shortest(axis: np.ndarray, target: np.ndarray) -> Rotation:
    """Return the smallest rotation that makes `axis` parallel to `target`, in either sense."""
    parallel = target if axis @ target >= 0.0 else -target
    return Rotation.align_vectors(parallel, axis)[0]


def _fits(poses: Mapping[str, Pose], first: Marker, second: Marker) -> bool:
    """Return whether the points of two markers coincide and their axes are parallel."""
    points, axes = [], []
    for marker in (first, second):
        position, rotation = poses[marker.body]
        points.append(position + rotation.apply(marker.point))
        axes.append(None if marker.axis is None else rotation.apply(marker.axis))
    sizes = [np.linalg.norm(marker.point) for marker in (first, second)]
    fits = bool(np.linalg.norm(points[0] - points[1]) <= CLOSED * max(1e-3, *sizes))
    if axes[0] is None or axes[1] is None:
        return fits
    lengths = np.linalg.norm(axes[0]) * np.linalg.norm(axes[1])
    return fits and bool(np.linalg.norm(np.cross(axes[0], axes[1])) <= CLOSED * lengths)
