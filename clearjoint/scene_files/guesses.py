"""A first state for bodies of which a file says nothing."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..model.bodies import GROUND, BodyState, State, body_state
from ..model.scene import Scene


def guessed(scene: Scene, given: State) -> State:
    """The given state, and the bodies that it lacks at rest, parallel to the global frame.

    Each is put where a point of it lies on that of a body that is placed already, following the
    joints from the ground; one that no joint holds, in the origin.
    """
    placed: dict[str, BodyState] = dict(given.bodies)
    links = list(_links(scene))
    while len(placed) < len(scene.bodies):
        found = next((link for link in links if _leads_on(link, placed)), None)
        if found is None:
            name = next(name for name in scene.bodies if name not in placed)
            placed[name] = body_state(np.zeros(3))
        else:
            here, point_here, there, point_there = found
            placed[there] = body_state(_position(here, point_here, placed) - point_there)
    return replace(given, bodies={name: placed[name] for name in scene.bodies})


def _links(scene: Scene) -> Iterator[tuple[str, np.ndarray, str, np.ndarray]]:
    """Pairs of bodies with a point of each that a joint brings together, in both orders."""
    for joint in scene.joints.values():
        points = [(body, np.asarray(point)) for _, body, point in joint.attachments()]
        if len(points) == 2:
            (first, point_first), (second, point_second) = points
            yield first, point_first, second, point_second
            yield second, point_second, first, point_first


def _leads_on(link: tuple[str, np.ndarray, str, np.ndarray], placed: dict[str, BodyState]) -> bool:
    here, _, there, _ = link
    return (here == GROUND or here in placed) and there != GROUND and there not in placed


def _position(body: str, point: np.ndarray, placed: dict[str, BodyState]) -> np.ndarray:
    """The global position of a point of a placed body."""
    if body == GROUND:
        return point
    scalar, *vector = np.asarray(placed[body].orientation)
    across = 2.0 * np.cross(vector, point)
    return np.asarray(placed[body].position) + point + scalar * across + np.cross(vector, across)
