"""Collect the points, axes and clearances of a scene's joints and forces, before it is drawn."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..fields.types import Single, Triple
from ..model.bodies import Body
from ..model.pen import AbstractPen, Marker
from ..model.scene import Scene
from .meshes import frame_about


class Bore(NamedTuple):
    """Radius of a bearing or socket, m, or ``None`` if unknown; and its clearance, m."""

    radius: float | None
    clearance: float


class SurveyingPen(AbstractPen):
    """Collects the markers of elements, instead of drawing them.

    - `markers`: all markers.
    - `joined`: pairs of markers whose points are put together in a guess of the initial state, with
      parallel axes if both have one. For a sliding block, for instance, this is one of the allowed
      positions.
    - `bores`: the bores of all journals and balls with clearance.
    """

    def __init__(self) -> None:
        self.markers: list[Marker] = []
        self.joined: list[tuple[Marker, Marker]] = []
        self.bores: list[Bore] = []

    def _join(self, first: Marker, second: Marker) -> None:
        """Add two markers, and add them as a pair to `joined`."""
        self.markers += [first, second]
        self.joined.append((first, second))

    def mark(self, marker: Marker) -> None:
        """Add the marker."""
        self.markers.append(marker)

    def weld(self, first: Marker, second: Marker) -> None:
        """Add two points that coincide."""
        self._join(first, second)

    pin = weld
    ball = weld

    def cross(self, first: Marker, second: Marker) -> None:
        """Add two points that coincide, without their axes, which are perpendicular."""
        self._join(first._replace(axis=None), second._replace(axis=None))

    def slide(self, rail: Marker, block: Marker, *, turning: bool) -> None:
        """Add a rail and a block or sleeve on it.

        The block is joined to the point of the rail's marker, although it may be anywhere on the
        line through this point. Whether the block can turn does not matter.
        """
        del turning
        self._join(rail, block)

    def plane(self, plane: Marker, point: Marker) -> None:
        """Add a plane and a point in it; the point is joined to the point of the plane's
        marker."""
        self._join(plane, point)

    def rod(self, first: Marker, second: Marker) -> None:
        """Add two points, which are not joined."""
        self.markers += [first, second]

    spring = rod

    def load(self, marker: Marker, force: Triple) -> None:
        """Add the point of action; the force, N, is not used."""
        del force
        self.markers.append(marker)

    def bearing(
        self,
        bearing: Marker,
        journal: Marker,
        *,
        radius: Single | None,
        clearance: Single,
        length: Single,
    ) -> None:
        """Add two axes that coincide, and the bore; `radius`, `clearance` and `length` in m."""
        del length
        self._join(bearing, journal)
        self.bores.append(Bore(None if radius is None else float(radius), float(clearance)))

    def socket(self, socket: Marker, ball: Marker, *, radius: Single, clearance: Single) -> None:
        """Add two points that coincide, and the bore; `radius` and `clearance` in m."""
        self._join(socket, ball)
        self.bores.append(Bore(float(radius), float(clearance)))

    def walls(self, middle: Marker, runner: Marker, normal: Triple, *, distance: Single) -> None:
        """Add the middle between two walls and a runner, joined without their axes."""
        del normal, distance
        self._join(middle._replace(axis=None), runner._replace(axis=None))

    def block(self, centre: Marker, normal: Triple, *, length: Single, height: Single) -> None:
        """Add the centre without its axis, which lies in the plane of motion."""
        del normal, length, height
        self.markers.append(centre._replace(axis=None))

    def roller(self, centre: Marker, *, radius: Single) -> None:
        """Add the centre."""
        del radius
        self.markers.append(centre)

    def gear(self, centre: Marker, *, radius: Single, teeth: Single, phase: Single) -> None:
        """Add the centre with its axis."""
        del radius, teeth, phase
        self.markers.append(centre)


def survey(scene: Scene) -> SurveyingPen:
    """Collect the markers of a scene's joints and forces."""
    pen = SurveyingPen()
    for element in (*scene.joints.values(), *scene.forces.values()):
        element.draw(pen)
    return pen


class BodySolid(NamedTuple):
    """A homogeneous solid with the mass and moments of inertia of a body.

    - `axes`: (3, 3), whose columns are the axes of the solid, in body axes.
    - `sides`: (3,) m, lengths of the solid along these axes.
    - `round`: whether the solid is a cylinder about the third axis instead of a box; the first two
      sides are then its diameter.
    """

    axes: np.ndarray
    sides: np.ndarray
    round: bool


ALIKE = 1e-3
"""Two principal moments of inertia count as equal up to this relative difference."""


def equivalent_solid(body: Body) -> BodySolid:
    """Return a cylinder for a body with exactly two equal principal moments, else a box."""
    inertia, mass = np.asarray(body.inertia), float(np.asarray(body.mass))
    moments, axes = (inertia, np.eye(3)) if inertia.ndim == 1 else np.linalg.eigh(inertia)
    equal = [k for k in range(3) if np.isclose(moments[k - 1], moments[k - 2], rtol=ALIKE)]
    if len(equal) == 1:
        across, along = moments[equal[0] - 1], moments[equal[0]]
        radius = np.sqrt(2.0 * along / mass)
        length = np.sqrt(max(12.0 * across / mass - 3.0 * radius**2, 0.0))
        third = frame_about(axes[:, equal[0]])
        return BodySolid(third, np.array([2.0 * radius, 2.0 * radius, length]), True)
    sides = np.sqrt(np.maximum(6.0 * (moments.sum() - 2.0 * moments), 0.0) / mass)
    return BodySolid(axes * np.sign(np.linalg.det(axes)), sides, False)


def points_by_body(markers: list[Marker], bodies: Mapping[str, Body]) -> dict[str, np.ndarray]:
    """Return the points (M, 3), m in body axes, of the markers on each body, by the body's name;
    markers on the ground are left out."""
    by_body: dict[str, list[np.ndarray]] = {name: [] for name in bodies}
    for marker in markers:
        if marker.body in by_body:
            by_body[marker.body].append(np.asarray(marker.point, dtype=float))
    return {name: np.reshape(points, (-1, 3)) for name, points in by_body.items()}
