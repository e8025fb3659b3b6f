"""Drawing interface: an element describes its appearance with the methods of a pen.

An element draws itself in `AbstractElement.draw(pen)`. The pen determines the style and the size of
symbols, so that one description serves all kinds of figures. User-defined elements use the same
methods.
"""

import abc
from typing import NamedTuple

import numpy as np

from ..fields.checks import require
from ..fields.types import Single, Triple


class Marker(NamedTuple):
    """A point of a body with an optional direction.

    - `body`: name of the body.
    - `point`: (3,) m in its axes.
    - `axis`: (3,) in its axes, any length, or ``None``.

    >>> extend.Marker("arm", (0.5, 0.0, 0.0), axis=(0.0, 3.0, 4.0)).along()
    array([0. , 0.6, 0.8])
    """

    body: str
    point: Triple
    axis: Triple | None = None

    def along(self) -> np.ndarray:
        """Return the direction as a unit vector, (3,).

        **Raises:** `ValueError` if the marker has no axis.
        """
        remedy = "draw with Marker(body, point, axis)"
        require(self.axis is not None, "axis", None, "a direction in body axes", remedy)
        numbers = np.asarray(self.axis, dtype=float)
        return numbers / np.linalg.norm(numbers)


class AbstractPen(abc.ABC):
    """Draws symbols at points of one or two bodies; the first body's marker comes first.

    ```python
    import clearjoint as cj

    class Rope(cj.extend.AbstractForce):
        body: str

        def body_names(self):
            return "ground", self.body

        def wrenches(self, motions, t):
            return {}

        def draw(self, pen):
            pen.spring(Marker("ground", (0, 0, 1)), Marker(self.body, (0, 0, 0)))

    scene = cj.Scene({"ball": cj.Body(1.0, (1e-3, 1e-3, 1e-3))}, forces={"rope": Rope("ball")})
    ```
    """

    @abc.abstractmethod
    def mark(self, marker: Marker) -> None:
        """Draw a point of action without a specific symbol."""

    @abc.abstractmethod
    def weld(self, first: Marker, second: Marker) -> None:
        """Draw a rigid connection."""

    @abc.abstractmethod
    def pin(self, first: Marker, second: Marker) -> None:
        """Draw a hinge about the markers' axes."""

    @abc.abstractmethod
    def ball(self, first: Marker, second: Marker) -> None:
        """Draw a ball joint."""

    @abc.abstractmethod
    def cross(self, first: Marker, second: Marker) -> None:
        """Draw the cross of a universal joint, with an arm along the axis of each marker."""

    @abc.abstractmethod
    def slide(self, rail: Marker, block: Marker, *, turning: bool) -> None:
        """Draw a block, or a sleeve if it is `turning`, on a rail along the first marker's axis."""

    @abc.abstractmethod
    def plane(self, plane: Marker, point: Marker) -> None:
        """Draw a plane perpendicular to the first marker's axis, which contains the second
        point."""

    @abc.abstractmethod
    def rod(self, first: Marker, second: Marker) -> None:
        """Draw a thin rod between two points."""

    @abc.abstractmethod
    def spring(self, first: Marker, second: Marker) -> None:
        """Draw a spring between two points."""

    @abc.abstractmethod
    def load(self, marker: Marker, force: Triple) -> None:
        """Draw a force, (3,) N in global axes, at a point."""

    @abc.abstractmethod
    def bearing(
        self,
        bearing: Marker,
        journal: Marker,
        *,
        radius: Single | None,
        clearance: Single,
        length: Single,
    ) -> None:
        """Draw a journal in a bearing, along the markers' axes.

        `radius` of the bearing, ``None`` if unknown, radial `clearance` and `length` are in m.
        """

    @abc.abstractmethod
    def socket(self, socket: Marker, ball: Marker, *, radius: Single, clearance: Single) -> None:
        """Draw a ball in a socket; radius of the socket and radial clearance are in m."""

    @abc.abstractmethod
    def walls(self, middle: Marker, runner: Marker, normal: Triple, *, distance: Single) -> None:
        """Draw two walls perpendicular to `normal`, at a `distance` in m, with a marker midway
        between.

        They are as long as the path of the second body's `runner` between them.
        """

    @abc.abstractmethod
    def block(self, centre: Marker, normal: Triple, *, length: Single, height: Single) -> None:
        """Draw a block with a `length`, m, along the marker's axis and a `height`, m, along
        `normal`."""

    @abc.abstractmethod
    def roller(self, centre: Marker, *, radius: Single) -> None:
        """Draw a cylinder with a radius in m, perpendicular to the plane of motion."""

    @abc.abstractmethod
    def gear(self, centre: Marker, *, radius: Single, teeth: Single, phase: Single) -> None:
        """Draw a spur gear with a pitch radius in m, negative for an internal gear.

        `phase` is the angle in rad of the middle of a tooth, from the first transverse axis of the
        marker's axis.
        """
