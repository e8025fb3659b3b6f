"""Collect the points, axes and clearances of a scene's joints and forces."""

from typing import NamedTuple

from typing_extensions import override

from .._fields.types import Single
from .pen import AbstractPen, Marker
from .scene import Scene


class Bore(NamedTuple):
    """Hole of a bearing or socket: its radius, m, or ``None`` if unknown, and its clearance, m."""

    radius: float | None
    clearance: float


class SurveyingPen(AbstractPen):
    """Collects the markers of elements, instead of drawing them.

    - `markers`: all markers.
    - `joined`: pairs of markers on the two bodies of a joint. Joints that are drawn as a rod, a
      spring, gears or single markers are left out, since their points need not coincide. The pair
      of a sliding joint is included, although its block may be anywhere along the rail.
    - `bores`: the bores of all bearings and sockets with clearance.
    """

    def __init__(self) -> None:
        self.markers: list[Marker] = []
        self.joined: list[tuple[Marker, Marker]] = []
        self.bores: list[Bore] = []

    @override
    def mark(self, *drawn: object, **named: object) -> None:
        self.markers += [item for item in (*drawn, *named.values()) if isinstance(item, Marker)]

    @override
    def weld(self, *drawn: object, **named: object) -> None:
        self.mark(*drawn, **named)
        # The pair that `mark` has just added.
        self.joined.append((self.markers[-2], self.markers[-1]))

    @override
    def cross(self, *drawn: object, **named: object) -> None:
        # The axes of a cross are perpendicular, and must not be made parallel.
        self.weld(*map(_without_axis, (*drawn, *named.values())))

    @override
    def block(self, *drawn: object, **named: object) -> None:
        # The axis is the direction of a side, not that of a joint.
        self.mark(*map(_without_axis, (*drawn, *named.values())))

    @override
    def bearing(
        self, *drawn: object, radius: Single | None, clearance: Single, **named: object
    ) -> None:
        self.weld(*drawn, **named)
        self.bores.append(Bore(None if radius is None else float(radius), float(clearance)))

    # The other methods of a pen, by what the survey needs of them: points, pairs, or also bores.
    rod = spring = load = roller = sphere = gear = mark
    pin = ball = slide = plane = weld
    walls, wall = cross, block
    socket = bearing


def _without_axis(item: object) -> object:
    return item._replace(axis=None) if isinstance(item, Marker) else item


def survey(scene: Scene) -> SurveyingPen:
    """Return a `SurveyingPen` on which all joints and forces of a scene have been drawn."""
    pen = SurveyingPen()
    for element in (*scene.joints.values(), *scene.forces.values()):
        element.draw(pen)
    return pen
