"""Quantities of bodies and their points, such as the signals of cameras and accelerometers."""

import math
from functools import partial
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from typing_extensions import override

from .._fields.checks import require, require_axis, require_point
from .._math.rotations import transverse_axes, unit
from .._math.smoothing import norm_and_direction
from .._math.vectors import Scalar, Vector
from .._model.bodies import GROUND
from .._model.scene import Scene
from .base import (
    AbstractQuantity,
    AbstractVectorQuantity,
    Axes,
    Component,
    Instant,
    Numbers,
    as_axes,
    as_component,
    numbers,
    one_of,
    optional_numbers,
    require_known,
)


class AbstractBodyQuantity(AbstractQuantity):
    """Base class of quantities of a body, which may be the ground if `applies_to_ground`."""

    body: str = eqx.field(static=True)
    applies_to_ground: ClassVar[bool] = True

    @override
    def check(self, scene: Scene) -> None:
        bodies = [GROUND, *scene.bodies] if self.applies_to_ground else scene.bodies
        require_known("body", self.body, bodies)


class Position(AbstractBodyQuantity):
    """Global coordinate of a body's centre of mass, m.

    >>> height = cj.quantities.Position("arm 3", "z")
    """

    component: Component = eqx.field(static=True, converter=as_component)
    unit: ClassVar[str | None] = "m"

    @override
    def __call__(self, now: Instant) -> Scalar:
        return getattr(now.motions[self.body].position, self.component)


class Velocity(AbstractVectorQuantity, AbstractBodyQuantity):
    """Velocity of a body's centre of mass, m/s: its magnitude or a global component.

    >>> velocity = cj.quantities.Velocity("arm 3", "y")
    """

    unit: ClassVar[str | None] = "m/s"

    @override
    def vector(self, now: Instant) -> Vector:
        return now.motions[self.body].velocity


class Acceleration(AbstractVectorQuantity, AbstractBodyQuantity):
    """Acceleration of a body's centre of mass, m/s^2: its magnitude or a global component.

    >>> shock = cj.quantities.Acceleration("arm 3", "y")
    """

    unit: ClassVar[str | None] = "m/s^2"
    applies_to_ground: ClassVar[bool] = False

    @override
    def vector(self, now: Instant) -> Vector:
        return now.dynamics.accelerations[self.body].linear


class AbstractPointQuantity(AbstractBodyQuantity):
    """Base class of quantities of a `point` of a body, m from the centre of mass in body axes."""

    point: Numbers = eqx.field(static=True, converter=partial(numbers, argument="point"))

    def __check_init__(self):
        require_point("point", self.point)


class PointPosition(AbstractPointQuantity):
    """Global coordinate of a point of a body, m.

    >>> tip = cj.quantities.PointPosition("arm 3", (0.5, 0, 0), "y")
    """

    component: Component = eqx.field(static=True, converter=as_component)
    unit: ClassVar[str | None] = "m"

    @override
    def __call__(self, now: Instant) -> Scalar:
        return getattr(now.motions[self.body].point(Vector(*self.point)), self.component)


class PointVelocity(AbstractVectorQuantity, AbstractPointQuantity):
    """Velocity of a point of a body, m/s: its magnitude or a global component.

    >>> velocity = cj.quantities.PointVelocity("arm 3", (0.5, 0, 0), "y")
    """

    unit: ClassVar[str | None] = "m/s"

    @override
    def vector(self, now: Instant) -> Vector:
        return now.motions[self.body].velocity_at(Vector(*self.point))


class PointAcceleration(AbstractVectorQuantity, AbstractPointQuantity):
    """Acceleration of a point of a body, m/s^2: its magnitude or a component.

    With `gravity`, the scene's gravity is subtracted: the result is the specific force, which an
    accelerometer on the body measures in body axes.

    >>> point = (0.06, 0, 0)
    >>> cj.quantities.PointAcceleration("rod", point, "x", axes="body", gravity=True).unit
    'm/s^2'
    """

    axes: Axes = eqx.field(default="global", static=True, converter=as_axes)
    gravity: bool = eqx.field(default=False, static=True, converter=one_of("gravity", True, False))
    unit: ClassVar[str | None] = "m/s^2"
    applies_to_ground: ClassVar[bool] = False

    @override
    def vector(self, now: Instant) -> Vector:
        motion, acceleration = now.motions[self.body], now.dynamics.accelerations[self.body]
        # Acceleration of the point relative to the centre of mass, in body axes.
        local, spin, linear = Vector(*self.point), motion.spin, acceleration.linear
        relative = acceleration.angular.cross(local) + spin.cross(spin.cross(local))
        if self.gravity and now.scene.gravity is not None:
            linear = linear - now.scene.gravity
        if self.axes == "body":
            return motion.components(linear) + relative
        return linear + motion.direction(relative)


class AngularVelocity(AbstractVectorQuantity, AbstractBodyQuantity):
    """Angular velocity of a body, rad/s: its magnitude or a component; a gyroscope measures the
    components in body axes.

    >>> spin = cj.quantities.AngularVelocity("arm 2", "z")
    >>> outputs = {"fastest": cj.Peak(spin, "rad/s")}
    """

    axes: Axes = eqx.field(default="global", static=True, converter=as_axes)
    unit: ClassVar[str | None] = "rad/s"

    @override
    def vector(self, now: Instant) -> Vector:
        motion = now.motions[self.body]
        return motion.spin if self.axes == "body" else motion.direction(motion.spin)


class AngularAcceleration(AbstractVectorQuantity, AbstractBodyQuantity):
    """Angular acceleration of a body, rad/s^2: its magnitude or a component.

    >>> jolt = cj.quantities.AngularAcceleration("arm 2", "z")
    """

    axes: Axes = eqx.field(default="global", static=True, converter=as_axes)
    unit: ClassVar[str | None] = "rad/s^2"
    applies_to_ground: ClassVar[bool] = False

    @override
    def vector(self, now: Instant) -> Vector:
        angular = now.dynamics.accelerations[self.body].angular
        if self.axes == "global":
            angular = now.motions[self.body].direction(angular)
        return angular


class Angle(AbstractBodyQuantity):
    """Angle of a direction of a body about a fixed axis, rad within (-pi, pi], right-handed.

    The angle is measured in the plane perpendicular to the fixed axis, from a fixed direction to
    the projection of the body's direction. The angle is undefined, and changes abruptly, where the
    body's direction is parallel to the fixed axis.

    **Arguments:**

    - `about`: the fixed axis, (3,) in global axes, any length.
    - `reference`: the fixed direction of zero angle, (3,) in global axes; by default with the
      components of `axis`, so that the angle of a body that only rotates about the fixed axis is
      zero while its axes are the global ones.
    - `axis`: the body's direction, (3,) in body axes; by default with the components of a vector
      perpendicular to `about`, (1, 0, 0) for the z axis. Pass it if you pass `reference`.

    **Raises:** `ValueError` for a direction that is not three finite numbers or has zero length,
    and for a `reference`, or an `axis` without a `reference`, whose components are proportional to
    the components of `about`.

    >>> angle = cj.quantities.Angle("crank", about=(0, 0, 1))
    >>> angle.unit, angle.period == 2 * np.pi
    ('rad', True)
    """

    about: Numbers = eqx.field(static=True, converter=partial(numbers, argument="about"))
    reference: Numbers | None = eqx.field(
        default=None, static=True, converter=partial(optional_numbers, argument="reference")
    )
    axis: Numbers | None = eqx.field(
        default=None, static=True, converter=partial(optional_numbers, argument="axis")
    )
    unit: ClassVar[str | None] = "rad"
    period: ClassVar[float | None] = 2.0 * math.pi

    def __check_init__(self):
        require_axis("about", self.about)
        if self.axis is not None:
            require_axis("axis", self.axis)
        # The direction of zero angle has the components of `axis` if `reference` is left out.
        name = "axis" if self.reference is None else "reference"
        zero = getattr(self, name)
        if zero is not None:
            require_axis(name, zero)
            sine = np.linalg.norm(np.cross(self.about, zero))
            lengths = np.linalg.norm(self.about) * np.linalg.norm(zero)
            # The margin, a sine of 1e-9, is far above rounding errors.
            expected = f"a direction that is not parallel to `about` = {self.about}"
            require(bool(sine > 1e-9 * lengths), name, zero, expected, "choose another")

    @override
    def __call__(self, now: Instant) -> Scalar:
        about = unit(Vector(*self.about))
        start, _ = transverse_axes(about)
        axis = start if self.axis is None else Vector(*self.axis)
        zero = axis if self.reference is None else Vector(*self.reference)
        # Only the part perpendicular to the fixed axis defines the direction of zero angle.
        zero = zero - about * zero.dot(about)
        direction = now.motions[self.body].direction(axis)
        return jnp.arctan2(direction.dot(about.cross(zero)), direction.dot(zero))


class Distance(AbstractQuantity):
    """Distance between a point of one body and a point of another, m: what a displacement sensor
    reads. Points are in body axes, m from the centres of mass. With `along`, a direction of any
    length in the first body's axes, the quantity is the component in this direction of the vector
    from the first point to the second, such as a slider's stroke.

    >>> stretch = cj.quantities.Distance("ground", (0, 0, 0), "arm 2", (0.5, 0, 0))
    >>> stroke = cj.quantities.Distance("ground", (0, 0, 0), "slider", (0, 0, 0), along=(1, 0, 0))
    """

    first: str = eqx.field(static=True)
    point_first: Numbers = eqx.field(
        static=True, converter=partial(numbers, argument="point_first")
    )
    second: str = eqx.field(static=True)
    point_second: Numbers = eqx.field(
        static=True, converter=partial(numbers, argument="point_second")
    )
    along: Numbers | None = eqx.field(
        default=None, static=True, converter=partial(optional_numbers, argument="along")
    )
    unit: ClassVar[str | None] = "m"

    def __check_init__(self):
        require_point("point_first", self.point_first)
        require_point("point_second", self.point_second)
        if self.along is not None:
            require_axis("along", self.along)

    @override
    def check(self, scene: Scene) -> None:
        for argument in ("first", "second"):
            require_known(argument, getattr(self, argument), [GROUND, *scene.bodies])

    @override
    def __call__(self, now: Instant) -> Scalar:
        first, second = now.motions[self.first], now.motions[self.second]
        start = first.point(Vector(*self.point_first))
        apart = second.point_from(start, Vector(*self.point_second))
        if self.along is None:
            return norm_and_direction(apart)[0]
        return apart.dot(first.direction(unit(Vector(*self.along))))
