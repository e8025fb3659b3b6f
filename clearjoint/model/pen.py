"""What an element of a scene says of how it looks.

An element draws itself with a pen, `AbstractElement.draw(pen)`, in the words below. What they look
like, and how large symbols are, is the pen's; so one description serves every kind of picture, and
elements of one's own draw themselves in the same words.
"""

import abc
from typing import NamedTuple

import numpy as np

from ..fields.checks import require
from ..fields.types import Single, Triple


class Marker(NamedTuple):
    """A point of a body, (3,) m in its axes, and a direction there, (3,) of any length, if the
    element has one.

    >>> extend.Marker("arm", (0.5, 0.0, 0.0), axis=(0.0, 3.0, 4.0)).along()
    array([0. , 0.6, 0.8])
    """

    body: str
    point: Triple
    axis: Triple | None = None

    def along(self) -> np.ndarray:
        """The direction as a unit vector, (3,).

        **Raises:** `ValueError` for a marker without an axis.
        """
        remedy = "draw with Marker(body, point, axis)"
        require(self.axis is not None, "axis", None, "a direction in body axes", remedy)
        numbers = np.asarray(self.axis, dtype=float)
        return numbers / np.linalg.norm(numbers)


class AbstractPen(abc.ABC):
    """Draws what is at places of two bodies, the first one's before the second's.

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
    def mark(self, place: Marker) -> None:
        """A point of which no more is known than that something acts there."""

    @abc.abstractmethod
    def weld(self, first: Marker, second: Marker) -> None:
        """Places that move as one."""

    @abc.abstractmethod
    def pin(self, first: Marker, second: Marker) -> None:
        """A hinge about the axes of both places."""

    @abc.abstractmethod
    def ball(self, first: Marker, second: Marker) -> None:
        """A point about which the bodies turn in all directions."""

    @abc.abstractmethod
    def cross(self, first: Marker, second: Marker) -> None:
        """The cross of a universal joint, with an arm along the axis of each place."""

    @abc.abstractmethod
    def slide(self, rail: Marker, block: Marker, *, turning: bool) -> None:
        """A block, or if it is `turning` a sleeve, on a rail along the axis of the first place."""

    @abc.abstractmethod
    def plane(self, plane: Marker, point: Marker) -> None:
        """A plane at a right angle to the first place's axis, in which the second one stays."""

    @abc.abstractmethod
    def rod(self, first: Marker, second: Marker) -> None:
        """A thin rod between two points."""

    @abc.abstractmethod
    def spring(self, first: Marker, second: Marker) -> None:
        """A spring between two points."""

    @abc.abstractmethod
    def load(self, place: Marker, force: Triple) -> None:
        """A force, (3,) N in global axes, at a point."""

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
        """A journal in a bearing with radial clearance: radius of the bearing, ``None`` if nobody
        knows it, and length, m. The axes are those of the cylinders."""

    @abc.abstractmethod
    def socket(self, socket: Marker, ball: Marker, *, radius: Single, clearance: Single) -> None:
        """A ball in a socket with radial clearance: radius of the socket, m."""

    @abc.abstractmethod
    def walls(self, middle: Marker, runner: Marker, normal: Triple, *, distance: Single) -> None:
        """Two walls at a right angle to a `normal`, as far apart as the distance, m, with a place
        midway. They are as long as the way of the second body's runner between them."""

    @abc.abstractmethod
    def block(self, centre: Marker, normal: Triple, *, length: Single, height: Single) -> None:
        """A block as long along the axis of its centre, and as high along its `normal`, m."""

    @abc.abstractmethod
    def roller(self, centre: Marker, *, radius: Single) -> None:
        """A cylinder of a radius, m, across the plane of the motion."""

    @abc.abstractmethod
    def gear(self, centre: Marker, *, radius: Single, teeth: Single, phase: Single) -> None:
        """A spur gear of a pitch radius, m, negative if it is internal, with a number of teeth.
        `phase`: rad, where the middle of a tooth is, from the first of the axis' transverse axes.
        """
