"""Where bodies are of which nobody has said it yet: as the joints put them, one after the other."""

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from ..dynamics.assembly import assemble
from ..model.bodies import GROUND, State, body_state
from ..model.pen import Marker
from ..model.scene import Scene
from .survey import survey

CLOSED = 1e-6
"""Distance of two points of a joint, over that from their bodies' centres, up to which they are in
one place; and the sine of the angle between axes."""


def placed(scene: Scene) -> tuple[State, bool]:
    """A state that a scene's joints leave possible, at rest, and whether it satisfies them all.

    Starting at the ground, each joint puts the body that it joins to one that has its place, with
    points and axes in one line and no other turn; then what loops leave open is closed.
    """
    joined = survey(scene).joined
    poses: dict[str, tuple[np.ndarray, Rotation]] = {GROUND: (np.zeros(3), Rotation.identity())}
    while len(poses) <= len(scene.bodies):
        pair = next((pair for pair in joined if _leads_on(pair, poses)), None)
        if pair is None:
            left = next(name for name in scene.bodies if name not in poses)
            poses[left] = np.zeros(3), Rotation.identity()
            continue
        here, there = pair if pair[0].body in poses else pair[::-1]
        poses[there.body] = _joined(poses[here.body], here, there)
    guess = State(
        {
            name: body_state(poses[name][0], poses[name][1].as_quat(scalar_first=True))
            for name in scene.bodies
        }
    )
    if all(_fits(poses, *pair) for pair in joined):
        return guess, True
    try:
        return assemble(scene, guess), True
    except ValueError:
        return guess, False


def _leads_on(pair: tuple[Marker, Marker], poses: dict[str, tuple[np.ndarray, Rotation]]) -> bool:
    return (pair[0].body in poses) != (pair[1].body in poses)


def _joined(
    pose: tuple[np.ndarray, Rotation], here: Marker, there: Marker
) -> tuple[np.ndarray, Rotation]:
    """Position and rotation of the body of `there`, by those of the body of `here`."""
    position, turn = pose
    own = turn
    if here.axis is not None and there.axis is not None:
        wanted, axis = turn.apply(here.axis), turn.apply(there.axis)
        own = _shortest(axis, wanted) * turn
    return position + turn.apply(here.point) - own.apply(there.point), own


def _shortest(axis: np.ndarray, wanted: np.ndarray) -> Rotation:
    """The shortest turn of an axis into another direction, or its opposite if that is nearer."""
    axis, wanted = axis / np.linalg.norm(axis), wanted / np.linalg.norm(wanted)
    across = np.cross(axis, wanted)
    sine, cosine = np.linalg.norm(across), float(axis @ wanted)
    if sine == 0.0:
        return Rotation.identity()
    return Rotation.from_rotvec(across / sine * np.arctan2(sine, abs(cosine)) * np.sign(cosine))


def _fits(poses: Mapping[str, tuple[np.ndarray, Rotation]], first: Marker, second: Marker) -> bool:
    """Whether two points are in one place, and their axes in one line."""
    places, axes = [], []
    for marker in (first, second):
        position, turn = poses[marker.body]
        places.append(position + turn.apply(marker.point))
        axes.append(None if marker.axis is None else turn.apply(marker.axis))
    sizes = [np.linalg.norm(marker.point) for marker in (first, second)]
    fits = bool(np.linalg.norm(places[0] - places[1]) <= CLOSED * max(1e-3, *sizes))
    if axes[0] is None or axes[1] is None:
        return fits
    lengths = np.linalg.norm(axes[0]) * np.linalg.norm(axes[1])
    return fits and bool(np.linalg.norm(np.cross(axes[0], axes[1])) <= CLOSED * lengths)
