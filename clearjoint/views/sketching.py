"""Solids of a scene: bodies around their joints, and the joints as symbols."""

from collections.abc import Collection, Mapping
from itertools import cycle

import numpy as np
from jaxtyping import Float

from ..fields.types import ArrayLike, Single, Triple
from ..math.rotations import transverse_axes
from ..math.vectors import Vector
from ..model.bodies import GROUND, Body
from ..model.pen import AbstractPen, Marker
from ..model.scene import Scene
from . import meshes
from .journals import STICKS_OUT, WALL, DrawnJournal, drawn_ball, drawn_journal
from .meshes import Mesh, frame_about, pose_at
from .motion import BodyPoses
from .parts import BODIES, CLEAR, GROUND_COLOUR, METAL, DrawnPart, OnBodies, between, frames
from .proportions import Proportions
from .survey import BodySolid, equivalent_solid

NEAR = 1e-3
"""Distance of two points, over the size of the mechanism, up to which they are one."""
SHORT = 0.5
"""Length of a bar over that of the body's equivalent solid up to which the solid is drawn too."""


class SketchingPen(AbstractPen):
    """Collects the parts of a picture.

    `element` is the name of the joint or force that draws. Of each joint with play, `journals` has
    where its journal is drawn; `loads` are points and forces, (N, 3) m and N, of constant loads.
    """

    def __init__(self, poses: BodyPoses, proportions: Proportions, colours: Mapping[str, str]):
        self.element = ""
        self.journals: dict[str, DrawnJournal] = {}
        self.loads: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self.drawn: set[str] = set()
        self._poses, self._sizes, self._colours = poses, proportions, colours
        self._fixed, self._moving = OnBodies(), list[DrawnPart]()
        self._corners: dict[str, list[np.ndarray]] = {name: [] for name in poses.poses}
        self._shaped: set[str] = set()

    def parts(self) -> list[DrawnPart]:
        """All that was drawn."""
        return self._fixed.parts(dict(self._poses.poses)) + self._moving

    # What elements say.

    def mark(self, place: Marker) -> None:
        """A small ball."""
        self._fix(place, meshes.ball(1.3 * self._sizes.bar), METAL)
        self._hold(place)

    def weld(self, first: Marker, second: Marker) -> None:
        """A cube."""
        self._fix(first, meshes.box([2.6 * self._sizes.bar] * 3), METAL)
        self._hold(first, second)

    def pin(self, first: Marker, second: Marker) -> None:
        """A pin that sticks out of both bodies."""
        bar = self._sizes.bar
        self._fix(first, meshes.cylinder(0.7 * bar, 6.0 * bar), METAL)
        for place in (first, second):
            behind = self._behind(place) * (3.5 * bar if place.body == GROUND else 0.0)
            self._hold(place._replace(point=np.asarray(place.point) + behind))

    def ball(self, first: Marker, second: Marker) -> None:
        """A ball larger than the bars."""
        self._fix(first, meshes.ball(1.6 * self._sizes.bar), METAL)
        self._hold(first, second)

    def cross(self, first: Marker, second: Marker) -> None:
        """Two pins."""
        arm = meshes.cylinder(0.6 * self._sizes.bar, 6.0 * self._sizes.bar)
        for place in (first, second):
            self._fix(place, arm, METAL)
        self._hold(first, second)

    def slide(self, rail: Marker, block: Marker, *, turning: bool) -> None:
        """A thin rail as long as the way on it, and a block or a sleeve."""
        bar, axis = self._sizes.bar, rail.along()
        low, high = self._way(rail, block, axis)
        middle = np.asarray(rail.point) + axis * (0.5 * (low + high))
        line = meshes.cylinder(0.4 * bar, high - low + 8.0 * bar)
        self._fix(Marker(rail.body, middle, axis), line, self._colours[rail.body])
        size = 2.0 * bar
        shape = meshes.box((size, size, 2.0 * size))
        if turning:
            shape = meshes.tube(0.6 * bar, 1.5 * bar, 3.0 * bar)
        turned = self._poses.poses[rail.body] @ pose_at((0.0, 0.0, 0.0), frame_about(axis))
        turned[:, :3, 3] = self._poses.point(block.body, block.point)
        self._moving.append(DrawnPart(block.body, shape, turned, self._colours[block.body]))
        self._hold(rail, block)

    def plane(self, plane: Marker, point: Marker) -> None:
        """A square to look through, and a ball on it."""
        bar = self._sizes.bar
        square = meshes.box((10.0 * bar, 10.0 * bar, 0.2 * bar))
        self._fix(plane, square, self._colours[plane.body], CLEAR)
        self._fix(point, meshes.ball(1.2 * bar), METAL)
        self._hold(plane, point)

    def rod(self, first: Marker, second: Marker) -> None:
        """A thin cylinder."""
        rod = meshes.cylinder(0.5 * self._sizes.bar, 1.0).moved(pose_at((0.0, 0.0, 0.5)))
        self._span(rod, *self._ends(first, second))

    def spring(self, first: Marker, second: Marker) -> None:
        """A coil."""
        bar, ends = self._sizes.bar, self._ends(first, second)
        length = max(float(np.linalg.norm(ends[1] - ends[0], axis=1).mean()), bar)
        self._span(meshes.coil(1.2 * bar, 0.25 * bar, length), *ends)

    def load(self, place: Marker, force: Triple) -> None:
        """An arrow, as long as the forces' scale makes it."""
        points = self._poses.point(place.body, place.point)
        self.loads[self.element] = points, np.broadcast_to(force, points.shape)
        self._hold(place)

    def bearing(
        self,
        bearing: Marker,
        journal: Marker,
        *,
        radius: Single | None,
        clearance: Single,
        length: Single,
    ) -> None:
        """An open cylinder, and a cylinder in it off the middle by the exaggerated offset."""
        sizes = self._sizes
        bore = sizes.bore(None if radius is None else float(radius))
        outer, wide = bore * (1.0 + WALL), float(length) * sizes.bearing_scale
        drawn = drawn_journal(
            self._poses,
            bearing,
            journal,
            radius=bore - float(clearance) * sizes.clearance_scale,
            length=float(length),
            clearance_scale=sizes.clearance_scale,
            bearing_scale=sizes.bearing_scale,
        )
        ring = meshes.tube(bore, outer, wide)
        self._fix(bearing, ring, self._colours[bearing.body])
        pin = meshes.cylinder(drawn.radius, STICKS_OUT * wide)
        self._moving.append(DrawnPart(self.element, pin, drawn.poses, METAL, is_journal=True))
        self.journals[self.element] = drawn
        behind = self._behind(journal) * (0.5 * wide + 1.2 * sizes.bar)
        self._hold(journal._replace(point=np.asarray(journal.point) + behind))
        self._hold(bearing, around=outer)

    def socket(self, socket: Marker, ball: Marker, *, radius: Single, clearance: Single) -> None:
        """A shell to look through, and a ball in it off the middle by the exaggerated offset."""
        sizes = self._sizes
        bore = sizes.bore(float(radius))
        shell = meshes.ball(bore).moved(pose_at(np.asarray(socket.point)))
        self._fixed.add(socket.body, shell, self._colours[socket.body], CLEAR)
        inner = meshes.ball(bore - float(clearance) * sizes.clearance_scale)
        poses = drawn_ball(self._poses, socket, ball, sizes.clearance_scale)
        self._moving.append(DrawnPart(self.element, inner, poses, METAL, is_journal=True))
        self._hold(socket, around=bore)
        self._hold(ball)

    def walls(self, middle: Marker, runner: Marker, normal: Triple, *, distance: Single) -> None:
        """Two plates as long as the way of the runner between them."""
        bar, depth = self._sizes.bar, 8.0 * self._sizes.bar
        frame = self._in_plane(middle.body, normal)
        low, high = self._way(middle, runner, frame[:, 0])
        reach, room = high - low + 2.0 * float(distance) + 2.0 * bar, float(distance)
        centre = np.asarray(middle.point) + frame[:, 0] * (0.5 * (low + high))
        for side in (-1.0, 1.0):
            at = centre + frame[:, 1] * (0.5 * side * (room + bar))
            plate = meshes.box((reach, bar, depth)).moved(pose_at(at, frame))
            self._fixed.add(middle.body, plate, self._colours[middle.body])
        self._corners[middle.body].append(np.asarray(centre))
        self._shaped.add(middle.body)
        self.drawn.add(self.element)

    def block(self, centre: Marker, normal: Triple, *, length: Single, height: Single) -> None:
        """A box."""
        across, upwards = centre.along(), _unit(normal)
        frame = np.stack([across, upwards, np.cross(across, upwards)], axis=1)
        box = meshes.box((float(length), float(height), 5.0 * self._sizes.bar))
        self._fixed.add(
            centre.body, box.moved(pose_at(centre.point, frame)), self._colours[centre.body]
        )
        self._shaped.add(centre.body)
        self._hold(centre)

    def roller(self, centre: Marker, *, radius: Single) -> None:
        """A cylinder across the plane that one looks at."""
        axis = self._components(centre.body, self._sizes.front)
        pin = meshes.cylinder(float(radius), 9.0 * self._sizes.bar)
        self._fix(centre._replace(axis=axis), pin, METAL)
        self._hold(centre)

    def gear(self, centre: Marker, *, radius: Single, teeth: Single, phase: Single) -> None:
        """A wheel with teeth."""
        frame = _toothed_frame(centre.along(), float(phase))
        count = round(abs(float(teeth)))
        wheel = meshes.gear(float(radius), count, 2.4 * self._sizes.bar)
        self._fixed.add(
            centre.body, wheel.moved(pose_at(centre.point, frame)), self._colours[centre.body]
        )
        self._shaped.add(centre.body)
        self._hold(centre)

    # What bodies are.

    def body(self, name: str, body: Body) -> None:
        """A skin around the joints of a body; its equivalent solid where that is too little."""
        points = self._distinct(name)
        if name in self._shaped and len(points) <= 1:
            return
        solid = equivalent_solid(body)
        size = NEAR * self._sizes.size
        if len(points) <= 1 or np.ptp(points, axis=0).max() < SHORT * solid.sides.max():
            self.solid(name, body)
            points = np.vstack([points, np.zeros((1, 3))])
        if np.ptp(points, axis=0).max() > size:
            skin = meshes.hull(points, self._sizes.bar)
            self._fixed.add(name, skin, self._colours[name])

    def solid(self, name: str, body: Body) -> None:
        """The solid of a body's mass and inertia, to look through unless it is as thin as a bar."""
        solid = equivalent_solid(body)
        thin = np.sort(solid.sides)[1] <= 2.0 * self._sizes.bar
        shape = self._solid_shape(solid).moved(pose_at((0.0, 0.0, 0.0), solid.axes))
        self._fixed.add(name, shape, self._colours[name], 1.0 if thin else CLEAR)

    def centre_of_mass(self, name: str) -> None:
        """A black ball in the origin of a body's frame, larger than its bar."""
        self._fixed.add(name, meshes.ball(1.5 * self._sizes.bar), "#000000")

    def given(self, name: str, mesh: Mesh) -> None:
        """A surface of a user's, in body axes, in the place of the skin."""
        self._fixed.add(name, mesh, self._colours[name])
        self._shaped.add(name)

    def ground(self, down: Float[np.ndarray, "3"]) -> None:
        """A stand under each of the ground's joints."""
        bar = self._sizes.bar
        frame = frames(down[None], self._sizes.front[None] + 1e-6)[0, :3, :3]
        frame = np.stack([-frame[:, 1], frame[:, 0], down], axis=1)
        for point in self._distinct(GROUND):
            stand = meshes.pyramid(4.0 * bar, 5.0 * bar, 2.5 * bar).moved(pose_at(point, frame))
            self._fixed.add(GROUND, stand, GROUND_COLOUR)

    def _solid_shape(self, solid: BodySolid) -> Mesh:
        first, second, third = np.maximum(solid.sides, 2.0 * self._sizes.bar).tolist()
        if solid.round:
            return meshes.cylinder(0.5 * first, third)
        return meshes.box((first, second, third))

    def _distinct(self, name: str) -> np.ndarray:
        """Corners of a body, (M, 3) m, of which none are nearly the same."""
        found: list[np.ndarray] = []
        for point in self._corners[name]:
            apart = [np.linalg.norm(point - other) for other in found]
            if min(apart, default=np.inf) > NEAR * self._sizes.size:
                found.append(point)
        return np.reshape(found, (-1, 3))

    # How it is done.

    def _fix(self, place: Marker, mesh: Mesh, colour: str, opacity: float = 1.0) -> None:
        """Fix a solid about z to a place, along its axis if it has one."""
        turn = None if place.axis is None else frame_about(place.along())
        moved = mesh.moved(pose_at(place.point, turn))
        self._fixed.add(place.body, moved, colour, opacity)

    def _ends(self, first: Marker, second: Marker) -> tuple[np.ndarray, np.ndarray]:
        """Global places, (N, 3) m, of what reaches from one to the other."""
        self._hold(first, second)
        start, end = (self._poses.point(marker.body, marker.point) for marker in (first, second))
        return start, end

    def _span(self, mesh: Mesh, starts: np.ndarray, ends: np.ndarray) -> None:
        """Stretch a solid along z between two points."""
        self._moving.append(DrawnPart(self.element, mesh, between(starts, ends, 1.0), METAL))

    def _hold(self, *places: Marker, around: float = 0.0) -> None:
        """Have bodies reach to places, or to within a distance of them, m."""
        self.drawn.add(self.element)
        for place in places:
            point = np.asarray(place.point, dtype=float)
            if around:
                point = point + self._way_out(place, around)
            self._corners[place.body].append(point)

    def _way_out(self, place: Marker, distance: float) -> np.ndarray:
        """From a bearing's centre to its wall, towards the rest of the body, or down."""
        point = np.asarray(place.point, dtype=float)
        inwards = -self._sizes.up if place.body == GROUND else -point
        if place.axis is not None:
            axis = place.along()
            inwards = inwards - axis * (inwards @ axis)
        size = np.linalg.norm(inwards)
        return inwards * (distance / size) if size > distance else np.zeros(3)

    def _behind(self, place: Marker) -> np.ndarray:
        """The direction of a place's axis away from the viewer at first, in body axes."""
        axis = place.along()
        seen = self._poses.direction(place.body, axis)[0] @ self._sizes.front
        return -axis if seen >= 0.0 else axis

    def _components(self, body: str, direction: np.ndarray) -> np.ndarray:
        """Components in body axes, at first, of a global direction."""
        return self._poses.poses[body][0, :3, :3].T @ direction

    def _in_plane(self, body: str, normal: Triple) -> np.ndarray:
        """Axes along a wall, along its normal, and across the plane that one looks at."""
        upwards = _unit(normal)
        along = np.cross(upwards, self._components(body, self._sizes.front))
        along = _unit(along)
        return np.stack([along, upwards, np.cross(along, upwards)], axis=1)

    def _way(self, base: Marker, runner: Marker, axis: np.ndarray) -> tuple[float, float]:
        """Least and greatest distance of a runner along an axis of another body, m."""
        apart = self._poses.point(runner.body, runner.point)
        apart = apart - self._poses.point(base.body, base.point)
        along = np.sum(apart * self._poses.direction(base.body, axis), axis=1)
        return float(along.min()), float(along.max())


def sketch(
    scene: Scene,
    poses: BodyPoses,
    proportions: Proportions,
    given: Mapping[str, Mesh],
    *,
    centres: bool,
    solids: bool,
) -> SketchingPen:
    """All parts of a scene but arrows.

    **Arguments:** `given`: surfaces of bodies by name. `centres`, `solids`: whether to add centres
    of mass and equivalent solids.
    """
    pen = SketchingPen(poses, proportions, colours(scene.bodies))
    for name, mesh in given.items():
        pen.given(name, mesh)
    for family in (scene.joints, scene.forces):
        for name, element in family.items():
            pen.element = name
            element.draw(pen)
    for name, body in scene.bodies.items():
        if name not in given:
            pen.body(name, body)
        if centres:
            pen.centre_of_mass(name)
        if solids:
            pen.solid(name, body)
    pen.ground(-proportions.up)
    return pen


def colours(bodies: Collection[str]) -> dict[str, str]:
    """A colour of each body, and of the ground."""
    return dict(zip(bodies, cycle(BODIES), strict=False)) | {GROUND: GROUND_COLOUR}


def _unit(vector: ArrayLike) -> np.ndarray:
    numbers = np.asarray(vector, dtype=float)
    return numbers / np.linalg.norm(numbers)


def _toothed_frame(along: np.ndarray, phase: float) -> np.ndarray:
    """Axes whose first one is turned by the phase from the first of an axis' transverse axes."""
    numbers = transverse_axes(Vector(*(float(part) for part in along)))[0]
    first = np.array([float(part) for part in (numbers.x, numbers.y, numbers.z)])
    second = np.cross(along, first)
    turned = first * np.cos(phase) + second * np.sin(phase)
    return np.stack([turned, np.cross(along, turned), along], axis=1)
