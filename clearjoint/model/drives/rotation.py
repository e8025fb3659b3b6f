"""Drivers between two bodies with a common axis of rotation: a prescribed rotation or a torque.

They don't hold the axis: add a revolute joint, ideal or with clearance.
"""

import abc
import math
from dataclasses import replace

import equinox as eqx
from jaxtyping import PyTree

from ...fields.checks import require_axis, require_euler_parameters
from ...fields.declarations import quantity
from ...fields.types import Quadruple, Single, Triple
from ...math.functions import wrapped
from ...math.rotations import rotation_matrix, transverse_axes, unit
from ...math.vectors import Scalar, add
from ..bodies import Wrench
from ..joints.base import AbstractConstraint, AbstractForce, Motions, Row
from ..joints.constraint_rows import turning_angle
from ..joints.pairs import AbstractPair
from ..joints.row_combinations import row_following
from .in_time import SingleInTime, breakpoints_of, single_in_time, value_at


class AbstractDrive(AbstractPair):
    """Base class of elements that act on the angle of a second body about an axis of a first body.

    - `axis`: (3,) in the first body's axes, any length.
    - `orientation`: (4,) Euler parameters, scalar first, that transform components in the second
      body's frame to the first body's frame at angle zero.
    """

    axis: eqx.AbstractVar[Triple]
    orientation: eqx.AbstractVar[Quadruple]

    def __check_init__(self):
        require_axis("axis", self.axis)
        require_euler_parameters("orientation", self.orientation)

    def relative_angle(self, motions: Motions) -> Row:
        """Return the second body's angle about the axis relative to the first body, as a row.

        The row has the value of the angle, rad within (-pi, pi], and its Jacobian. The angle is
        right-handed about the axis.
        """
        axis = unit(self.axis)
        start, _ = transverse_axes(axis)
        direction = rotation_matrix(self.orientation).transposed_times(start)
        first, second = motions[self.first], motions[self.second]
        return turning_angle((self.first, self.second), first, second, axis, direction)


class AbstractRotationDriver(AbstractDrive, AbstractConstraint):
    """An ideal driver: the second body's angle follows a function of time; one row.

    The multiplier is the driving moment in N m, positive if it pushes the second body towards
    larger angles: `observe(...).reactions[driver]` has it as the moment on each body. The energy
    ledger lists its work as "supplied". Angles are taken modulo 2 pi, so that the number of
    revolutions is unlimited.

    If the angle has kinks, declare their times as `breakpoints`: velocities jump there by an
    impulse of the driver. A run ends with `RESULTS.not_followed` if the driver can't be followed.

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
    scene, guess = cj.mechanisms.slider_crank(motor=swing)
    state = cj.assemble(scene, guess)
    ```
    """

    @abc.abstractmethod
    def angle(self, t: Scalar) -> Scalar:
        """Return the angle in rad at a time in s.

        It must be continuous, and JAX must be able to differentiate it twice between the
        `breakpoints`.
        """

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return one row, "angle": the angle minus the prescribed angle, rad modulo 2 pi."""
        row = row_following(self.relative_angle(motions), self.angle, t)
        return {"angle": replace(row, value=wrapped(row.value, 2.0 * math.pi))}


class PrescribedRotation(AbstractRotationDriver):
    """Rotates the second body relative to the first at constant speed.

    For other motions use `PrescribedAngle`, or subclass `AbstractRotationDriver`.

    **Arguments:**

    - `first`, `second`: names of the bodies.
    - `axis`: (3,) in the first body's axes, any length.
    - `speed`: rad/s, right-handed about the axis.
    - `initial_angle`: rad, at time zero.
    - `orientation`: (4,) Euler parameters, scalar first, that transform components in the second
      body's frame to the first body's frame at angle zero; parallel frames by default.

    >>> drive = cj.PrescribedRotation("ground", "crank", (0, 0, 1), speed=50.0)
    >>> print(f"{drive.angle(0.1):.1f} rad")
    5.0 rad
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    axis: Triple = quantity("1")
    speed: Single = quantity("rad/s", shape=())
    initial_angle: Single = quantity("rad", shape=(), default=0.0)
    orientation: Quadruple = quantity("1", default=(1.0, 0.0, 0.0, 0.0))

    def angle(self, t: Scalar) -> Scalar:
        """Return the initial angle plus speed times time, rad."""
        return self.initial_angle + self.speed * t


class AbstractDriveTorque(AbstractDrive, AbstractForce):
    """Base class of torques about an axis on the second body, with the reaction on the first.

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

        **Arguments:** `angle`: rad, within (-pi, pi]. `speed`: its rate, rad/s. `t`: s.
        """

    def wrenches(self, motions: Motions, t: Scalar) -> dict[str, Wrench]:
        """Return the torque on the second body and its reaction on the first, by body."""
        angle = self.relative_angle(motions)
        torque = self.torque_at(angle.value, _rate(angle, motions), t)
        return {
            name: Wrench(pair.force, pair.moment * torque) for name, pair in angle.jacobian.items()
        }

    def speed(self, motions: Motions) -> Scalar:
        """Return the rate of the angle of the second body relative to the first, rad/s."""
        return _rate(self.relative_angle(motions), motions)


def _rate(angle: Row, motions: Motions) -> Scalar:
    return add(*(motions[name].power(pair) for name, pair in angle.jacobian.items()))


class DriveTorque(AbstractDriveTorque):
    """A torque that is constant or a function of time.

    For a torque that depends on angle or speed subclass `AbstractDriveTorque`, or use `Motor`.

    ```python
    import clearjoint as cj
    import jax.numpy as jnp

    axis = (0, 0, 1)
    pulsing = cj.DriveTorque("ground", "crank", axis, lambda t: 2.0 + jnp.sin(30.0 * t))
    switched = cj.DriveTorque("ground", "crank", axis, cj.PiecewiseConstant([0, 0.2], [2.0, 0.0]))
    measured = cj.Spline.through([0.0, 0.1, 0.2, 0.3], [0.0, 1.8, 2.1, 2.0])
    replayed = cj.DriveTorque("ground", "crank", axis, measured)
    ```

    **Arguments:**

    - `first`, `second`: names of the bodies.
    - `axis`: of rotation, (3,) in the first body's axes, any length.
    - `orientation`: (4,) Euler parameters, scalar first, that transform components in the second
      body's frame to the first body's frame at angle zero; parallel frames by default.
    - `torque`: N m, positive towards larger angles: a number, or a function of time such as
      `PiecewiseConstant`, `PiecewiseLinear`, `Spline`, `Polynomial`, a user-defined
      `AbstractFunctionOfTime`, or a Python function that JAX can trace. A Python function is part
      of the compiled program and can't be saved in a scene file.

    **Raises:** `ValueError` if the torque is neither a number nor a function, or another value is
    invalid.

    >>> drive = cj.DriveTorque("ground", "crank", (0, 0, 1), torque=2.0)
    >>> scene, state = cj.mechanisms.slider_crank(motor=drive)
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    axis: Triple = quantity("1")
    torque: SingleInTime = single_in_time("N m")
    orientation: Quadruple = quantity("1", default=(1.0, 0.0, 0.0, 0.0))

    def torque_at(self, angle: Scalar, speed: Scalar, t: Scalar) -> Scalar:
        """Return the torque at the time `t`, s, in N m."""
        del angle, speed
        return value_at(self.torque, t)

    def breakpoints(self) -> PyTree:
        """Return the breakpoints of a torque that is a function of time, s."""
        return breakpoints_of(self.torque)
