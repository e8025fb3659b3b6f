"""Make the solids of a view: bodies, symbols of joints, and journals with enlarged clearances."""

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from itertools import cycle

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from typing_extensions import override

from .._fields.types import ArrayLike, Single, Triple
from .._math.rotations import transverse_axes
from .._math.vectors import Vector
from .._model.bodies import GROUND, Body
from .._model.clearance_joints.journal_bases import SIDES
from .._model.pen import AbstractPen, Marker
from .._model.profiles import AbstractProfile
from .._model.scene import Scene
from . import meshes
from .meshes import (
    BODIES,
    CLEAR,
    GROUND_COLOUR,
    METAL,
    DrawnPart,
    Mesh,
    between,
    frame_about,
    frames,
    pose_at,
    still,
)
from .poses import BodyPoses
from .proportions import Proportions, equivalent_solid

WALL = 0.22
"""Drawn thickness of a bearing's wall, as a fraction of the bearing's drawn radius."""
CORNERS = 180
"""Number of corners of a drawn bearing or journal that deviates from a circle."""


@dataclass(frozen=True)
class DrawnJournal:
    """A journal as it is drawn, with enlarged eccentricity.

    - `ends`: (2, N, 3), centres of bases V and W in N frames. The cylinder protrudes beyond both.
    - `poses`: (N, 4, 4), to global axes from axes at the journal's middle, with z along its axis
      and x in the direction of the profile's angle zero.
    - `radius`: of the drawn circle. `profile`: deviation of the true journal from its circle, None
      for a circle; `scale`: drawn size of this deviation divided by its true size.
    """

    ends: Float[np.ndarray, "2 N 3"]
    poses: Float[np.ndarray, "N 4 4"]
    radius: float
    profile: AbstractProfile | None
    scale: float

    def touching_point(
        self, position: float, normal: Float[np.ndarray, "N 3"]
    ) -> Float[np.ndarray, "N 3"]:
        """Return the point at which the drawn journal touches the drawn bearing in each frame.
        `position`: of the contact on the axis, from -1 at base V to 1 at base W; `normal`: unit
        vectors from the axis to the contact points."""
        centre = 0.5 * ((1.0 - position) * self.ends[0] + (1.0 + position) * self.ends[1])
        if self.profile is None:
            return centre + self.radius * normal
        # p is the journal's support function: the distance from the centre to the tangent that is
        # perpendicular to the normal, as a function of the normal's angle. From the centre, the
        # point is p along the normal plus, perpendicular to it, the derivative of p by the angle.
        x, y, axis = (self.poses[:, :3, k] for k in range(3))
        angles = np.arctan2(np.sum(y * normal, axis=1), np.sum(x * normal, axis=1))
        deviation = self.profile.at(angles)
        outward = self.radius + self.scale * np.asarray(deviation.value)[:, None]
        beside = self.scale * np.asarray(deviation.slope)[:, None]
        return centre + outward * normal + beside * np.cross(axis, normal)


NEAR = 1e-3
"""Distance up to which points of a body count as equal, as a fraction of the mechanism's size."""


class SketchingPen(AbstractPen):
    """Pen with which joints and forces draw themselves, and which makes the parts of a view.

    The methods from `mark` to `gear` add solids (`load` only a load), and note the points of their
    markers (a `Marker` is a point, and maybe an axis, fixed to a body). The method `body` then
    draws a body as a bar: the convex hull of balls around these points.

    - `element`: name of the joint or force that is being drawn.
    - `journals`: drawn journals, by the joint's name; the last one of a joint with several.
    - `loads`: for each load, the name of its element, and points, (N, 3) m, and forces, (N, 3) N.
    - `drawn`: names of the joints and forces that have been drawn.
    """

    def __init__(self, poses: BodyPoses, proportions: Proportions, colours: Mapping[str, str]):
        self.element = ""
        self.journals: dict[str, DrawnJournal] = {}
        self.loads: list[tuple[str, tuple[np.ndarray, np.ndarray]]] = []
        self.drawn: set[str] = set()
        self._poses, self._sizes, self._colours = poses, proportions, colours
        self._bar = proportions.bar
        # Solids that are fixed to bodies, of which all those with the same body, colour and opacity
        # become one part; and parts with poses of their own, such as journals.
        self._fixed: dict[tuple[str, str, float], list[Mesh]] = {}
        self._moving: list[DrawnPart] = []
        # Points, (3,) m in body axes, that the hull of each body contains.
        self._corners: dict[str, list[np.ndarray]] = {name: [] for name in poses.poses}
        # Bodies with blocks, gears, walls or a given mesh, which may need no bar; and those whose
        # solid is drawn already, since each is drawn once.
        self._shaped: set[str] = set()
        self._solid: set[str] = set()

    def parts(self) -> list[DrawnPart]:
        return [
            DrawnPart(body, meshes.joined(solids), still(self._poses.poses[body]), colour, opacity)
            for (body, colour, opacity), solids in self._fixed.items()
        ] + self._moving

    @override
    def mark(self, marker: Marker) -> None:
        self._fix(marker, meshes.ball(1.3 * self._bar), METAL)
        self._hold(marker)

    @override
    def weld(self, first: Marker, second: Marker) -> None:
        self._fix(first, meshes.box([2.6 * self._bar] * 3), METAL)
        self._hold(first, second)

    @override
    def pin(self, first: Marker, second: Marker) -> None:
        self._fix(first, meshes.cylinder(0.7 * self._bar, 6.0 * self._bar), METAL)
        for marker in (first, second):
            # The stands of the ground are behind the mechanism, as seen by the viewer.
            behind = 3.5 * self._bar if marker.body == GROUND else 0.0
            self._hold(self._moved_back(marker, behind))

    @override
    def ball(self, first: Marker, second: Marker) -> None:
        self._fix(first, meshes.ball(1.6 * self._bar), METAL)
        self._hold(first, second)

    @override
    def cross(self, first: Marker, second: Marker) -> None:
        for marker in (first, second):
            self._fix(marker, meshes.cylinder(0.6 * self._bar, 6.0 * self._bar), METAL)
        self._hold(first, second)

    @override
    def slide(self, rail: Marker, block: Marker, *, turning: bool) -> None:
        bar, axis = self._bar, rail.along()
        low, high = self._range(rail, block, axis)
        middle = np.asarray(rail.point) + axis * (0.5 * (low + high))
        # The rail is longer than the motion by four radii of a bar at both ends, so that it is seen
        # on both sides of the block.
        rod = meshes.cylinder(0.4 * bar, high - low + 8.0 * bar)
        self._fix(Marker(rail.body, middle, axis), rod)
        shape = meshes.box((2.0 * bar, 2.0 * bar, 4.0 * bar))
        if turning:
            shape = meshes.tube(0.6 * bar, 1.5 * bar, 3.0 * bar)
        # The block is oriented like the rail, but moves with its own body.
        poses = self._poses.poses[rail.body] @ pose_at((0.0, 0.0, 0.0), frame_about(axis))
        poses[:, :3, 3] = self._poses.point(block.body, block.point)
        self._moving.append(DrawnPart(block.body, shape, poses, self._colours[block.body]))
        self._hold(rail, block)

    @override
    def plane(self, plane: Marker, point: Marker) -> None:
        square = meshes.box((10.0 * self._bar, 10.0 * self._bar, 0.2 * self._bar))
        self._fix(plane, square, opacity=CLEAR)
        self._fix(point, meshes.ball(1.2 * self._bar), METAL)
        self._hold(plane, point)

    @override
    def rod(self, first: Marker, second: Marker) -> None:
        rod = meshes.cylinder(0.5 * self._bar, 1.0).moved(pose_at((0.0, 0.0, 0.5)))
        self._span(rod, *self._ends(first, second))

    @override
    def spring(self, first: Marker, second: Marker) -> None:
        start, end = self._ends(first, second)
        # The wire is round at the mean length, and stretched with the spring in other frames.
        length = max(float(np.linalg.norm(end - start, axis=1).mean()), self._bar)
        self._span(meshes.coil(1.2 * self._bar, 0.25 * self._bar, length), start, end)

    @override
    def load(self, marker: Marker, force: Triple | Callable[[jax.Array], Triple]) -> None:
        """Add a load to `loads`, with its force in each frame. A view of a single state shows the
        force at time zero. The arrow is made later, when the scale of forces is known."""
        points = self._poses.point(marker.body, marker.point)
        if callable(force):
            times = np.zeros(1) if self._poses.times is None else self._poses.times
            forces = np.asarray(jax.vmap(lambda t: jnp.asarray(force(t)))(times))
        else:
            forces = np.asarray(force)
        self.loads.append((self.element, (points, np.broadcast_to(forces, points.shape))))
        self._hold(marker)

    @override
    def bearing(
        self,
        bearing: Marker,
        journal: Marker,
        *,
        radius: Single | None,
        clearance: Single,
        length: Single,
        profiles: tuple[AbstractProfile | None, AbstractProfile | None] = (None, None),
    ) -> None:
        """Draw the bearing as an open cylinder, and the journal in it.

        Clearance, eccentricity and deviations from circles are multiplied by
        `Proportions.clearance_scale`, length and known radius of the bearing by
        `Proportions.bearing_scale`. So the drawn journal touches the drawn wall where the true
        journal touches the true wall.
        """
        scale = self._sizes.clearance_scale
        drawn_length = float(length) * self._sizes.bearing_scale
        bore = self._sizes.bore(None if radius is None else float(radius))
        # Drawn radii of the journal and of the bearing's outside.
        journal_radius, outer = bore - float(clearance) * scale, bore * (1.0 + WALL)
        wall_profile, journal_profile = profiles
        if wall_profile is None:
            self._fix(bearing, meshes.tube(bore, outer, drawn_length))
        else:
            inner_edge = self._edge(bore, wall_profile)
            distances = np.linalg.norm(inner_edge, axis=1)  # from the axis
            # The wall keeps half of its thickness where it is worn deepest.
            outer = max(outer, distances.max() + 0.5 * WALL * bore)
            outer_edge = outer * inner_edge / distances[:, None]
            frame = _transverse_frame(bearing.along())
            ring = meshes.ring(inner_edge, outer_edge, drawn_length)
            tube = ring.moved(pose_at(bearing.point, frame))
            self._add(bearing.body, tube)
        # Across the bearing's axis, the drawn offset of each end of the journal is the true offset
        # times the scale of clearances. Along the axis, the middle of the journal keeps its true
        # position, and the distance of its ends is the drawn length.
        axis = self._poses.direction(bearing.body, bearing.along())
        journal_axis = self._poses.direction(journal.body, journal.along())
        centre = self._poses.point(bearing.body, bearing.point)
        reach = self._poses.point(journal.body, journal.point) - centre
        # The journal's axis may point along the bearing's axis or against it.
        sense = np.where(np.sum(journal_axis * axis, axis=1, keepdims=True) < 0.0, -1.0, 1.0)
        ends = []
        for side in SIDES:
            offset = reach + journal_axis * (0.5 * side * float(length))
            across = offset - axis * np.sum(offset * axis, axis=1, keepdims=True)
            along = np.sum(reach * axis, axis=1, keepdims=True) + 0.5 * side * sense * drawn_length
            ends.append(centre + axis * along + across * scale)
        drawn_axis = ends[1] - ends[0]
        drawn_axis /= np.linalg.norm(drawn_axis, axis=1, keepdims=True)
        # The direction across the axis from which the angles of a journal's profile are measured.
        local = _transverse_frame(journal.along())[:, 0]
        poses = frames(drawn_axis, self._poses.direction(journal.body, local))
        poses[:, :3, 3] = 0.5 * (ends[0] + ends[1])
        pin_length = 1.3 * drawn_length  # longer than the bearing, so that both ends are visible
        pin = meshes.cylinder(journal_radius, pin_length)
        if journal_profile is not None:
            pin = meshes.plate(self._edge(journal_radius, journal_profile), pin_length)
        self._moving.append(DrawnPart(self.element, pin, poses, METAL, is_journal=True))
        drawn = DrawnJournal(np.array(ends), poses, journal_radius, journal_profile, scale)
        self.journals[self.element] = drawn
        # The bar of the journal's body passes behind the bearing, and the bar of the bearing's body
        # ends at its wall, so that neither hides the journal.
        self._hold(self._moved_back(journal, 0.5 * drawn_length + 1.2 * self._bar))
        self._hold(bearing, around=outer)

    @override
    def socket(self, socket: Marker, ball: Marker, *, radius: Single, clearance: Single) -> None:
        bore, scale = self._sizes.bore(float(radius)), self._sizes.clearance_scale
        self._fix(socket._replace(axis=None), meshes.ball(bore), opacity=CLEAR)
        inner = meshes.ball(bore - float(clearance) * scale)
        # The ball turns with its body, and its offset from the socket's centre is enlarged like the
        # clearance.
        poses = self._poses.poses[ball.body].copy()
        centre = self._poses.point(socket.body, socket.point)
        poses[:, :3, 3] = centre + scale * (self._poses.point(ball.body, ball.point) - centre)
        self._moving.append(DrawnPart(self.element, inner, poses, METAL, is_journal=True))
        self._hold(socket, around=bore)
        self._hold(ball)

    @override
    def walls(self, middle: Marker, runner: Marker, normal: Triple, *, distance: Single) -> None:
        half = 0.5 * float(distance)
        self._plates(middle, runner, normal, (-half, half), 2.0 * half)

    @override
    def wall(self, plane: Marker, runner: Marker, *, radius: Single) -> None:
        behind, excess = -plane.along(), 4.0 * self._bar + float(radius)
        self._plates(plane._replace(axis=None), runner, behind, (0.0,), excess)

    def _plates(
        self,
        middle: Marker,
        runner: Marker,
        normal: ArrayLike,
        surfaces: tuple[float, ...],
        excess: float,
    ) -> None:
        """Draw plates perpendicular to `normal`, in axes of the body of `middle`, to which they are
        fixed. Their sides that face this marker are at the coordinates `surfaces`, m, along the
        normal from the marker. At each end, the plates are longer than the path of the marker
        `runner` by `excess`, m, plus the radius of a bar."""
        # The columns of `frame`, in body axes, are the direction along the walls, which is
        # perpendicular to normal and line of sight; the normal; and a direction as near as possible
        # to the line of sight. If the viewer looks along the normal, the first is arbitrary.
        across, front = _unit(normal), self._components(middle.body, self._sizes.front)
        faces_viewer = np.linalg.norm(np.cross(across, front)) < 1e-6
        along = frame_about(across, None if faces_viewer else front)[:, 1]
        frame = np.stack([along, across, np.cross(along, across)], axis=1)
        low, high = self._range(middle, runner, along)
        centre = np.asarray(middle.point) + along * (0.5 * (low + high))
        # The plates are deep along the line of sight.
        deep = max(8.0 * self._bar, 2.0 * excess)
        plate = meshes.box((high - low + 2.0 * (excess + self._bar), self._bar, deep))
        for surface in surfaces:
            # The plate is beyond its surface, as seen from the marker; at zero, towards `normal`.
            at = centre + across * (surface + math.copysign(0.5 * self._bar, surface))
            self.shape(middle.body, plate.moved(pose_at(at, frame)))
        # The hull of the body extends to the middle of the runner's path.
        self._hold(middle._replace(point=centre))

    @override
    def block(self, centre: Marker, normal: Triple, *, length: Single, height: Single) -> None:
        along, across = centre.along(), _unit(normal)
        frame = np.stack([along, across, np.cross(along, across)], axis=1)
        box = meshes.box((float(length), float(height), 5.0 * self._bar))
        self.shape(centre.body, box.moved(pose_at(centre.point, frame)))
        self._hold(centre)

    @override
    def roller(self, centre: Marker, *, radius: Single) -> None:
        """Draw a cylinder along `Proportions.front` in the first frame: in a planar mechanism,
        perpendicular to the plane of motion."""
        axis = self._components(centre.body, self._sizes.front)
        pin = meshes.cylinder(float(radius), 9.0 * self._bar)
        self._fix(centre._replace(axis=axis), pin, METAL)
        self._hold(centre)

    @override
    def sphere(self, centre: Marker, *, radius: Single) -> None:
        self.shape(centre.body, meshes.ball(float(radius)).moved(pose_at(centre.point)))
        self._hold(centre)

    @override
    def gear(self, centre: Marker, *, radius: Single, teeth: Single, phase: Single) -> None:
        frame = _transverse_frame(centre.along(), float(phase))
        wheel = meshes.gear(float(radius), round(abs(float(teeth))), 2.4 * self._bar)
        self.shape(centre.body, wheel.moved(pose_at(centre.point, frame)))
        self._hold(centre)

    def body(self, name: str, body: Body) -> None:
        """Draw a body as a bar around the points of its joints and forces.

        A body with a block, ball, gear or walls and at most one point gets no bar. If another body
        has at most one point, or its points span less than half the longest side of its equivalent
        solid along each axis, this solid is drawn too, and the bar reaches the centre of mass.
        """
        points = self._distinct(name)
        # Blocks, gears and walls need no further shape.
        if name in self._shaped and len(points) <= 1:
            return
        longest = equivalent_solid(body).sides.max()
        if len(points) <= 1 or np.ptp(points, axis=0).max() < 0.5 * longest:
            self.solid(name, body)
            points = np.vstack([points, np.zeros((1, 3))])  # the hull connects joints and solid
        if np.ptp(points, axis=0).max() > NEAR * self._sizes.size:
            self._add(name, meshes.hull(points, self._bar))

    def solid(self, name: str, body: Body) -> None:
        """Draw a body's equivalent box or cylinder, unless it is drawn already. All sides are at
        least as long as a bar is thick; it is transparent if two of them are longer."""
        if name in self._solid:
            return
        self._solid.add(name)
        solid = equivalent_solid(body)
        # A thicker solid is transparent, because it may hide joints.
        thin = np.sort(solid.sides)[1] <= 2.0 * self._bar
        sides = np.maximum(solid.sides, 2.0 * self._bar).tolist()
        shape = meshes.cylinder(0.5 * sides[0], sides[2]) if solid.round else meshes.box(sides)
        pose = pose_at((0.0, 0.0, 0.0), solid.axes)
        self._add(name, shape.moved(pose), opacity=1.0 if thin else CLEAR)

    def centre_of_mass(self, name: str) -> None:
        self._add(name, meshes.ball(1.5 * self._bar), "#000000")

    def shape(self, name: str, mesh: Mesh) -> None:
        self._add(name, mesh)
        self._shaped.add(name)

    def ground(self, down: Float[np.ndarray, "3"]) -> None:
        """Draw a stand below each point of the ground's elements: a pyramid with its tip at the
        point or, for a bearing, at the outside of its wall."""
        # The columns are the axes of the pyramid: to the side, near the line of sight, and down.
        # The small number prevents a division by zero if `front` is parallel to `down`.
        frame = frame_about(down, self._sizes.front + 1e-6)
        frame = np.stack([-frame[:, 1], frame[:, 0], down], axis=1)
        stand = meshes.pyramid(4.0 * self._bar, 5.0 * self._bar, 2.5 * self._bar)
        for point in self._distinct(GROUND):
            self._add(GROUND, stand.moved(pose_at(point, frame)))

    def _edge(self, radius: float, profile: AbstractProfile) -> np.ndarray:
        """Return the corners, (N, 2) m, of a circle of the drawn `radius`, m, with a `profile`."""
        angles = np.arange(CORNERS) * 2.0 * np.pi / CORNERS
        deviation = np.asarray(profile.at(angles).value, float)
        return meshes.outline(radius + self._sizes.clearance_scale * deviation)

    def _distinct(self, name: str) -> np.ndarray:
        """Return the points, (M, 3) m in body axes, that a body's hull must contain; of equal ones,
        up to `NEAR`, only the first."""
        points = np.reshape(self._corners[name], (-1, 3))
        rounded = np.round(points / (NEAR * self._sizes.size))
        _, firsts = np.unique(rounded, axis=0, return_index=True)
        return points[np.sort(firsts)]

    def _add(self, body: str, mesh: Mesh, colour: str = "", opacity: float = 1.0) -> None:
        self._fixed.setdefault((body, colour or self._colours[body], opacity), []).append(mesh)

    def _fix(self, marker: Marker, mesh: Mesh, colour: str = "", opacity: float = 1.0) -> None:
        """Fix a solid to the marker's body, with its origin at the marker's point and its z axis
        along the marker's axis. `colour`: by default that of the body."""
        rotation = None if marker.axis is None else frame_about(marker.along())
        self._add(marker.body, mesh.moved(pose_at(marker.point, rotation)), colour, opacity)

    def _ends(self, first: Marker, second: Marker) -> tuple[np.ndarray, np.ndarray]:
        self._hold(first, second)
        start, end = (self._poses.point(marker.body, marker.point) for marker in (first, second))
        return start, end

    def _span(self, mesh: Mesh, starts: np.ndarray, ends: np.ndarray) -> None:
        self._moving.append(DrawnPart(self.element, mesh, between(starts, ends, 1.0), METAL))

    def _hold(self, *markers: Marker, around: float = 0.0) -> None:
        """Extend the hull of each marker's body to the marker's point or, with `around`, only to
        the point at this distance, m, from it, on the side of the body's centre of mass."""
        self.drawn.add(self.element)
        for marker in markers:
            point = np.asarray(marker.point, dtype=float)
            # The hull ends before the point in the direction of the body's centre of mass or, on
            # the ground, downwards, and perpendicular to the marker's axis if it has one.
            on_ground = marker.body == GROUND
            inwards = -self._sizes.up if on_ground else -point
            if marker.axis is not None:
                axis = marker.along()
                inwards = inwards - axis * (inwards @ axis)
            size = np.linalg.norm(inwards)
            # On a body, the hull reaches the point if the centre of mass is within the distance
            # `around` of the axis or, without an axis, of the point. The ground has no centre of
            # mass: its hull reaches the point only if the axis is vertical, because then no
            # direction is left.
            if around and size > (1e-6 if on_ground else around):
                point = point + inwards * (around / size)
            self._corners[marker.body].append(point)

    def _moved_back(self, marker: Marker, distance: float) -> Marker:
        """Move a marker by `distance`, m, along its axis, away from the viewer in frame 0."""
        axis = marker.along()
        towards_viewer = self._poses.direction(marker.body, axis)[0] @ self._sizes.front
        behind = (-axis if towards_viewer >= 0.0 else axis) * distance
        return marker._replace(point=np.asarray(marker.point) + behind)

    def _components(self, body: str, direction: np.ndarray) -> np.ndarray:
        return self._poses.poses[body][0, :3, :3].T @ direction

    def _range(self, base: Marker, runner: Marker, axis: np.ndarray) -> tuple[float, float]:
        """Return the smallest and largest coordinate, m, of `runner` in all frames, from the point
        of `base`, along an `axis`, (3,), of the body of `base`."""
        offset = self._poses.point(runner.body, runner.point)
        offset = offset - self._poses.point(base.body, base.point)
        along = np.sum(offset * self._poses.direction(base.body, axis), axis=1)
        return float(along.min()), float(along.max())


def sketch(
    scene: Scene,
    poses: BodyPoses,
    proportions: Proportions,
    shapes: Mapping[str, Mesh],
    *,
    centres: bool,
    solids: bool,
) -> SketchingPen:
    """Draw all parts of a scene except arrows, and return the pen that has them. `shapes`: meshes
    that replace bodies; `centres`, `solids`: whether to add centres of mass, equivalent solids."""
    pen = SketchingPen(poses, proportions, colours(scene.bodies))
    for name, mesh in shapes.items():
        pen.shape(name, mesh)
    for family in (scene.joints, scene.forces):
        for name, element in family.items():
            pen.element = name
            element.draw(pen)
    # Bodies last: their hulls contain the points of all elements.
    for name, body in scene.bodies.items():
        # The negligible mass of a rotor says nothing of its size.
        if name not in shapes and not body.is_massless:
            pen.body(name, body)
        if centres:
            pen.centre_of_mass(name)
        if solids and not body.is_massless:
            pen.solid(name, body)
    pen.ground(-proportions.up)
    return pen


def colours(bodies: Collection[str]) -> dict[str, str]:
    """Return the colour "#rrggbb" of each body and of the ground: the colours `BODIES`, then shades
    of them, and from the 64th body on the first ones again."""
    shades = cycle([_mixed(colour, *mix) for mix in MIXTURES for colour in BODIES])
    return dict(zip(bodies, shades, strict=False)) | {GROUND: GROUND_COLOUR}


MIXTURES = (0.0, 0), (0.5, 255), (0.45, 0), (0.25, 255), (0.25, 0), (0.7, 255), (0.65, 0)
"""Shades of colours: the share of white (255) or black (0) that is mixed in, and which."""


def _mixed(colour: str, part: float, brightness: int) -> str:
    channels = [round((1.0 - part) * c + part * brightness) for c in bytes.fromhex(colour[1:])]
    return f"#{bytes(channels).hex().upper()}"


def _unit(vector: ArrayLike) -> np.ndarray:
    numbers = np.asarray(vector, dtype=float)
    return numbers / np.linalg.norm(numbers)


def _transverse_frame(along: np.ndarray, phase: float = 0.0) -> np.ndarray:
    """Return a rotation matrix that maps z to the unit vector `along`, and x to the direction that
    is `phase`, rad, about `along` from the first of its `transverse_axes`."""
    zero = np.array([*map(float, transverse_axes(Vector(*map(float, along)))[0])])  # at angle zero
    return frame_about(along, zero * np.cos(phase) + np.cross(along, zero) * np.sin(phase))
