"""Functions of time from tables: piecewise constant and piecewise linear."""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ...fields.conversion import on_device
from ...fields.declarations import quantity
from ...fields.types import Column, TableRows
from ...math.vectors import Scalar
from .functions_of_time import AbstractFunctionOfTime, require_rising, require_rows


class PiecewiseConstant(AbstractFunctionOfTime):
    """A step function from a table, for torques and loads that are switched.

    Each value holds from its time until the next; the first value also holds before the first time,
    the last value after the last time. The times are declared as `breakpoints` and may be
    parameters: steps end there, and derivatives include the effect of each jump.

    ```python
    import clearjoint as cj

    torque = cj.PiecewiseConstant([0.0, 0.2, 0.3], [2.0, -1.0, 0.0])  # N m, switched at 0.2, 0.3 s
    motor = cj.DriveTorque("ground", "crank", (0, 0, 1), torque)
    scene, state = cj.mechanisms.slider_crank(motor=motor)
    ```

    **Arguments:**

    - `times`: (N,) s, increasing.
    - `values`: (N,), or (N, 3) for a force, in the SI unit of the quantity.

    **Raises:** `ValueError` if the arrays have different lengths, a number is not finite, or the
    times are not increasing.
    """

    times: Column = quantity("s", table=True)
    values: TableRows = quantity("1", table=True)
    jumps: ClassVar[bool] = True

    def __check_init__(self):
        require_rising(self.times)
        require_rows("values", self.values, np.shape(self.times))

    def __call__(self, t: Scalar) -> Scalar:
        """Return the value at a time in s."""
        times, values = on_device(self.times), on_device(self.values)
        return values[jnp.maximum(jnp.searchsorted(times, t, side="right") - 1, 0)]

    def breakpoints(self) -> PyTree:
        """Return the switching times, s."""
        return self.times[1:]


class PiecewiseLinear(AbstractFunctionOfTime):
    """Linear interpolation of a table, such as ramps and trapezoids.

    The first value holds before the first time, the last value after the last time. All times are
    declared as `breakpoints`, so that a step ends at each: for a densely sampled signal
    `Spline.through(times, values)` needs fewer steps.

    ```python
    import clearjoint as cj

    ramp = cj.PiecewiseLinear([0.0, 0.1, 0.4, 0.5], [0.0, 50.0, 50.0, 0.0])  # N
    forces = {"push": cj.AppliedLoad("arm", force=(0.0, ramp, 0.0))}
    ```

    **Arguments:**

    - `times`: (N,) s, increasing, at least two.
    - `values`: (N,), or (N, 3) for a force, in the SI unit of the quantity.

    **Raises:** `ValueError` as for `PiecewiseConstant`.
    """

    times: Column = quantity("s", table=True)
    values: TableRows = quantity("1", table=True)

    def __check_init__(self):
        require_rising(self.times)
        require_rows("values", self.values, np.shape(self.times))

    def __call__(self, t: Scalar) -> Scalar:
        """Return the value at a time in s."""
        times, values = on_device(self.times), on_device(self.values)
        k = jnp.clip(jnp.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
        inside = jnp.clip(t, times[0], times[-1])
        fraction = (inside - times[k]) / (times[k + 1] - times[k])
        return values[k] + fraction * (values[k + 1] - values[k])

    def breakpoints(self) -> PyTree:
        """Return all times of the table, s."""
        return self.times
