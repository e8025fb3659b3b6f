"""Where bodies are of which nobody has said it yet: as the joints put them, one after the other."""

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
"""Distance of two points of a joint, over that from their bodies' centres, up to which they are in
one place; and the sine of the angle between axes."""


TURNS = (0.0, 0.7, -0.7, 1.6)
"""Angles of hinges, rad, tried in turn where loops don't close from the first: stretched out, as
bodies may be there, they are in a dead position."""
Placement: TypeAlias = tuple[np.ndarray, Rotation]
"""Of a body: its position, m, and its turn from body to global axes."""


def placed(scene: Scene) -> tuple[State, bool]:
    """A state that a scene's joints leave possible, at rest, and whether it satisfies them all.

    Starting at the ground, each joint puts the body that it joins to one that has its place, with
    points and axes in one line and no other turn; then what loops leave open is closed.
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


def _chained(
    scene: Scene, joined: Sequence[tuple[Marker, Marker]], turn: float
) -> dict[str, Placement]:
    """Each body at the one that has its place before, every second hinge turned the other way."""
    poses: dict[str, Placement] = {GROUND: (np.zeros(3), Rotation.identity())}
    while len(poses) <= len(scene.bodies):
        pair = next((pair for pair in joined if _leads_on(pair, poses)), None)
        if pair is None:
            left = next(name for name in scene.bodies if name not in poses)
            poses[left] = np.zeros(3), Rotation.identity()
            continue
        here, there = pair if pair[0].body in poses else pair[::-1]
        poses[there.body] = _joined(poses[here.body], here, there, turn)
        turn = -1.3 * turn
    return poses


def _state(scene: Scene, poses: Mapping[str, Placement]) -> State:
    numbers = {name: (poses[name][0], poses[name][1].as_quat(scalar_first=True)) for name in poses}
    return State({name: body_state(*numbers[name]) for name in scene.bodies})


def _leads_on(pair: tuple[Marker, Marker], poses: dict[str, Placement]) -> bool:
    return (pair[0].body in poses) != (pair[1].body in poses)


def _joined(pose: Placement, here: Marker, there: Marker, angle: float) -> Placement:
    """Where the body of `there` is, by where that of `here` is, turned by an angle, rad."""
    position, turn = pose
    own = turn
    if here.axis is not None and there.axis is not None:
        wanted, axis = turn.apply(here.axis), turn.apply(there.axis)
        about = Rotation.from_rotvec(angle * wanted / np.linalg.norm(wanted))
        own = about * _shortest(axis, wanted) * turn
    return position + turn.apply(here.point) - own.apply(there.point), own


def _shortest(axis: np.ndarray, wanted: np.ndarray) -> Rotation:
    """The shortest turn of an axis into another direction, or its opposite if that is nearer."""
    axis, wanted = axis / np.linalg.norm(axis), wanted / np.linalg.norm(wanted)
    across = np.cross(axis, wanted)
    sine, cosine = np.linalg.norm(across), float(axis @ wanted)
    if sine == 0.0:
        return Rotation.identity()
    return Rotation.from_rotvec(across / sine * np.arctan2(sine, abs(cosine)) * np.sign(cosine))


def _fits(poses: Mapping[str, Placement], first: Marker, second: Marker) -> bool:
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
