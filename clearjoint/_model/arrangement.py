"""Arrange the bodies of a scene by following its joints, for a first guess of its state.

The guess serves scenes without a complete state: to draw them, and to start `assemble`, which moves
the bodies until they satisfy all joints, including those of closed loops.
"""

from dataclasses import replace
from typing import TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from .bodies import GROUND, State, body_state
from .pen import Marker
from .scene import Scene
from .survey import survey

TOLERANCE = 1e-6
"""Tolerance of `satisfies_joints` for the sine of the angle between the two axes of a joint, and
for the distance between its two points divided by a length.

The length is the larger of the distances of the two points from the centres of mass of their bodies
(on the ground, from the origin), but at least 1 mm. The tolerance is far above rounding errors, and
far below the usual ratio of a clearance to the size of a body."""
Pose: TypeAlias = tuple[np.ndarray, Rotation]
"""Position of a body's centre of mass, (3,) m in global axes, and rotation from body to global
axes."""


def arranged_state(scene: Scene, given: State | None = None, angle: float = 0.0) -> State:
    """Return a state of all bodies of a scene, found by following its joints from the ground.

    Each joint places the next body, at rest, such that the two points of the joint coincide. The
    body's axes are parallel to those of the body before it, or turned by the smallest rotation that
    makes the axes of the joint parallel. The points and axes of a joint, one on each of its bodies,
    are those at which its method `draw` draws it. Joints that are drawn without such a pair of
    points, such as a massless rod (`DistanceJoint`) or a pair of gears, are ignored. Bodies that
    the remaining joints connect neither with the ground nor with a body of `given` form chains of
    their own. The first body of such a chain is at the origin, parallel to the global axes.

    A joint between two bodies that already have a place moves neither of them, so that a closed
    chain of bodies may stay open at one of its joints: see `satisfies_joints`.

    **Arguments:**

    - `given`: state of some of the scene's bodies, which is kept together with its entry speeds,
      work and bristles; none by default.
    - `angle`: rad, by which the first joint is turned about its axis. The angle of each further
      joint is -1.3 times that of the one before; a joint without an axis is not turned, but counts.
      With the default, zero, the links of a planar chain are parallel, which may be a singular
      position that `assemble` can't leave.
    """
    given = State({}) if given is None else given
    poses = _poses(given)
    joined = survey(scene).joined
    while missing := [name for name in scene.bodies if name not in poses]:
        # The next joint between a body that has a place and one that has none.
        pair = next((p for p in joined if (p[0].body in poses) != (p[1].body in poses)), None)
        if pair is None:
            poses[missing[0]] = np.zeros(3), Rotation.identity()
            continue
        known, other = pair if pair[0].body in poses else pair[::-1]
        poses[other.body] = _joined(poses[known.body], known, other, angle)
        # Equal angles of alternating sign would leave every second link parallel to the first.
        angle = -1.3 * angle
    bodies = {}
    for name in scene.bodies:
        position, rotation = poses[name]
        found = body_state(position, rotation.as_quat(scalar_first=True))
        bodies[name] = given.bodies.get(name, found)
    return replace(given, bodies=bodies)


def satisfies_joints(scene: Scene, state: State) -> bool:
    """Return whether the points and axes of a scene's joints fit together.

    Joints that close loops are tested too; joints that `arranged_state` ignores, such as a massless
    rod, are not. The two points of a joint must coincide, and if it has an axis on both bodies, the
    two axes must be parallel, in the same or the opposite sense, each within the tolerance
    `TOLERANCE`. The points of a sliding joint must coincide too, although its block could be
    elsewhere on the rail.

    **Arguments:** `state`: of all bodies of the scene.
    """
    poses = _poses(state)
    for pair in survey(scene).joined:
        (first, along), (second, along_second) = (_in_space(poses[one.body], one) for one in pair)
        # At least 1 mm, since the points may be at the centres of mass.
        size = max(1e-3, *(float(np.linalg.norm(one.point)) for one in pair))
        if np.linalg.norm(first - second) > TOLERANCE * size:
            return False
        if along is not None and along_second is not None:
            lengths = np.linalg.norm(along) * np.linalg.norm(along_second)
            if np.linalg.norm(np.cross(along, along_second)) > TOLERANCE * lengths:
                return False
    return True


def _poses(state: State) -> dict[str, Pose]:
    """Return the poses of the bodies of a state and of the ground, by name; a pose is a position
    and a rotation."""
    poses = {GROUND: (np.zeros(3), Rotation.identity())}
    for name, body in state.bodies.items():
        rotation = Rotation.from_quat(np.asarray(body.orientation), scalar_first=True)
        poses[name] = np.asarray(body.position), rotation
    return poses


def _in_space(pose: Pose, marker: Marker) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the point of a marker, (3,) m, and its axis, (3,), both in global axes.

    The axis is ``None`` if the marker has none.

    **Arguments:** `pose`: of the marker's body; `marker`: point and optional axis on this body.
    """
    position, rotation = pose
    axis = None if marker.axis is None else rotation.apply(marker.axis)
    return position + rotation.apply(marker.point), axis


def _joined(pose: Pose, known: Marker, other: Marker, angle: float) -> Pose:
    """Return the pose of the body of `other` that fits it to the body of `known`.

    The points of the two markers then coincide, and their axes, if both have one, are parallel. The
    body of `other` has the rotation of the body of `known`, changed as little as the axes require,
    and is then turned by `angle`.

    **Arguments:**

    - `pose`: of the body of `known`.
    - `known`, `other`: the markers of a joint on two bodies.
    - `angle`: rotation about the axis of `known`, rad; not used unless both markers have an axis.
    """
    rotation = pose[1]
    point, target = _in_space(pose, known)
    if target is not None and other.axis is not None:
        axis = rotation.apply(other.axis)
        # Axes are parallel in either sense; the smaller rotation is taken.
        shortest = Rotation.align_vectors(target if axis @ target >= 0.0 else -target, axis)[0]
        about_hinge = Rotation.from_rotvec(angle * target / np.linalg.norm(target))
        rotation = about_hinge * shortest * rotation
    return point - rotation.apply(other.point), rotation
