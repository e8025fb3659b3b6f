"""Drivers between two bodies that turn about a common axis: a prescribed rotation, or a torque.

Neither holds the axis: a revolute joint beside it does, ideal or with clearance.
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
    """An element on the angle of a second body about an axis of a first.

    - `axis`: (3,) in the first body's axes, any length.
    - `orientation`: (4,) Euler parameters, scalar first, that turn components in the second body's
      frame into the first's where the angle is zero.
    """

    axis: eqx.AbstractVar[Triple]
    orientation: eqx.AbstractVar[Quadruple]

    def __check_init__(self):
        require_axis("axis", self.axis)
        require_euler_parameters("orientation", self.orientation)

    def relative_angle(self, motions: Motions) -> Row:
        """The angle in rad, within (-pi, pi], as a row."""
        axis = unit(self.axis)
        start, _ = transverse_axes(axis)
        direction = rotation_matrix(self.orientation).transposed_times(start)
        first, second = motions[self.first], motions[self.second]
        return turning_angle((self.first, self.second), first, second, axis, direction)


class AbstractRotationDriver(AbstractDrive, AbstractConstraint):
    """An ideal driver: the second body's angle follows a function of time; one row.

    The multiplier is the driving moment in N m, positive where it pushes the second body towards
    larger angles: `observe(...).reactions[driver]` has it as the moment on each body. Its work is
    "supplied" in the energy ledger.

    Angles count modulo 2 pi, so that the number of revolutions is unlimited.

    An angle with kinks declares their times as `breakpoints`: there velocities jump, by an impulse
    of the driver. A run whose driver isn't followed ends with `RESULTS.not_followed`.

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
        """The angle in rad at a time in s: continuous, and twice differentiable by JAX between the
        `breakpoints`."""

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """The angle less that prescribed."""
        row = row_following(self.relative_angle(motions), self.angle, t)
        return {"angle": replace(row, value=wrapped(row.value, 2.0 * math.pi))}


class PrescribedRotation(AbstractRotationDriver):
    """Turns the second body against the first at constant speed.

    **Arguments:**

    - `first`, `second`: names of the bodies.
    - `axis`: (3,) in the first body's axes, any length.
    - `speed`: rad/s, right-handed about the axis.
    - `initial_angle`: rad, at time zero.
    - `orientation`: (4,) Euler parameters, scalar first, that turn components in the second body's
      frame into the first's where the angle is zero; parallel frames by default.

    For another motion take `PrescribedAngle`, or subclass `AbstractRotationDriver`.

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
        """The initial angle and the speed times the time."""
        return self.initial_angle + self.speed * t


class AbstractDriveTorque(AbstractDrive, AbstractForce):
    """A torque about the axis on the second body, and its opposite on the first.

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
        """The torque in N m, positive towards larger angles, for an angle in rad within (-pi, pi],
        its rate in rad/s, and a time in s."""

    def wrenches(self, motions: Motions, t: Scalar) -> dict[str, Wrench]:
        """The torque and its reaction: what works on the angle's rate."""
        turn = self.relative_angle(motions)
        torque = self.torque_at(turn.value, _rate(turn, motions), t)
        return {
            name: Wrench(pair.force, pair.moment * torque) for name, pair in turn.jacobian.items()
        }

    def speed(self, motions: Motions) -> Scalar:
        """Rate of the angle, rad/s."""
        return _rate(self.relative_angle(motions), motions)


def _rate(turn: Row, motions: Motions) -> Scalar:
    return add(*(motions[name].power(pair) for name, pair in turn.jacobian.items()))


class DriveTorque(AbstractDriveTorque):
    """A torque that is constant or follows a function of time.

    ```python
    import clearjoint as cj
    import jax.numpy as jnp

    axis = (0, 0, 1)
    pulsing = cj.DriveTorque("ground", "crank", axis, lambda t: 2.0 + jnp.sin(30.0 * t))
    switched = cj.DriveTorque("ground", "crank", axis, cj.PiecewiseConstant([0, 0.2], [2.0, 0.0]))
    measured = cj.Spline.through([0.0, 0.1, 0.2, 0.3], [0.0, 1.8, 2.1, 2.0])
    replayed = cj.DriveTorque("ground", "crank", axis, measured)
    ```

    **Arguments:** as `PrescribedRotation`, but `torque`: N m, positive towards larger angles; a
    number, of which zero lets the bodies turn freely, or a function of time: a table as
    `PiecewiseConstant`, `PiecewiseLinear` or `Spline`, a `Polynomial`, an `AbstractFunctionOfTime`
    of one's own, or a Python function of JAX's. The last is part of the compiled program, and can't
    be saved in a scene file.

    For a motor whose torque depends on angle or speed subclass `AbstractDriveTorque`, or take
    `Motor`.

    **Raises:** `ValueError` for a torque that is neither, and for values no driver can have.

    >>> drive = cj.DriveTorque("ground", "crank", (0, 0, 1), torque=2.0)
    >>> scene, state = cj.mechanisms.slider_crank(motor=drive)
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    axis: Triple = quantity("1")
    torque: SingleInTime = single_in_time("N m")
    orientation: Quadruple = quantity("1", default=(1.0, 0.0, 0.0, 0.0))

    def torque_at(self, angle: Scalar, speed: Scalar, t: Scalar) -> Scalar:
        """The torque at the time, N m."""
        del angle, speed
        return value_at(self.torque, t)

    def breakpoints(self) -> PyTree:
        """Those of a torque that is a function of time, s."""
        return breakpoints_of(self.torque)
