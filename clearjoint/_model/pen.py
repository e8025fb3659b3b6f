"""Drawing interface: an element describes its appearance with the methods of a pen, which
determines the style and the size of symbols."""

import abc
from collections.abc import Callable
from typing import NamedTuple

import jax
import numpy as np

from .._fields.checks import require, require_axis
from .._fields.types import Single, Triple
from .profiles import AbstractProfile


class Marker(NamedTuple):
    """A point of a body with an optional direction, at which a pen draws a symbol.

    - `body`: name of the body.
    - `point`: (3,) m in body axes, from the centre of mass; on the ground from the origin.
    - `axis`: direction, (3,) in body axes, any length; ``None``, the default, for none.

    >>> extend.Marker("arm", (0.5, 0.0, 0.0), axis=(0.0, 3.0, 4.0)).along()
    array([0. , 0.6, 0.8])
    """

    body: str
    point: Triple
    axis: Triple | None = None

    def along(self) -> np.ndarray:
        """Return the marker's direction as a unit vector, (3,); a `ValueError` if it has none."""
        remedy = "draw with Marker(body, point, axis)"
        require(self.axis is not None, "axis", None, "a direction in body axes", remedy)
        numbers = np.asarray(self.axis, dtype=float)
        require_axis("axis", numbers)
        return numbers / np.linalg.norm(numbers)


class AbstractPen(abc.ABC):
    """Interface that draws symbols at markers, which are points of bodies.

    In a method with two markers, the first belongs to the element's first body.

    ```python
    import clearjoint as cj

    class Rope(cj.extend.AbstractForce):
        body: str

        def body_names(self):
            return "ground", self.body

        def wrenches(self, motions, t):
            return {}

        def draw(self, pen):
            top = cj.extend.Marker("ground", (0, 0, 1))
            pen.spring(top, cj.extend.Marker(self.body, (0, 0, 0)))
    ```
    """

    @abc.abstractmethod
    def mark(self, marker: Marker) -> None:
        """Draw a dot at a point for which no other method has a symbol."""

    @abc.abstractmethod
    def weld(self, first: Marker, second: Marker) -> None:
        """Draw a rigid connection of two bodies."""

    @abc.abstractmethod
    def pin(self, first: Marker, second: Marker) -> None:
        """Draw a hinge; the axis of each marker is the axis of rotation."""

    @abc.abstractmethod
    def ball(self, first: Marker, second: Marker) -> None:
        """Draw a ball joint."""

    @abc.abstractmethod
    def cross(self, first: Marker, second: Marker) -> None:
        """Draw the cross of a universal joint, with an arm along the axis of each marker."""

    @abc.abstractmethod
    def slide(self, rail: Marker, block: Marker, *, turning: bool) -> None:
        """Draw a block on a rail along the axis of `rail` or, if `turning`, a round sleeve, which
        may turn about this axis."""

    @abc.abstractmethod
    def plane(self, plane: Marker, point: Marker) -> None:
        """Draw the plane through a marker, perpendicular to its axis, and a point in it."""

    @abc.abstractmethod
    def rod(self, first: Marker, second: Marker) -> None:
        """Draw a thin rod between two points."""

    @abc.abstractmethod
    def spring(self, first: Marker, second: Marker) -> None:
        """Draw a spring between two points."""

    @abc.abstractmethod
    def load(self, marker: Marker, force: Triple | Callable[[jax.Array], Triple]) -> None:
        """Draw an arrow for a force, (3,) N in global axes, or for a function of the time in s that
        returns the force and that `jax.vmap` accepts."""

    @abc.abstractmethod
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
        """Draw a journal in a bearing, each along the axis of its marker. A joint draws at most one
        bearing, at which a view shows the forces of all contacts of the joint.

        **Arguments:** `radius`: of the bearing, m, or ``None`` if unknown. `clearance`: radial, m.
        `length`: of the journal, m. `profiles`: of bearing and journal; ``None`` for a circle.
        """

    @abc.abstractmethod
    def socket(self, socket: Marker, ball: Marker, *, radius: Single, clearance: Single) -> None:
        """Draw a ball in a socket with this `radius`, m, and radial `clearance`, m."""

    @abc.abstractmethod
    def walls(self, middle: Marker, runner: Marker, normal: Triple, *, distance: Single) -> None:
        """Draw two walls at this `distance` from each other, m, with the marker `middle` halfway.
        They are perpendicular to `normal`, (3,) of any length in the axes of the body of `middle`,
        and long enough for the path of the marker `runner`."""

    @abc.abstractmethod
    def wall(self, plane: Marker, runner: Marker, *, radius: Single) -> None:
        """Draw a wall, as long as the path of a ball of a `radius`, m, at the marker `runner`. Its
        surface is the plane through the marker `plane`, perpendicular to the marker's axis, which
        points out of the wall."""

    @abc.abstractmethod
    def block(self, centre: Marker, normal: Triple, *, length: Single, height: Single) -> None:
        """Draw a block with this `length`, m, along the axis of the marker `centre`, and `height`,
        m, along `normal`, (3,) in the axes of the marker's body, perpendicular to its axis."""

    @abc.abstractmethod
    def roller(self, centre: Marker, *, radius: Single) -> None:
        """Draw a cylinder with a `radius`, m, and its axis along the line of sight."""

    @abc.abstractmethod
    def sphere(self, centre: Marker, *, radius: Single) -> None:
        """Draw a sphere with a `radius`, m."""

    @abc.abstractmethod
    def gear(self, centre: Marker, *, radius: Single, teeth: Single, phase: Single) -> None:
        """Draw a spur gear with the pitch circle's `radius`, m, negative for an internal gear.
        `phase`, rad, is the angle about the marker's axis from the first of its `transverse_axes`
        (x for the axis z) to the middle of a tooth."""
