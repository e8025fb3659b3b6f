"""A motor with proportional and derivative control."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ...fields.declarations import optional_quantity, quantity
from ...fields.types import Quadruple, QuadrupleLike, Single, Triple, TripleLike
from ...math.functions import wrapped
from ...math.smoothing import ramp
from ...math.vectors import Scalar
from .functions_of_time import AbstractFunctionOfTime, FunctionOfTime, as_function_of_time
from .rotation import AbstractDriveTorque

ROUNDING = 0.02
"""Half-width of the smooth transition to the torque limit, as a fraction of the limit."""
SI = "give it in SI units"


class Motor(AbstractDriveTorque):
    """A motor with proportional-derivative (PD) control of an angle and an optional torque limit.

    The torque is proportional (target - angle) + derivative (target's rate - speed), limited in
    both directions. Within 2 % of the limit a parabola replaces the kink, so that derivatives are
    continuous and steps stay long; elsewhere the limit is exact.

    The angle's error is taken within half a revolution. To control a speed regardless of the angle,
    set `proportional` to zero and the target to `Polynomial((0.0, speed))`.

    ```python
    import clearjoint as cj

    target = cj.Polynomial((0.0, 50.0))  # 50 rad/s
    axis = (0, 0, 1)
    motor = cj.Motor("ground", "crank", axis, target, 20.0, derivative=0.5, torque_limit=3.0)
    scene, state = cj.mechanisms.slider_crank(motor=motor)
    ```

    **Arguments:**

    - `first`, `second`: names of the bodies.
    - `axis`: of rotation, (3,) in the first body's axes, any length.
    - `orientation`: (4,) Euler parameters, scalar first, that transform components in the second
      body's frame to the first body's frame at angle zero; parallel frames by default.
    - `target`: desired angle in rad: a number, or a function as for `PrescribedAngle`.
    - `proportional`, `derivative`: gains, N m/rad and N m s/rad, not negative.
    - `torque_limit`: N m, positive; ``None`` for no limit.

    **Raises:** `ValueError` if a value is outside its range, or the target is not a function of
    time.
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    axis: Triple = quantity("1")
    target: AbstractFunctionOfTime = quantity("rad", converter=as_function_of_time)
    proportional: Single = quantity("N m/rad", shape=(), positive=True, zero=True, remedy=SI)
    derivative: Single = quantity("N m s/rad", shape=(), positive=True, zero=True, remedy=SI)
    torque_limit: Single | None = optional_quantity("N m", positive=True, remedy=SI)
    orientation: Quadruple = quantity("1")

    def __init__(
        self,
        first: str,
        second: str,
        axis: TripleLike,
        target: FunctionOfTime,
        proportional: Scalar,
        derivative: Scalar,
        torque_limit: Scalar | None = None,
        orientation: QuadrupleLike = (1.0, 0.0, 0.0, 0.0),
    ):
        self.first, self.second = first, second
        self.axis, self.orientation = axis, orientation
        self.target = as_function_of_time(target)
        self.proportional, self.derivative = proportional, derivative
        self.torque_limit = torque_limit

    def torque_at(self, angle: Scalar, speed: Scalar, t: Scalar) -> Scalar:
        """Return the control torque, N m, within the torque limit.

        **Arguments:** `angle`: rad. `speed`: its rate, rad/s. `t`: time, s.
        """
        t = jnp.asarray(t, dtype=float)
        target, target_speed = jax.jvp(self.target, (t,), (jnp.ones_like(t),))
        error = wrapped(target - angle, 2.0 * math.pi)
        torque = self.proportional * error + self.derivative * (target_speed - speed)
        return torque if self.torque_limit is None else _clipped(torque, self.torque_limit)

    def breakpoints(self) -> PyTree:
        """Return the breakpoints of the target, s."""
        return self.target.breakpoints()


def _clipped(value: Scalar, limit: Scalar) -> Scalar:
    """Return the value limited to [-limit, limit], with smooth transitions."""
    width = ROUNDING * limit
    return value - ramp(value - limit, width) + ramp(-value - limit, width)
