"""Collect the points, axes and clearances of a scene's joints and forces."""

from typing import NamedTuple

from .._fields.types import Single
from .pen import AbstractPen, Marker
from .scene import Scene


class Bore(NamedTuple):
    """Hole of a bearing or socket: its radius, m, or ``None`` if unknown, and its clearance, m."""

    radius: float | None
    clearance: float


class SurveyingPen(AbstractPen):
    """Collects the markers of elements, instead of drawing them.

    A marker is a point of a body with an optional axis. `survey` passes the pen to the method
    `draw` of each element, a joint or a force. The result serves to arrange the bodies of a scene
    and to choose the sizes and the viewing direction of a figure.

    - `markers`: all markers.
    - `joined`: pairs of markers on the two bodies of a joint. Joints that are drawn as a rod, a
      spring, gears or single markers are left out, since their points need not coincide. To make a
      first guess of a state, `arranged_state` places one body at the other such that the points
      coincide, and the axes are parallel if both markers have one. The pair of a sliding joint is
      included, although its block may be anywhere along the rail.
    - `bores`: the bores of all bearings and sockets with clearance.
    """

    def __init__(self) -> None:
        self.markers: list[Marker] = []
        self.joined: list[tuple[Marker, Marker]] = []
        self.bores: list[Bore] = []

    def mark(self, *drawn: object, **named: object) -> None:
        """Add the markers among the arguments."""
        self.markers += [one for one in (*drawn, *named.values()) if isinstance(one, Marker)]

    def weld(self, *drawn: object, **named: object) -> None:
        """Add the two markers among the arguments, and add them as a pair to `joined`."""
        self.mark(*drawn, **named)
        self.joined.append((self.markers[-2], self.markers[-1]))

    def cross(self, *drawn: object, **named: object) -> None:
        """Add two markers as `weld` does, but without their axes, since these need not be
        parallel."""
        self.weld(*map(_without_axis, (*drawn, *named.values())))

    def block(self, *drawn: object, **named: object) -> None:
        """Add the centre without its axis.

        Axes of most symbols are axes of rotation and show from where to view a planar mechanism,
        but the axis of a block lies in the plane of motion.
        """
        self.mark(*map(_without_axis, (*drawn, *named.values())))

    def bearing(
        self, *drawn: object, radius: Single | None, clearance: Single, **named: object
    ) -> None:
        """Add two markers as `weld` does, and the bore with its `radius` and `clearance`, m; the
        radius is ``None`` if unknown."""
        self.weld(*drawn, **named)
        self.bores.append(Bore(None if radius is None else float(radius), float(clearance)))

    # The other methods of a pen, by what the survey needs of them: points, pairs, or also bores.
    rod = spring = load = roller = gear = mark
    pin = ball = slide = plane = weld
    walls = cross
    socket = bearing


def _without_axis(one: object) -> object:
    return one._replace(axis=None) if isinstance(one, Marker) else one


def survey(scene: Scene) -> SurveyingPen:
    """Return a pen that has collected the markers of a scene's joints and forces."""
    pen = SurveyingPen()
    for element in (*scene.joints.values(), *scene.forces.values()):
        element.draw(pen)
    return pen
