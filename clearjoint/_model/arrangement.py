"""Arrange the bodies of a scene by following its joints, for a first guess of its state."""

from dataclasses import replace
from typing import TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from .bodies import GROUND, State, body_state
from .pen import Marker
from .scene import Scene
from .survey import survey

TOLERANCE = 1e-6
"""Tolerance of `satisfies_joints` for the sine of the angle between a joint's axes, and for the
distance between its points, relative to the larger of their distances from the bodies' origins, but
to at least 1 mm. It is far above rounding errors, and far below usual clearances."""
Pose: TypeAlias = tuple[np.ndarray, Rotation]
"""Position of a body's centre of mass, (3,) m, global, and rotation from body to global axes."""


def arranged_state(scene: Scene, given: State | None = None, angle: float = 0.0) -> State:
    """Return a state of all bodies of a scene, found by following its joints from the ground.

    Each joint places the next body, at rest, such that the joint's two points coincide. The body's
    axes are parallel to those of the body before it, or turned by the smallest rotation that makes
    the joint's axes parallel. A joint's points and axes are those of the two markers at which its
    `draw` draws it; joints that are drawn without such a pair, such as a `DistanceJoint` or gears,
    are ignored. The first body of a chain that is connected neither with the ground nor with a body
    of `given` is at the origin, parallel to the global axes. A closed chain may stay open at one of
    its joints, which `satisfies_joints` tests.

    **Arguments:**

    - `given`: state of some bodies; its other entries, such as entry speeds and work, are kept too.
      ``None``, the default, for no bodies.
    - `angle`: rad, by which the first joint is turned about its axis. The angle is multiplied by
      -1.3 for each further joint; joints without an axis count too, but are not turned. At zero,
      the default, the links of a planar chain are parallel, perhaps in a singular position that
      `assemble` can't leave.
    """
    given = State({}) if given is None else given
    poses = _poses(given)
    joined = survey(scene).joined
    while missing := [name for name in scene.bodies if name not in poses]:
        # The next joint between a body that has a place and one that has none.
        pair = next((p for p in joined if (p[0].body in poses) != (p[1].body in poses)), None)
        if pair is None:
            # No joint leads to the other bodies: one of them begins a chain of its own.
            poses[missing[0]] = np.zeros(3), Rotation.identity()
            continue
        placed, other = pair if pair[0].body in poses else pair[::-1]
        poses[other.body] = _joined(poses[placed.body], placed, other, angle)
        # With the factor -1, every second link would be parallel to the first.
        angle = -1.3 * angle
    bodies = {}
    for name in scene.bodies:
        position, rotation = poses[name]
        at_rest = body_state(position, rotation.as_quat(scalar_first=True))
        bodies[name] = given.bodies.get(name, at_rest)
    return replace(given, bodies=bodies)


def satisfies_joints(scene: Scene, state: State) -> bool:
    """Return whether each joint's points coincide and its axes are parallel, within `TOLERANCE`.
    Joints that close loops are tested too; joints that `arranged_state` ignores are not."""
    poses = _poses(state)
    for pair in survey(scene).joined:
        (point, axis), (other_point, other_axis) = (_in_space(poses[m.body], m) for m in pair)
        # At least 1 mm, since the points may be at the centres of mass.
        size = max(1e-3, *(float(np.linalg.norm(marker.point)) for marker in pair))
        if np.linalg.norm(point - other_point) > TOLERANCE * size:
            return False
        if axis is not None and other_axis is not None:
            lengths = np.linalg.norm(axis) * np.linalg.norm(other_axis)
            if np.linalg.norm(np.cross(axis, other_axis)) > TOLERANCE * lengths:
                return False
    return True


def _poses(state: State) -> dict[str, Pose]:
    poses = {GROUND: (np.zeros(3), Rotation.identity())}
    for name, body in state.bodies.items():
        rotation = Rotation.from_quat(np.asarray(body.orientation), scalar_first=True)
        poses[name] = np.asarray(body.position), rotation
    return poses


def _in_space(pose: Pose, marker: Marker) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the point of a marker, (3,) m, and its axis, (3,) or ``None``, in global axes."""
    position, rotation = pose
    axis = None if marker.axis is None else rotation.apply(marker.axis)
    return position + rotation.apply(marker.point), axis


def _joined(pose: Pose, placed: Marker, other: Marker, angle: float) -> Pose:
    """Return the pose of a body that a joint connects with a placed body, which has the given pose.
    The point of the marker `other`, on the body, coincides with that of the marker `placed`, on the
    placed body. If both markers have an axis, the body is turned from the placed body's orientation
    by the smallest rotation that makes the axes parallel, then by `angle`, rad, about the axis."""
    _, rotation = pose
    point, target = _in_space(pose, placed)
    if target is not None and other.axis is not None:
        axis = rotation.apply(other.axis)
        # Axes are parallel in either sense; the smaller rotation is taken.
        shortest = Rotation.align_vectors(target if axis @ target >= 0.0 else -target, axis)[0]
        about_hinge = Rotation.from_rotvec(angle * target / np.linalg.norm(target))
        rotation = about_hinge * shortest * rotation
    return point - rotation.apply(other.point), rotation
