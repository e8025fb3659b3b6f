"""Functions of time by tables without rounding: steps, and straight lines between points."""

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
    """The value of the latest time of a table: a torque or a load that is switched.

    From each time on the value beside it holds, up to the next; the first one before it too, and
    the last for ever. The times of the switches are `breakpoints` by themselves, and may be
    parameters: a step ends at each, and derivatives have the jump's own term.

    ```python
    import clearjoint as cj

    torque = cj.PiecewiseConstant([0.0, 0.2, 0.3], [2.0, -1.0, 0.0])  # N m, switched at 0.2, 0.3 s
    motor = cj.DriveTorque("ground", "crank", (0, 0, 1), torque)
    scene, state = cj.mechanisms.slider_crank(motor=motor)
    ```

    **Arguments:** `times` (N,) in s, rising; `values` (N,), or (N, 3) of a force, in the SI unit of
    what follows them.

    **Raises:** `ValueError` for rows of different lengths, of numbers that are not finite, and for
    times that do not rise.
    """

    times: Column = quantity("s", table=True)
    values: TableRows = quantity("1", table=True)
    jumps: ClassVar[bool] = True

    def __check_init__(self):
        require_rising(self.times)
        require_rows("values", self.values, np.shape(self.times))

    def __call__(self, t: Scalar) -> Scalar:
        """The value at a time in s."""
        times, values = on_device(self.times), on_device(self.values)
        return values[jnp.maximum(jnp.searchsorted(times, t, side="right") - 1, 0)]

    def breakpoints(self) -> PyTree:
        """The times at which it switches, s."""
        return self.times[1:]


class PiecewiseLinear(AbstractFunctionOfTime):
    """Straight lines between the points of a table: ramps, trapezoids.

    Before the first time the first value holds, after the last the last. Every time of the table is
    one of the `breakpoints` by itself, so that a step ends there: for a densely measured signal
    `Spline.through(times, values)` takes fewer.

    ```python
    import clearjoint as cj

    ramp = cj.PiecewiseLinear([0.0, 0.1, 0.4, 0.5], [0.0, 50.0, 50.0, 0.0])  # N
    forces = {"push": cj.AppliedLoad("arm", force=(0.0, ramp, 0.0))}
    ```

    **Arguments:** `times` (N,) in s, rising, two at least; `values` (N,), or (N, 3) of a force, in
    the SI unit of what follows them.

    **Raises:** `ValueError` as `PiecewiseConstant`.
    """

    times: Column = quantity("s", table=True)
    values: TableRows = quantity("1", table=True)

    def __check_init__(self):
        require_rising(self.times)
        require_rows("values", self.values, np.shape(self.times))

    def __call__(self, t: Scalar) -> Scalar:
        """The value at a time in s."""
        times, values = on_device(self.times), on_device(self.values)
        k = jnp.clip(jnp.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
        within = jnp.clip(t, times[0], times[-1])
        part = (within - times[k]) / (times[k + 1] - times[k])
        return values[k] + part * (values[k + 1] - values[k])

    def breakpoints(self) -> PyTree:
        """All of its times, s."""
        return self.times
