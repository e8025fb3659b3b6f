"""Sizes of symbols, scales of clearances and bearings, and the camera of a view.

Bodies are drawn as bars around the points of their joints. Bearings and clearances are enlarged,
because true clearances are invisible.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .._fields.checks import require, require_positive
from .._model.bodies import Body
from .._model.scene import Scene
from .._model.survey import SurveyingPen
from .meshes import FORCE, LOAD, DrawnPart, corners, frame_about
from .poses import BodyPoses

BORE = 2.4
"""Drawn radius of a bearing of unknown radius, in radii of a body's bar; by default also the least
drawn radius of other bearings."""


@dataclass(frozen=True)
class Proportions:
    """Sizes and scales of a view.

    - `size`: diagonal of the box around the mechanism, m.
    - `bar`: radius of the bar by which a body is drawn, m.
    - `bearing_scale`, `clearance_scale`: drawn size divided by true size, of bearings and sockets,
      and of clearances and eccentricities. The drawn radius of a journal or ball is that of its
      bearing or socket less the drawn clearance.
    - `front`: unit vector to the viewer before the camera tilts, the main direction of joint axes.
    - `up`: unit vector upwards.
    - `planar`: whether nearly all joint axes are parallel.
    """

    size: float
    bar: float
    bearing_scale: float
    clearance_scale: float
    front: Float[np.ndarray, "3"]
    up: Float[np.ndarray, "3"]
    planar: bool

    def bore(self, radius: float | None) -> float:
        """Drawn radius, m, of a bearing with the true `radius`, m, ``None`` if unknown."""
        return BORE * self.bar if radius is None else radius * self.bearing_scale


def proportions(
    scene: Scene,
    poses: BodyPoses,
    noted: SurveyingPen,
    bearing_scale: float | None,
    clearance_scale: float | None,
) -> Proportions:
    """Return the sizes and scales for a view of a scene, by its first frame. `noted` has the points
    and axes (markers) of the scene's elements, and the radii and clearances (bores) of its bearings
    and sockets. Scales that are None are chosen so that bearings and clearances are visible.

    **Raises:** `ValueError` for scales that are not positive, or a drawn clearance above 0.9 times
    the drawn radius of its bearing.
    """
    size = _size(scene, poses, noted)
    # Bars are thick enough to be seen in a view of the whole mechanism, and thin beside its links.
    bar = 0.014 * size
    radii = [bore.radius for bore in noted.bores if bore.radius is not None]
    if bearing_scale is None:
        bearing_scale = max(1.0, _rounded(BORE * bar / min(radii))) if radii else 1.0
    require_positive("bearing_scale", bearing_scale, "give the scale of the drawn bearings")
    drawn_radii = [
        BORE * bar if bore.radius is None else bore.radius * bearing_scale for bore in noted.bores
    ]
    # The scale of each clearance at which it is as large as the drawn radius of its bearing.
    limits = [r / bore.clearance for r, bore in zip(drawn_radii, noted.bores, strict=True)]
    if clearance_scale is None:  # makes the largest clearance visible, and keeps journals thick
        clearance_scale = max(1.0, _rounded(0.3 * min(limits))) if limits else 1.0
    require_positive("clearance_scale", clearance_scale, "give the scale of the drawn clearances")
    most = 0.9 * min(limits, default=np.inf)
    expected = f"at most {most:.3g}, so that the journal keeps a positive radius"
    remedy = "lower it, or draw bearings larger with `bearing_scale`"
    require(clearance_scale <= most, "clearance_scale", clearance_scale, expected, remedy)
    front, planar = _front(poses, noted)
    up = _up(scene, front, planar)
    return Proportions(size, bar, float(bearing_scale), float(clearance_scale), front, up, planar)


class BodySolid(NamedTuple):
    """A homogeneous box or cylinder with the mass and moments of inertia of a body: `axes`, unit
    vectors in body axes as columns; `sides`, (3,) m. A `round` solid is a cylinder about the third
    axis; its first two sides are its diameter."""

    axes: np.ndarray
    sides: np.ndarray
    round: bool


def equivalent_solid(body: Body) -> BodySolid:
    """Return a homogeneous solid with a body's mass and moments of inertia: a cylinder if exactly
    one pair of principal moments is equal, to a thousandth, else a box. For moments that no real
    solid has, sides whose square would be negative are zero."""
    # `inertia` has either the moments (3,) about the body axes, or is a matrix (3, 3).
    inertia, mass = np.asarray(body.inertia), float(np.asarray(body.mass))
    moments, axes = (inertia, np.eye(3)) if inertia.ndim == 1 else np.linalg.eigh(inertia)
    # Indices of the axes for which the moments about the two other axes are equal: one axis for a
    # cylinder, all three for a cube.
    equal = [k for k in range(3) if np.isclose(moments[k - 1], moments[k - 2], rtol=1e-3, atol=0.0)]
    # A cylinder of mass m, radius r and length L has the moments m r² / 2 along its axis, and
    # m (3 r² + L²) / 12 across. Moments of no real solid could give a negative L².
    if len(equal) == 1:
        across, along = moments[equal[0] - 1], moments[equal[0]]
        radius = np.sqrt(2.0 * along / mass)
        length = np.sqrt(max(12.0 * across / mass - 3.0 * radius**2, 0.0))
        frame = frame_about(axes[:, equal[0]])  # the cylinder is about its third axis
        return BodySolid(frame, np.array([2.0 * radius, 2.0 * radius, length]), True)
    # A box with the sides a, b, c has the moment m (b² + c²) / 12 about the axis along a. The sum
    # of all three moments less twice this moment is m a² / 6. The sign of the determinant makes the
    # axes from `eigh` right-handed.
    sides = np.sqrt(np.maximum(6.0 * (moments.sum() - 2.0 * moments), 0.0) / mass)
    return BodySolid(axes * np.sign(np.linalg.det(axes)), sides, False)


def _size(scene: Scene, poses: BodyPoses, noted: SurveyingPen) -> float:
    """Return the diagonal of a box around the mechanism in the first frame, m; 1 if it is zero."""
    points = [poses.point(marker.body, marker.point)[0] for marker in noted.markers]
    for name, body in scene.bodies.items():
        # Points that differ by rounding errors are one.
        joined = {tuple(np.round(m.point, 9)) for m in noted.markers if m.body == name}
        if len(joined) <= 1 and not body.is_massless:  # drawn as its equivalent solid
            solid = equivalent_solid(body)
            ends = solid.axes * (0.5 * solid.sides)
            points += [poses.point(name, sign * end)[0] for end in ends.T for sign in (-1, 1)]
    return float(np.linalg.norm(np.ptp(np.array(points), axis=0))) or 1.0


def _front(poses: BodyPoses, noted: SurveyingPen) -> tuple[np.ndarray, bool]:
    """Return the main direction of the axes of the markers in `noted`, in the view's first frame,
    and whether nearly all axes are parallel. If no marker has an axis, return Z and false."""
    turning = [marker for marker in noted.markers if marker.axis is not None]
    axes = [poses.direction(marker.body, marker.along())[0] for marker in turning]
    if not axes:
        return np.array([0.0, 0.0, 1.0]), False
    # The main direction is the one for which the sum of the squared components of all axes along it
    # is largest: the eigenvector of the largest eigenvalue, which equals this sum. The senses of
    # the axes don't matter. If the largest eigenvalue exceeds 95 % of the sum of all eigenvalues,
    # the axes are nearly parallel and the mechanism is planar.
    shares, directions = np.linalg.eigh(np.array(axes).T @ np.array(axes))
    main = directions[:, -1]
    # The sense of an eigenvector is arbitrary: make the component of largest magnitude positive.
    main = main * np.sign(main[np.argmax(np.abs(main))])
    return main, bool(shares[-1] > 0.95 * shares.sum())


def _up(scene: Scene, front: np.ndarray, planar: bool) -> np.ndarray:
    """Return the upward unit vector: against gravity, or else Y, Z or X. In a planar mechanism, a
    direction within 60 degrees of the line of sight, `front`, does not count as upward."""
    against = np.zeros(3) if scene.gravity is None else -np.asarray(scene.gravity, dtype=float)
    x, y, z = np.eye(3)
    for candidate in (against, y, z):
        size = np.linalg.norm(candidate)
        if size > 0.0 and (not planar or abs(candidate @ front) < 0.5 * size):  # cos 60° = 0.5
            return candidate / size
    return x


def _rounded(number: float) -> float:
    # Down to two digits.
    unit = 10.0 ** (np.floor(np.log10(number)) - 1.0)
    # Against rounding errors, 1e-9 keeps numbers that have two digits already, and `round` removes
    # digits such as the last one of 0.30000000000000004.
    return float(np.round(np.floor(number / unit + 1e-9) * unit, 12))


FIELD_OF_VIEW = 30.0
"""Vertical field of view, degrees."""
WIDE = 1.25
"""Ratio of width to height of the picture into which `camera` fits the mechanism."""


class Camera(NamedTuple):
    """Positions of the viewer (`eye`) and of the middle of the picture (`target`), m; unit vector
    `up`; and `reach`, half the height of the picture at the target, m."""

    eye: np.ndarray
    target: np.ndarray
    up: np.ndarray
    reach: float

    def axes(self) -> np.ndarray:
        """Return unit vectors to the right, upwards and to the viewer, as rows of a matrix."""
        return _axes(self.eye - self.target, self.up)


def camera(parts: Sequence[DrawnPart], proportions: Proportions) -> Camera:
    """Return a camera that shows all parts with the mechanism in the middle. Arrows of forces,
    known by their colours, are in the picture, but don't belong to the mechanism."""
    # The parts are evaluated in at most 120 frames, between which a motion hardly leaves the
    # picture. Coordinates below are to the right, upwards and to the viewer, m.
    count = max(len(part.poses) for part in parts)
    instants = np.unique(np.linspace(0, count - 1, min(count, 120)).astype(int)).tolist()
    axes = _axes(_direction(proportions), proportions.up)
    bodies = [part for part in parts if part.colour not in (FORCE, LOAD)]
    mechanism, everything = (corners(family, instants) @ axes.T for family in (bodies, parts))
    slope = np.tan(np.radians(0.5 * FIELD_OF_VIEW))
    target = 0.5 * (mechanism.min(axis=0) + mechanism.max(axis=0))
    high = np.abs(everything - target).max()
    distance = high / slope + high  # from which everything is visible
    for _ in range(12):
        # Move the target to the middle of the mechanism's picture. Move the camera to the distance
        # from which everything nearly fills the picture, but keep it in front of the nearest point.
        # Extents in perspective depend on the distance, hence the repetitions. Each at least halves
        # the error of the distance, so that twelve leave less than a thousandth.
        projected = in_perspective(mechanism - target, distance)
        target[:2] += 0.5 * (projected.min(axis=0) + projected.max(axis=0))
        extent = np.abs(in_perspective(everything - target, distance)).max(axis=0)
        nearest = np.max(everything[:, 2] - target[2])
        distance = max(1.1 * max(extent[1], extent[0] / WIDE) / slope, 1.1 * nearest)
    target = axes.T @ target
    return Camera(target + distance * axes[2], target, axes[1], float(distance * slope))


def in_perspective(
    corners: Float[np.ndarray, "*N 3"], distance: float
) -> Float[np.ndarray, "*N 2"]:
    """Return the projections of points on the plane through the target perpendicular to the line of
    sight. The viewer is at `distance`, m, from the target. Points have coordinates relative to it,
    m: to the right, upwards and towards the viewer. Projections have the first two."""
    return corners[..., :2] * (distance / (distance - corners[..., 2:]))


def _direction(proportions: Proportions) -> np.ndarray:
    """Return a vector to the viewer: the part of `front` perpendicular to `up`, plus components to
    the right and upwards. If that part is short, another horizontal vector takes its place."""
    up = proportions.up
    front = proportions.front - up * (proportions.front @ up)
    # Components of the direction to the right and upwards; the component along `front` is 1.
    rightwards, upwards = (0.3, 0.2) if proportions.planar else (0.75, 0.42)
    # If the joint axes are within 17° of the vertical, `front` is replaced by a horizontal
    # direction, and the mechanism is seen more from above.
    if np.linalg.norm(front) < 0.3:
        front = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
        rightwards, upwards = 0.5, 1.2
    front = front / np.linalg.norm(front)
    return front + rightwards * np.cross(up, front) + upwards * up


def _axes(towards: np.ndarray, up: np.ndarray) -> np.ndarray:
    return frame_about(towards, np.cross(up, towards)).T
