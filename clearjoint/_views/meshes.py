"""Triangle meshes of simple solids, and the solids of a view.

Cylinders and tubes are about z, and all solids are centred at the origin unless their function says
otherwise. Functions that use the package trimesh raise `ImportError` without it.
"""

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import NamedTuple, Protocol, TypeAlias, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

from .._fields.checks import require, require_finite
from .._fields.types import ArrayLike

ROUND = 32
"""Number of sides of a cylinder; a tube has twice as many, and an arrow half as many."""


class Mesh(NamedTuple):
    """Surface of a solid: vertices, m, and for each triangle the indices of its vertices,
    counter-clockwise seen from outside."""

    vertices: Float[np.ndarray, "V 3"]
    faces: Int[np.ndarray, "F 3"]

    def moved(self, pose: Float[np.ndarray, "4 4"]) -> "Mesh":
        return Mesh(self.vertices @ pose[:3, :3].T + pose[:3, 3], self.faces)


@runtime_checkable
class HasTriangles(Protocol):
    """An object, such as a mesh of trimesh, with the arrays of a `Mesh`."""

    vertices: ArrayLike
    faces: ArrayLike


MeshLike: TypeAlias = str | Path | HasTriangles | tuple[ArrayLike, ArrayLike]
"""A file that trimesh reads (STL, OBJ, PLY, GLB, ...), an object with `vertices` and `faces`, or
these two arrays: (V, 3) m, and (F, 3)."""


def needed(package: str) -> ModuleType:
    """Import and return a package of the extra `view`; an `ImportError` names the extra."""
    try:
        return importlib.import_module(package)
    except ImportError as error:
        message = f"Views need {package}: pip install 'clearjoint[view]', or pip install {package}"
        raise ImportError(message) from error


def cylinder(radius: float, length: float) -> Mesh:
    return _of(_creation().cylinder(radius, length, sections=ROUND))


def tube(inner: float, outer: float, length: float) -> Mesh:
    return _of(_creation().annulus(inner, outer, length, sections=2 * ROUND))


def ball(radius: float) -> Mesh:
    return _of(_creation().icosphere(subdivisions=2, radius=radius))


def box(sides: Sequence[float]) -> Mesh:
    return _of(_creation().box(sides))


def pyramid(height: float, width: float, depth: float) -> Mesh:
    """Return a pyramid with its tip at the origin and a base of `width` along x and `depth` along y
    at z = `height`."""
    signs = ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0))
    base = [(0.5 * width * x, 0.5 * depth * y, height) for x, y in signs]
    sides = [(0, 1 + (k + 1) % 4, 1 + k) for k in range(4)]
    return Mesh(np.array([(0.0, 0.0, 0.0), *base]), np.array([*sides, (1, 2, 3), (1, 3, 4)]))


def arrow() -> Mesh:
    """Return an arrow along z, from the origin to its tip at z = 1; its head has the radius 1."""
    # Pairs (radius, z) of the outline: a shaft of radius 0.35 up to z = 0.7, then the head.
    profile = [(0.0, 0.0), (0.35, 0.0), (0.35, 0.7), (1.0, 0.7), (0.0, 1.0)]
    return _of(_creation().revolve(profile, sections=ROUND // 2))


def coil(radius: float, wire: float, length: float, turns: int = 7) -> Mesh:
    """Return a helical spring about z with straight ends, from z = 0 to z = 1. If the mesh is
    stretched to `length` along z, the wire is round, with the radius `wire`."""
    # The middle of the wire: a helix of 14 points in each turn, between straight ends that have 12
    # per cent of the length each.
    inside = np.linspace(0.0, 1.0, 14 * turns + 1)
    angle = 2.0 * np.pi * turns * inside
    helix = [radius * np.cos(angle), radius * np.sin(angle), length * (0.12 + 0.76 * inside)]
    ends = np.outer((0.0, 0.12, 0.88, 1.0), (0.0, 0.0, length))
    path = np.vstack([ends[:2], np.stack(helix, 1), ends[2:]])
    # The wire has a hexagonal ring of vertices around each point, perpendicular to the path.
    corners = 2.0 * np.pi * np.arange(6) / 6
    rings = []
    # Tangents are central differences. With the first and last points repeated, the tangents at
    # the two ends are one-sided differences.
    padded = np.vstack([path[:1], path, path[-1:]])
    for point, tangent in zip(path, padded[2:] - padded[:-2], strict=True):
        frame = frame_about(tangent)
        ring = np.outer(np.cos(corners), frame[:, 0]) + np.outer(np.sin(corners), frame[:, 1])
        rings.append(point + wire * ring)
    return Mesh(np.vstack(rings) / (1.0, 1.0, length), _skin(len(rings), len(corners)))


def gear(radius: float, teeth: int, width: float) -> Mesh:
    """Return a spur gear with `teeth` teeth about z, the middle of one of them on the x axis.
    `radius`: of the pitch circle, negative for an internal gear; `width`: along z."""
    module = 2.0 * abs(radius) / teeth  # m
    pitch = 2.0 * np.pi / teeth  # rad
    # Each tooth has four corners: root, tip, tip, root. Their angles are measured in pitches from
    # the middle of the tooth, and make the tooth about half a pitch wide on the pitch circle. Their
    # heights above the pitch circle, in modules, are those of ISO 53.
    angle = (np.arange(teeth)[:, None] + np.array([-0.36, -0.16, 0.16, 0.36])) * pitch
    height = np.tile(np.sign(radius) * module * np.array([-1.25, 1.0, 1.0, -1.25]), teeth)
    size = abs(radius) + height
    rim = np.stack([size * np.cos(angle.ravel()), size * np.sin(angle.ravel())], 1)
    if radius > 0.0:
        return plate(rim, width)
    # The outer edge is four modules outside of the pitch circle.
    outer = rim * ((abs(radius) + 4.0 * module) / np.linalg.norm(rim, axis=1))[:, None]
    return ring(rim, outer, width)


def plate(rim: Float[np.ndarray, "N 2"], width: float) -> Mesh:
    """Return a plate of thickness `width` along z inside a counter-clockwise `rim`, all of which
    must be visible from the origin."""
    # Triangles from each edge of the rim to the centre, the vertex after those of the rim.
    count = len(rim)
    starts = np.arange(count)
    faces = np.stack([starts, np.roll(starts, -1), np.full(count, count)], 1)
    return _extruded(np.vstack([rim, np.zeros((1, 2))]), faces, width)


def ring(inner: Float[np.ndarray, "N 2"], outer: Float[np.ndarray, "N 2"], width: float) -> Mesh:
    """Return a ring of thickness `width` about z between two counter-clockwise edges, whose corners
    with the same index are at the same angle."""
    return _extruded(np.vstack([inner, outer]), _skin(2, len(inner)), width)


def _extruded(
    corners: Float[np.ndarray, "N 2"], faces: Int[np.ndarray, "F 3"], width: float
) -> Mesh:
    solid = _creation().extrude_triangulation(corners, faces, width)
    return _of(solid).moved(pose_at((0.0, 0.0, -0.5 * width)))


def outline(distances: Float[np.ndarray, " N"]) -> Float[np.ndarray, "N 2"]:
    """Return where rays from the origin, at the angles 0, 2 pi/N, ..., leave the region inside N
    lines, such as tangents. Line k is perpendicular to ray k, `distances[k]` from the origin."""
    angles = np.arange(len(distances)) * 2.0 * np.pi / len(distances)
    # A ray from the origin in the k-th direction meets the j-th line after the length d / c, where
    # d is the distance of the line from the origin, and c the cosine of the angle between the k-th
    # and the j-th direction. Lines that the ray doesn't meet count as infinitely far away.
    cosines = np.cos(angles[:, None] - angles)
    reached = np.where(cosines > 1e-6, distances / np.maximum(cosines, 1e-6), np.inf)
    return reached.min(axis=1)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def hull(points: Float[np.ndarray, "N 3"], radius: float) -> Mesh:
    """Return the convex hull of balls of a `radius` around all points: of two, a rounded rod."""
    trimesh = needed("trimesh")
    knob = _creation().icosphere(subdivisions=1, radius=radius).vertices
    return _of(trimesh.convex.convex_hull((points[:, None] + knob[None]).reshape(-1, 3)))


def joined(meshes: Sequence[Mesh]) -> Mesh:
    vertices, faces = zip(*meshes, strict=True)
    return Mesh(*needed("trimesh").util.append_faces(vertices, faces))


def as_mesh(argument: str, value: MeshLike) -> Mesh:
    """Return a user's mesh after checks; errors call it `argument`. Raise a `ValueError` for a
    missing file, another type or wrong arrays; trimesh raises its own for a file it can't read."""
    remedy = "give a file that trimesh reads, a trimesh object, or (vertices in m, faces)"
    # A file becomes an object with triangles, and such an object becomes a pair of arrays.
    if isinstance(value, str | Path):
        require(Path(value).is_file(), argument, str(value), "an existing file", remedy)
        value = needed("trimesh").load(value, force="mesh")
    if isinstance(value, HasTriangles):
        value = np.asarray(value.vertices), np.asarray(value.faces)
    pair = value if isinstance(value, tuple) else ()
    require(len(pair) == 2, argument, type(value).__name__, "a mesh", remedy)
    vertices, faces = map(np.asarray, pair)
    for name, part in (("vertices", vertices), ("faces", faces)):
        is_valid = part.ndim == 2 and part.shape[1] == 3 and len(part) > 0
        require(is_valid, f"{argument} {name}", part.shape, "of shape (n, 3)", remedy)
    wrong = faces[~np.isin(faces, np.arange(len(vertices)))].tolist()
    expected = f"indices of vertices, whole numbers from 0 to {len(vertices) - 1}"
    require(not wrong, f"{argument} faces", next(iter(wrong), None), expected, remedy)
    require_finite(f"{argument} vertices", vertices)
    return Mesh(vertices.astype(float), faces.astype(int))


def frames(
    axes: Float[np.ndarray, "N 3"], start: Float[np.ndarray, "N 3"] | None = None
) -> Float[np.ndarray, "N 4 4"]:
    """Return rotations that map z to each unit vector in `axes`, and x to the part of `start`
    perpendicular to it, by default to any perpendicular direction."""
    if start is None:  # the coordinate axis that is farthest from parallel
        start = np.eye(3)[np.argmin(np.abs(axes), axis=1)]
    x_axes = start - axes * np.sum(start * axes, axis=1, keepdims=True)
    x_axes /= np.linalg.norm(x_axes, axis=1, keepdims=True)
    poses = np.tile(np.eye(4), (len(axes), 1, 1))
    poses[:, :3, :3] = np.stack([x_axes, np.cross(axes, x_axes), axes], axis=2)
    return poses


def frame_about(axis: ArrayLike, start: ArrayLike | None = None) -> Float[np.ndarray, "3 3"]:
    """Return a rotation matrix that maps z to the direction of an `axis`, (3,) of any length, and x
    to the part of `start` perpendicular to it, by default to any perpendicular direction."""
    rows = np.asarray(axis, dtype=float)[None]
    near = None if start is None else np.asarray(start, dtype=float)[None]
    return frames(rows / np.linalg.norm(rows), near)[0, :3, :3]


def pose_at(point: ArrayLike, rotation: ArrayLike | None = None) -> Float[np.ndarray, "4 4"]:
    """Return the pose of a `rotation`, by default none, followed by a translation to `point`."""
    pose = np.eye(4)
    pose[:3, 3] = np.asarray(point, dtype=float)
    if rotation is not None:
        pose[:3, :3] = rotation
    return pose


def _creation() -> ModuleType:
    return needed("trimesh").creation


def _of(shape: HasTriangles) -> Mesh:
    return Mesh(np.array(shape.vertices, dtype=float), np.array(shape.faces, dtype=int))


def _skin(rings: int, corners: int) -> Int[np.ndarray, "F 3"]:
    """Return the triangles between successive rings of `corners` vertices each."""
    # A quadrilateral between corners j and j + 1 of the rings k and k + 1 has two triangles.
    k, j = np.meshgrid(np.arange(rings - 1), np.arange(corners), indexing="ij")
    a, b = k * corners + j, k * corners + (j + 1) % corners
    lower = np.stack([a, b, a + corners], -1).reshape(-1, 3)
    upper = np.stack([b, b + corners, a + corners], -1).reshape(-1, 3)
    return np.vstack([lower, upper])


OKABE_AND_ITO = "#0072B2", "#009E73", "#CC79A7", "#56B4E9", "#F0E442"
BODIES = *OKABE_AND_ITO, "#16324F", "#999933", "#44AA99", "#882255"
"""Colours of bodies, which colour-blind people can distinguish (after M. Okabe and K. Ito)."""
GROUND_COLOUR, METAL = "#8C8C8C", "#4D4D4D"
"""Colours of the ground, and of symbols such as pins, balls, springs and journals."""
FORCE, LOAD = "#D55E00", "#7A1F8C"
"""Colours of the arrows of contact forces and of loads."""
MODES = {0: "#FFF3D6", 1: "#E69F00", 2: "#8A3B00", 3: "#000000"}
"""Colours of a journal by the number of its `MotionMode`: darker for more contact."""
CLEAR = 0.3
"""Opacity of transparent parts."""


@dataclass(frozen=True)
class DrawnPart:
    """A solid of a view, with its pose in each frame.

    - `name`: of its body, joint or force; of joint and contact for the arrow of a contact force.
    - `mesh`: triangles in the solid's own axes, m.
    - `poses`: (N, 4, 4), or (1, 4, 4) for a solid at rest. They may also stretch the solid.
    - `colour`: "#rrggbb". `opacity`: from 0.0, invisible, to 1.0, opaque.
    - `modes`: (N,) keys of `MODES`, whose colours replace `colour`; ``None`` for a single colour.
    - `is_journal`: whether the solid is the journal or ball of a clearance joint.
    """

    name: str
    mesh: Mesh
    poses: Float[np.ndarray, "N 4 4"]
    colour: str
    opacity: float = 1.0
    modes: Int[np.ndarray, " N"] | None = None
    is_journal: bool = False

    def pose(self, k: int) -> Float[np.ndarray, "4 4"]:
        return self.poses[min(k, len(self.poses) - 1)]

    def colour_at(self, k: int) -> str:
        return self.colour if self.modes is None else MODES[int(self.modes[k])]


def between(
    starts: Float[np.ndarray, "N 3"], ends: Float[np.ndarray, "N 3"], width: float
) -> Float[np.ndarray, "N 4 4"]:
    """Return the poses, only one if all are equal, in which a solid from z = 0 to z = 1, such as a
    spring, connects two moving points, with `width` times its size along x and y."""
    along = ends - starts
    # A minimum of 1e-12 m, since equal points have no direction.
    length = np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    poses = frames(along / length)
    poses[:, :3, :2] *= width
    poses[:, :3, 2] *= length
    poses[:, :3, 3] = starts
    return still(poses)


def corners(parts: Sequence[DrawnPart], instants: Sequence[int]) -> Float[np.ndarray, "N 3"]:
    """Return the corners, m in global axes, of a box around each part in each of the frames
    `instants`; the box has the part's own axes."""
    result = []
    for part in parts:
        ends = part.mesh.vertices.min(axis=0), part.mesh.vertices.max(axis=0)
        grid = np.stack(np.meshgrid(*zip(*ends, strict=True)), -1).reshape(-1, 3)
        for k in instants if len(part.poses) > 1 else (0,):  # a part at rest has one pose
            # `moved` transforms the corners of the box; the faces are not used.
            result.append(Mesh(grid, part.mesh.faces).moved(part.pose(k)).vertices)
    return np.vstack(result)


def still(poses: Float[np.ndarray, "N 4 4"]) -> Float[np.ndarray, "M 4 4"]:
    # A single pose, if all are equal.
    return poses[:1] if np.array_equal(poses, np.broadcast_to(poses[:1], poses.shape)) else poses
