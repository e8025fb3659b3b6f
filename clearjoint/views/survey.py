"""What there is to draw: where elements join bodies, along which axes, and how large plays are."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..fields.types import Single, Triple
from ..model.bodies import Body
from ..model.pen import AbstractPen, Marker
from ..model.scene import Scene
from .meshes import frame_about


class Bore(NamedTuple):
    """Radius of a bearing or socket, m, or ``None`` if nobody knows it; and its clearance, m."""

    radius: float | None
    clearance: float


class SurveyingPen(AbstractPen):
    """Notes the places that elements draw at.

    - `places`: all of them.
    - `joined`: pairs of them that an assembled mechanism has at one point, and along one axis where
      both have one.
    - `bores`: of all journals and balls with play.
    """

    def __init__(self) -> None:
        self.places: list[Marker] = []
        self.joined: list[tuple[Marker, Marker]] = []
        self.bores: list[Bore] = []

    def _join(self, first: Marker, second: Marker) -> None:
        self.places += [first, second]
        self.joined.append((first, second))

    def mark(self, place: Marker) -> None:
        """Note a point."""
        self.places.append(place)

    def weld(self, first: Marker, second: Marker) -> None:
        """Note two points in one place."""
        self._join(first, second)

    def pin(self, first: Marker, second: Marker) -> None:
        """Note two axes in one line."""
        self._join(first, second)

    def ball(self, first: Marker, second: Marker) -> None:
        """Note two points in one place."""
        self._join(first, second)

    def cross(self, first: Marker, second: Marker) -> None:
        """Note two points in one place: their axes are at a right angle."""
        self._join(first._replace(axis=None), second._replace(axis=None))

    def slide(self, rail: Marker, block: Marker, *, turning: bool) -> None:
        """Note two points on one line."""
        del turning
        self._join(rail, block)

    def plane(self, plane: Marker, point: Marker) -> None:
        """Note two points in one plane."""
        self._join(plane, point)

    def rod(self, first: Marker, second: Marker) -> None:
        """Note two points."""
        self.places += [first, second]

    def spring(self, first: Marker, second: Marker) -> None:
        """Note two points."""
        self.places += [first, second]

    def load(self, place: Marker, force: Triple) -> None:
        """Note a point."""
        del force
        self.places.append(place)

    def bearing(
        self,
        bearing: Marker,
        journal: Marker,
        *,
        radius: Single | None,
        clearance: Single,
        length: Single,
    ) -> None:
        """Note two axes in one line, and the bore."""
        del length
        self._join(bearing, journal)
        self.bores.append(Bore(None if radius is None else float(radius), float(clearance)))

    def socket(self, socket: Marker, ball: Marker, *, radius: Single, clearance: Single) -> None:
        """Note two points in one place, and the bore."""
        self._join(socket, ball)
        self.bores.append(Bore(float(radius), float(clearance)))

    def walls(self, middle: Marker, runner: Marker, normal: Triple, *, distance: Single) -> None:
        """Note two points."""
        del normal, distance
        self._join(middle._replace(axis=None), runner._replace(axis=None))

    def block(self, centre: Marker, normal: Triple, *, length: Single, height: Single) -> None:
        """Note a point, and no axis, since it is in the plane of the motion."""
        del normal, length, height
        self.places.append(centre._replace(axis=None))

    def roller(self, centre: Marker, *, radius: Single) -> None:
        """Note a point."""
        del radius
        self.places.append(centre)

    def gear(self, centre: Marker, *, radius: Single, teeth: Single, phase: Single) -> None:
        """Note a point and its axis."""
        del radius, teeth, phase
        self.places.append(centre)


def survey(scene: Scene) -> SurveyingPen:
    """What the joints and forces of a scene draw at."""
    pen = SurveyingPen()
    for element in (*scene.joints.values(), *scene.forces.values()):
        element.draw(pen)
    return pen


class BodySolid(NamedTuple):
    """The homogeneous solid of a body's mass and moments of inertia.

    `axes`: (3, 3), its axes in the columns, in body axes; `sides`: (3,) m, along them. A `round`
    one is a cylinder about the third axis, and its first two sides are its diameter.
    """

    axes: np.ndarray
    sides: np.ndarray
    round: bool


ALIKE = 1e-3
"""Relative difference of two moments up to which a solid is round."""


def equivalent_solid(body: Body) -> BodySolid:
    """A cylinder for a body with just two equal principal moments, and a box for any other."""
    inertia, mass = np.asarray(body.inertia), float(np.asarray(body.mass))
    moments, axes = (inertia, np.eye(3)) if inertia.ndim == 1 else np.linalg.eigh(inertia)
    alike = [k for k in range(3) if np.isclose(moments[k - 1], moments[k - 2], rtol=ALIKE)]
    if len(alike) == 1:
        across, along = moments[alike[0] - 1], moments[alike[0]]
        radius = np.sqrt(2.0 * along / mass)
        length = np.sqrt(max(12.0 * across / mass - 3.0 * radius**2, 0.0))
        third = frame_about(axes[:, alike[0]])
        return BodySolid(third, np.array([2.0 * radius, 2.0 * radius, length]), True)
    sides = np.sqrt(np.maximum(6.0 * (moments.sum() - 2.0 * moments), 0.0) / mass)
    return BodySolid(axes * np.sign(np.linalg.det(axes)), sides, False)


def own_points(places: list[Marker], bodies: Mapping[str, Body]) -> dict[str, np.ndarray]:
    """The different points of each body that elements draw at, (M, 3) m in its axes, by name."""
    found: dict[str, list[np.ndarray]] = {name: [] for name in bodies}
    for place in places:
        if place.body in found:
            found[place.body].append(np.asarray(place.point, dtype=float))
    return {name: np.reshape(points, (-1, 3)) for name, points in found.items()}
