"""Drives between two bodies: prescribed rotations and translations, torques and motors."""

import abc
from dataclasses import replace
from functools import partial

import equinox as eqx
from jaxtyping import PyTree
from typing_extensions import override

from ..._fields.checks import require_axis, require_euler_parameters
from ..._fields.objects import optional_quantity, quantity
from ..._fields.types import Quadruple, Single, Triple
from ..._math.rotations import unit
from ..._math.smoothing import TURN, ramp, where, wrapped
from ..._math.vectors import Scalar
from ..bodies import Wrench
from ..joints.base import (
    PARALLEL,
    AbstractConstraint,
    AbstractForce,
    AbstractNamedPair,
    AbstractPair,
    AbstractPairAtPoints,
    Motions,
    Row,
)
from ..joints.constraint_rows import angle_about, point_in_plane, row_following, row_rate
from .functions_of_time import (
    FunctionOfTime,
    SingleInTime,
    as_function_of_time,
    breakpoints_of,
    require_continuous,
    single_in_time,
    value_and_rate,
    value_at,
)


class AbstractDrive(AbstractPair):
    """Base class of elements that prescribe the second body's angle about an axis or apply a torque
    about the axis. They do not hold the bodies on the axis: add a revolute joint, ideal or with
    clearance. `axis` is in the first body's axes, any length. `orientation`, (4,) Euler parameters,
    scalar first, transforms components in the second body's axes to the first's at angle zero."""

    axis: eqx.AbstractVar[Triple]
    orientation: eqx.AbstractVar[Quadruple]

    @override
    def __check_init__(self):
        require_axis("axis", self.axis)
        require_euler_parameters("orientation", self.orientation)

    def relative_angle(self, motions: Motions) -> Row:
        """Return the second body's angle about the axis, rad in [-pi, pi], right-handed."""
        return angle_about(*self._between(motions), self.axis, self.orientation)

    def speed(self, motions: Motions) -> Scalar:
        """Return the rate of the angle of the second body relative to the first, rad/s."""
        return row_rate(self.relative_angle(motions), motions)


class AbstractDriveAboutAxis(AbstractNamedPair, AbstractDrive):
    """Base class of drives whose first fields are the bodies' names and the axis; subclasses
    declare `orientation` last, since it has a default."""

    axis: Triple = quantity("1")


class AbstractRotationDriver(AbstractDrive, AbstractConstraint):
    """Base class of ideal drivers: the second body's angle follows a function of time.

    A subclass defines `angle` and declares the fields below; `orientation` has the Euler parameters
    of the second body in the first at angle zero. The Lagrange multiplier of the one constraint is
    the driving moment in N m, positive if it pushes the second body towards larger angles;
    `observe(...).reactions[driver]` contains it, and the energy ledger lists its work as
    "supplied". Angles are taken modulo 2 pi. If the angle has kinks, return their times from the
    method `breakpoints`: an impulse of the driver makes velocities jump there. A run ends with
    `RESULTS.not_followed` if the mechanism can't follow the driver.

    ```python
    import clearjoint as cj
    import jax.numpy as jnp

    class Swing(cj.extend.AbstractRotationDriver):
        first: str
        second: str
        axis: tuple[float, float, float]
        amplitude: float  # rad
        frequency: float  # rad/s
        orientation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)

        def angle(self, t):
            return self.amplitude * jnp.sin(self.frequency * t)

    swing = Swing("ground", "crank", (0, 0, 1), amplitude=0.5, frequency=20.0)
    ```
    """

    @abc.abstractmethod
    def angle(self, t: Scalar) -> Scalar:
        """Return the angle in rad at a time in s. It must be continuous, and JAX must be able to
        differentiate it twice between the `breakpoints`."""

    @override
    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        row = row_following(self.relative_angle(motions), self.angle, t)
        return {"angle": replace(row, value=wrapped(row.value, TURN))}


class PrescribedRotation(AbstractDriveAboutAxis, AbstractRotationDriver):
    """Rotates the second body relative to the first at constant speed.

    For other motions use `PrescribedAngle`. A revolute joint has to hold the axis.

    **Arguments:**

    - `axis`: of rotation, (3,) in the first body's axes, any length.
    - `speed`: rad/s, right-handed about the axis.
    - `initial_angle`: rad, at time zero; zero by default.
    - `orientation`: (4,) Euler parameters, scalar first, that transform components in the second
      body's frame to the first body's frame at angle zero; parallel frames by default.

    >>> drive = cj.PrescribedRotation("ground", "crank", (0, 0, 1), speed=50.0)
    >>> print(f"{drive.angle(0.1):.1f} rad")
    5.0 rad
    """

    speed: Single = quantity("rad/s", shape=())
    initial_angle: Single = quantity("rad", shape=(), default=0.0)
    orientation: Quadruple = quantity("1", default=PARALLEL)

    @override
    def angle(self, t: Scalar) -> Scalar:
        return self.initial_angle + self.speed * t


class AbstractDriveTorque(AbstractDrive, AbstractForce):
    """Base class of torques on a second body about an axis of a first, which gets the reaction.

    A subclass declares the fields of a drive (`first`, `second`, `axis`, and `orientation`, that of
    the second body at angle zero) and defines the torque as a function of the second body's angle
    about the axis, the rate of this angle, and time:

    ```python
    import clearjoint as cj

    class Motor(cj.extend.AbstractDriveTorque):
        first: str
        second: str
        axis: tuple[float, float, float]
        stall_torque: float  # N m
        idle_speed: float  # rad/s
        orientation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)

        def torque_at(self, angle, speed, t):
            return self.stall_torque * (1.0 - speed / self.idle_speed)

    motor = Motor("ground", "crank", (0, 0, 1), stall_torque=2.0, idle_speed=600.0)
    scene, state = cj.mechanisms.slider_crank(motor=motor)
    ```
    """

    @abc.abstractmethod
    def torque_at(self, angle: Scalar, speed: Scalar, t: Scalar) -> Scalar:
        """Return the torque in N m, positive towards larger angles.

        **Arguments:** `angle`: rad, in [-pi, pi]. `speed`: its rate, rad/s. `t`: s.
        """

    @override
    def wrenches(self, motions: Motions, t: Scalar) -> dict[str, Wrench]:
        return torque_about(self.relative_angle(motions), self.present_torque(motions, t))

    def present_torque(self, motions: Motions, t: Scalar) -> Scalar:
        """Return the torque on the second body at time `t` in s, N m."""
        angle = self.relative_angle(motions)
        return self.torque_at(angle.value, row_rate(angle, motions), t)


def torque_about(angle: Row, torque: Scalar) -> dict[str, Wrench]:
    """Return, by body, the wrench of `torque`, N m, about the axis to which `angle` refers."""
    # The Jacobian of the angle is the wrench of a torque of 1 N m on each body, without a force.
    return {name: Wrench(pair.force, pair.moment * torque) for name, pair in angle.jacobian.items()}


class DriveTorque(AbstractDriveAboutAxis, AbstractDriveTorque):
    """A torque on the second body about an axis of the first, constant or a function of time.

    For a torque that depends on angle or speed, use `Motor`, or subclass `AbstractDriveTorque`.

    **Arguments:**

    - `torque`: N m, positive towards larger angles: a number, or a function of time such as a
      `PiecewiseConstant`, `PiecewiseLinear`, `Spline`, `Polynomial`, a user-defined
      `AbstractFunctionOfTime`, or a Python function that JAX can trace. The latter is part of the
      compiled program, can't be saved in a scene file or declare the times of its jumps and kinks.
    - `axis`: of the torque, (3,) in the first body's axes, any length. `orientation`: (4,) Euler
      parameters of the second body in the first at angle zero, as in `PrescribedRotation`.

    >>> axis, steps = (0, 0, 1), cj.PiecewiseConstant([0, 0.2], [2.0, 0.0])
    >>> switched = cj.DriveTorque("ground", "crank", axis, steps)
    >>> pulsing = cj.DriveTorque("ground", "crank", axis, lambda t: 2.0 + jnp.sin(30.0 * t))
    """

    torque: SingleInTime = single_in_time("N m")
    orientation: Quadruple = quantity("1", default=PARALLEL)

    @override
    def torque_at(self, angle: Scalar, speed: Scalar, t: Scalar) -> Scalar:
        return value_at(self.torque, t)

    @override
    def breakpoints(self) -> PyTree:
        return breakpoints_of(self.torque)


class PrescribedAngle(AbstractDriveAboutAxis, AbstractRotationDriver):
    """Prescribes the second body's angle relative to the first as a function of time.

    **Arguments:**

    - `function`: the angle in rad as a continuous function of time in s: a `Spline` or
      `PiecewiseLinear` table, a `Polynomial`, a user-defined `AbstractFunctionOfTime`, or a Python
      function that JAX can differentiate twice; or a number if constant. A Python function is part
      of the compiled program, has no parameters to vary or fit, and can't be saved in a scene file.
    - `axis`: of rotation, (3,) in the first body's axes, any length. `orientation`: (4,) Euler
      parameters of the second body in the first at angle zero, as in `PrescribedRotation`.

    >>> measured = cj.Spline.through([0.0, 0.1, 0.2, 0.3], [0.0, 0.4, 0.1, 0.0])
    >>> replayed = cj.PrescribedAngle("ground", "crank", (0, 0, 1), measured)
    """

    function: FunctionOfTime = quantity("rad", converter=as_function_of_time)
    orientation: Quadruple = quantity("1", default=PARALLEL)

    @override
    def __check_init__(self):
        require_continuous(self.function)

    @override
    def angle(self, t: Scalar) -> Scalar:
        return value_at(as_function_of_time(self.function), t)

    @override
    def breakpoints(self) -> PyTree:
        return breakpoints_of(self.function)


class PrescribedTranslation(AbstractPairAtPoints, AbstractConstraint):
    """Prescribes the distance of two points along an axis of the first body as a function of time.

    It constrains neither the motion across the axis nor rotations: add a prismatic or cylindrical
    joint. The Lagrange multiplier of its one constraint is the driving force, N, positive if it
    pushes the second body along the axis; its work is "supplied" in the energy ledger of a run.

    **Arguments:**

    - `point_first`, `point_second`: the points whose distance is prescribed, (3,) m from each
      body's centre of mass in its axes.
    - `axis`: (3,) in the first body's axes, any length.
    - `function`: distance in m from the first body's point to the second's along the axis, negative
      against its direction: a number or a function of time, as for `PrescribedAngle`.

    >>> slide = cj.PrescribedTranslation(
    ...     "ground", "slider", (0, 0, 0), (0, 0, 0), (1, 0, 0), cj.Polynomial((0.0, 0.2))
    ... )
    >>> slide.body_names()
    ('ground', 'slider')
    """

    axis: Triple = quantity("1", check=require_axis)
    function: FunctionOfTime = quantity("m", converter=as_function_of_time)

    @override
    def __check_init__(self):
        require_continuous(self.function)

    @override
    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        points = self.point_first, unit(self.axis), self.point_second
        distance = point_in_plane(*self._between(motions), *points)
        prescribed = partial(value_at, as_function_of_time(self.function))
        return {"distance": row_following(distance, prescribed, t)}

    @override
    def breakpoints(self) -> PyTree:
        return breakpoints_of(self.function)


ROUNDING = 0.02
"""Distance from a torque limit, over the limit, within which a parabola replaces the kink."""
SI = "give it in SI units"


def limited(torque: Scalar, lowest: Scalar, highest: Scalar, width: Scalar) -> Scalar:
    """Return a torque limited to the range from `lowest` to `highest`, N m. From `width` below each
    limit to `width` above it, N m, a parabola replaces the kink."""
    # The excess above the upper limit is subtracted, and the shortfall below the lower limit is
    # added. Ramps make both zero between the limits; they are smooth, so that the torque has no
    # kinks.
    return torque - ramp(torque - highest, width) + ramp(lowest - torque, width)


class Motor(AbstractDriveAboutAxis, AbstractDriveTorque):
    """A motor with proportional-derivative (PD) control of an angle and an optional torque limit.

    The torque is P (target - angle) + D (target's rate - speed), with the gains P and D in the
    arguments `proportional` and `derivative`. It is limited in both directions. Within 2 % of the
    limit a parabola replaces the kink, so that derivatives are continuous and steps stay long;
    elsewhere the limit is exact.

    The error, target - angle, is taken within half a revolution. To control a speed regardless of
    the angle, set `proportional` to zero and the target to `Polynomial((0.0, speed))`.

    **Arguments:**

    - `target`: desired angle in rad: a number, or a function as for `PrescribedAngle`. It may also
      be a `PiecewiseConstant`, whose rate counts as zero.
    - `proportional`, `derivative`: gains, N m/rad and N m s/rad, not negative.
    - `torque_limit`: N m, positive; ``None``, the default, for no limit.
    - `axis`: of the torque, (3,) in the first body's axes, any length. `orientation`: (4,) Euler
      parameters of the second body in the first at angle zero, as in `PrescribedRotation`.

    >>> axis, target = (0, 0, 1), cj.Polynomial((0.0, 50.0))  # 50 rad/s
    >>> motor = cj.Motor("ground", "crank", axis, target, 20.0, derivative=0.5, torque_limit=3.0)
    >>> scene, state = cj.mechanisms.slider_crank(motor=motor)
    """

    target: FunctionOfTime = quantity("rad", converter=as_function_of_time)
    proportional: Single = quantity("N m/rad", shape=(), positive=True, zero=True, remedy=SI)
    derivative: Single = quantity("N m s/rad", shape=(), positive=True, zero=True, remedy=SI)
    torque_limit: Single | None = optional_quantity("N m", positive=True, remedy=SI)
    orientation: Quadruple = quantity("1", default=PARALLEL)

    @override
    def torque_at(self, angle: Scalar, speed: Scalar, t: Scalar) -> Scalar:
        target, target_speed = value_and_rate(self.target, t)
        error = self._error(target, angle)
        torque = self.proportional * error + self.derivative * (target_speed - speed)
        limit = self.torque_limit
        return torque if limit is None else limited(torque, -limit, limit, ROUNDING * limit)

    def _error(self, target: Scalar, angle: Scalar) -> Scalar:
        # Within half a revolution: `angle` is known only up to whole revolutions.
        return wrapped(target - angle, TURN)

    @override
    def deviations(self, motions: Motions, t: Scalar) -> tuple[Scalar, ...]:
        target = value_at(as_function_of_time(self.target), t)
        error = self._error(target, self.relative_angle(motions).value)
        # At half a revolution the error jumps, and with a proportional gain the torque too.
        return (where(self.proportional > 0.0, error, 0.0),)

    @override
    def breakpoints(self) -> PyTree:
        return breakpoints_of(self.target)
