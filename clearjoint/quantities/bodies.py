"""Quantities of bodies and their points: what cameras, encoders and accelerometers see."""

import math
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..fields.checks import require, require_axis, require_point
from ..math.rotations import transverse_axes, unit
from ..math.vectors import Scalar, Vector
from ..model.bodies import GROUND
from ..model.scene import Scene
from .base import (
    AbstractQuantity,
    Axes,
    Component,
    numbers,
    optional_numbers,
    part,
    require_axes,
    require_component,
    require_known,
)
from .instant import Instant


class AbstractBodyQuantity(AbstractQuantity):
    """A quantity of one body; `of_ground` tells whether the ground has it too."""

    body: eqx.AbstractVar[str]
    of_ground: ClassVar[bool] = True

    def check(self, scene: Scene) -> None:
        """Check that the scene has a body of this name, or that it is the ground where the ground
        has the quantity."""
        bodies = [GROUND, *scene.bodies] if self.of_ground else scene.bodies
        require_known("body", self.body, bodies)


class Position(AbstractBodyQuantity):
    """Global coordinate of a body's centre of mass, m.

    >>> height = cj.quantities.Position("arm 3", "z")
    >>> height.unit
    'm'
    """

    body: str = eqx.field(static=True)
    component: Component = eqx.field(static=True)
    unit: ClassVar[str | None] = "m"

    def __check_init__(self):
        require_component(self.component)

    def __call__(self, now: Instant) -> Scalar:
        """The global coordinate of the centre of mass, m."""
        return getattr(now.motions[self.body].position, self.component)


class Velocity(AbstractBodyQuantity):
    """Velocity of a body's centre of mass, m/s: its magnitude, or a global component.

    >>> quantity = cj.quantities.Velocity("arm 3", "y")
    >>> quantity.unit
    'm/s'
    """

    body: str = eqx.field(static=True)
    component: Component | None = eqx.field(default=None, static=True)
    unit: ClassVar[str | None] = "m/s"

    def __check_init__(self):
        require_component(self.component, magnitude=True)

    def __call__(self, now: Instant) -> Scalar:
        """The velocity of the centre of mass, m/s."""
        return part(now.motions[self.body].velocity, self.component)


class Acceleration(AbstractBodyQuantity):
    """Acceleration of a body's centre of mass, m/s^2: its magnitude, or a global component.

    >>> quantity = cj.quantities.Acceleration("arm 3", "y")
    >>> quantity.unit
    'm/s^2'
    """

    body: str = eqx.field(static=True)
    component: Component | None = eqx.field(default=None, static=True)
    unit: ClassVar[str | None] = "m/s^2"
    of_ground: ClassVar[bool] = False

    def __check_init__(self):
        require_component(self.component, magnitude=True)

    def __call__(self, now: Instant) -> Scalar:
        """The acceleration of the centre of mass, m/s^2."""
        return part(now.dynamics.accelerations[self.body].linear, self.component)


class AbstractPointQuantity(AbstractBodyQuantity):
    """A quantity of a point of a body; `point` is (3,) m in body axes."""

    point: eqx.AbstractVar[tuple[float, ...]]

    def __check_init__(self):
        require_point("point", self.point)


class PointPosition(AbstractPointQuantity):
    """Global coordinate of a point of a body, m.

    **Arguments:** `body`: its name; `point`: (3,) m in body axes; `component`: "x", "y" or "z".

    >>> tip = cj.quantities.PointPosition("arm 3", (0.5, 0, 0), "y")
    >>> tip.unit
    'm'
    """

    body: str = eqx.field(static=True)
    point: tuple[float, ...] = eqx.field(static=True, converter=numbers)
    component: Component = eqx.field(static=True)
    unit: ClassVar[str | None] = "m"

    def __check_init__(self):
        require_component(self.component)

    def __call__(self, now: Instant) -> Scalar:
        """The global coordinate of the point, m."""
        return getattr(now.motions[self.body].point(Vector(*self.point)), self.component)


class PointVelocity(AbstractPointQuantity):
    """Velocity of a point of a body, m/s: its magnitude, or a global component.

    **Arguments:** as `PointPosition`; `component` may be ``None``.

    >>> tip = cj.quantities.PointVelocity("arm 3", (0.5, 0, 0), "y")
    >>> tip.unit
    'm/s'
    """

    body: str = eqx.field(static=True)
    point: tuple[float, ...] = eqx.field(static=True, converter=numbers)
    component: Component | None = eqx.field(default=None, static=True)
    unit: ClassVar[str | None] = "m/s"

    def __check_init__(self):
        require_component(self.component, magnitude=True)

    def __call__(self, now: Instant) -> Scalar:
        """The velocity of the point, m/s."""
        return part(now.motions[self.body].velocity_at(Vector(*self.point)), self.component)


class PointAcceleration(AbstractPointQuantity):
    """Acceleration of a point of a body, m/s^2: its magnitude, or a component.

    An accelerometer is fixed to the body and feels its support, not the fall: it reads the specific
    force, `PointAcceleration(body, point, component, axes="body", gravity=True)`.

    **Arguments:**

    - `body`, `point`, `component`: as `PointVelocity`.
    - `axes`: "global" or "body", in which the component is taken.
    - `gravity`: whether the scene's gravity is subtracted: acceleration less g.

    >>> point = (0.06, 0, 0)
    >>> sensor = cj.quantities.PointAcceleration("rod", point, "x", axes="body", gravity=True)
    >>> sensor.unit
    'm/s^2'
    """

    body: str = eqx.field(static=True)
    point: tuple[float, ...] = eqx.field(static=True, converter=numbers)
    component: Component | None = eqx.field(default=None, static=True)
    axes: Axes = eqx.field(default="global", static=True)
    gravity: bool = eqx.field(default=False, static=True)
    unit: ClassVar[str | None] = "m/s^2"
    of_ground: ClassVar[bool] = False

    def __check_init__(self):
        require_component(self.component, magnitude=True)
        require_axes(self.axes)

    def __call__(self, now: Instant) -> Scalar:
        """The acceleration of the point, m/s^2: that of the centre of mass, and what the body's
        spin and angular acceleration add."""
        motion, acceleration = now.motions[self.body], now.dynamics.accelerations[self.body]
        local, spin, linear = Vector(*self.point), motion.spin, acceleration.linear
        turning = acceleration.angular.cross(local) + spin.cross(spin.cross(local))
        if self.gravity and now.scene.gravity is not None:
            linear = linear - now.scene.gravity
        if self.axes == "body":
            return part(motion.components(linear) + turning, self.component)
        return part(linear + motion.direction(turning), self.component)


class Angle(AbstractBodyQuantity):
    """Angle of a direction of a body about a fixed axis, rad within (-pi, pi], right-handed.

    The direction is projected on the plane across the axis first.

    **Arguments:**

    - `body`: its name.
    - `about`: (3,) the fixed axis, in global axes, of any length.
    - `axis`: (3,) the body's direction, in body axes. Unless given, one across `about` in a body
      whose axes are parallel to the global ones, so that a body that only turns about the fixed
      axis has the angle by which it has turned.
    - `reference`: (3,) the direction whose angle is zero, in global axes. Unless given, it has the
      components of `axis`.

    >>> angle = cj.quantities.Angle("crank", about=(0, 0, 1))
    >>> angle.unit, angle.period == 2 * np.pi
    ('rad', True)
    """

    body: str = eqx.field(static=True)
    about: tuple[float, ...] = eqx.field(static=True, converter=numbers)
    reference: tuple[float, ...] | None = eqx.field(
        default=None, static=True, converter=optional_numbers
    )
    axis: tuple[float, ...] | None = eqx.field(
        default=None, static=True, converter=optional_numbers
    )
    unit: ClassVar[str | None] = "rad"
    period: ClassVar[float | None] = 2.0 * math.pi

    def __check_init__(self):
        require_axis("about", self.about)
        for name in ("reference", "axis"):
            direction = getattr(self, name)
            if direction is not None:
                require_axis(name, direction)
                sine = np.linalg.norm(np.cross(self.about, direction))
                lengths = np.linalg.norm(self.about) * np.linalg.norm(direction)
                expected = f"a direction across `about` = {self.about}, at least in part"
                require(bool(sine > 1e-9 * lengths), name, direction, expected, "choose another")

    def __call__(self, now: Instant) -> Scalar:
        """The angle, rad within (-pi, pi]."""
        about = unit(Vector(*self.about))
        start, _ = transverse_axes(about)
        axis = start if self.axis is None else Vector(*self.axis)
        zero = axis if self.reference is None else Vector(*self.reference)
        zero = zero - about * zero.dot(about)
        direction = now.motions[self.body].direction(axis)
        return jnp.arctan2(direction.dot(about.cross(zero)), direction.dot(zero))
