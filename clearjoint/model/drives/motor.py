"""A motor under control."""

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
"""Of the torque limit, on either side of it: where the torque bends into it."""
SI = "give it in SI units"


class Motor(AbstractDriveTorque):
    """A motor that follows an angle by a proportional and derivative (PD) control, up to a limit of
    its torque.

    The torque is proportional (target - angle) + derivative (target's rate - speed), clipped to
    the limit either way. Around the limit it bends into it by a parabola, over a fiftieth of the
    limit to both sides, so that its derivatives are continuous and steps stay long; everywhere else
    the clipping is exact.

    The angle's error counts within half a turn either way. For the control of a speed, whatever
    the angle, `proportional` is zero and the target `Polynomial((0.0, speed))`.

    ```python
    import clearjoint as cj

    target = cj.Polynomial((0.0, 50.0))  # 50 rad/s
    axis = (0, 0, 1)
    motor = cj.Motor("ground", "crank", axis, target, 20.0, derivative=0.5, torque_limit=3.0)
    scene, state = cj.mechanisms.slider_crank(motor=motor)
    ```

    **Arguments:**

    - `first`, `second`, `axis`, `orientation`: as `PrescribedRotation`.
    - `target`: the angle in rad to be followed: a number, or a function as of `PrescribedAngle`.
    - `proportional` N m/rad and `derivative` N m s/rad: the gains, not negative.
    - `torque_limit`: N m, positive; ``None`` if there is no limit.

    **Raises:** `ValueError` for values that no motor can have, and what is no function of time.
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
        """The control's torque within the limit, N m."""
        t = jnp.asarray(t, dtype=float)
        target, target_speed = jax.jvp(self.target, (t,), (jnp.ones_like(t),))
        error = wrapped(target - angle, 2.0 * math.pi)
        torque = self.proportional * error + self.derivative * (target_speed - speed)
        return torque if self.torque_limit is None else _clipped(torque, self.torque_limit)

    def breakpoints(self) -> PyTree:
        """Those of the target, s."""
        return self.target.breakpoints()


def _clipped(value: Scalar, limit: Scalar) -> Scalar:
    """The value within a limit either way, rounded where it meets the limit."""
    width = ROUNDING * limit
    return value - ramp(value - limit, width) + ramp(-value - limit, width)
