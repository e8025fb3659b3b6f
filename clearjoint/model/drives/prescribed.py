"""Drivers that prescribe an angle or a distance as a function of time."""

import equinox as eqx
from jaxtyping import PyTree

from ...fields.checks import require_axis
from ...fields.declarations import quantity
from ...fields.types import Quadruple, QuadrupleLike, Triple, TripleLike
from ...math.rotations import unit
from ...math.vectors import Scalar
from ..joints.base import AbstractConstraint, Motions, Row
from ..joints.constraint_rows import point_in_plane
from ..joints.pairs import AbstractPairAtPoints
from ..joints.row_combinations import row_following
from .functions_of_time import (
    AbstractFunctionOfTime,
    FunctionOfTime,
    as_function_of_time,
    require_continuous,
)
from .rotation import AbstractRotationDriver


class PrescribedAngle(AbstractRotationDriver):
    """Prescribes the second body's angle relative to the first as a function of time; one row.

    ```python
    import clearjoint as cj
    import jax.numpy as jnp

    swing = cj.PrescribedAngle("ground", "crank", (0, 0, 1), lambda t: 0.5 * jnp.sin(20.0 * t))
    measured = cj.Spline.through([0.0, 0.1, 0.2, 0.3], [0.0, 0.4, 0.1, 0.0])
    replayed = cj.PrescribedAngle("ground", "crank", (0, 0, 1), measured)
    ```

    **Arguments:**

    - `first`, `second`: names of the bodies.
    - `axis`: of rotation, (3,) in the first body's axes, any length.
    - `orientation`: (4,) Euler parameters, scalar first, that transform components in the second
      body's frame to the first body's frame at angle zero; parallel frames by default.
    - `function`: the angle in rad as a function of time in s: a `Spline` through a table, a
      `Polynomial`, a user-defined `AbstractFunctionOfTime`, or a Python function that JAX can
      differentiate twice. A Python function is part of the compiled program, has no parameters to
      vary or fit, and can't be saved in a scene file.

    **Raises:** `ValueError` if `function` is not a continuous function of time, or another value is
    invalid.
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    axis: Triple = quantity("1")
    function: AbstractFunctionOfTime = quantity("rad", converter=as_function_of_time)
    orientation: Quadruple = quantity("1")

    def __init__(
        self,
        first: str,
        second: str,
        axis: TripleLike,
        function: FunctionOfTime,
        orientation: QuadrupleLike = (1.0, 0.0, 0.0, 0.0),
    ):
        self.first, self.second = first, second
        self.axis, self.orientation = axis, orientation
        self.function = as_function_of_time(function)

    def __check_init__(self):
        require_continuous(self.function)

    def angle(self, t: Scalar) -> Scalar:
        """Return the prescribed angle, rad, at the time `t`, s."""
        return self.function(t)

    def breakpoints(self) -> PyTree:
        """Return the breakpoints of the function, s."""
        return self.function.breakpoints()


class PrescribedTranslation(AbstractPairAtPoints, AbstractConstraint):
    """Prescribes a point's distance along an axis of the first body as a function of time; one row.

    It doesn't constrain the motion across the axis: add a prismatic or cylindrical joint. The
    multiplier is the driving force in N, positive if it pushes the second body along the axis. The
    energy ledger lists its work as "supplied".

    **Arguments:**

    - `first`, `second`: names of the bodies; one may be the ground.
    - `point_first`, `point_second`: the points whose distance is prescribed, (3,) m in body axes.
    - `axis`: (3,) in the first body's axes, any length.
    - `function`: as for `PrescribedAngle`: the distance in m along the axis from the first body's
      point to the second's.

    **Raises:** as `PrescribedAngle`.

    >>> slide = cj.PrescribedTranslation(
    ...     "ground", "slider", (0, 0, 0), (0, 0, 0), (1, 0, 0), cj.Polynomial((0.0, 0.2))
    ... )
    >>> slide.body_names()
    ('ground', 'slider')
    """

    axis: Triple = quantity("1", check=require_axis)
    function: AbstractFunctionOfTime = quantity("m", converter=as_function_of_time)

    def __init__(
        self,
        first: str,
        second: str,
        point_first: TripleLike,
        point_second: TripleLike,
        axis: TripleLike,
        function: FunctionOfTime,
    ):
        self.first, self.second = first, second
        self.point_first, self.point_second = point_first, point_second
        self.axis, self.function = axis, as_function_of_time(function)

    def __check_init__(self):
        require_continuous(self.function)

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return the row "distance": the distance minus the prescribed distance, m."""
        names, pair = (self.first, self.second), (motions[self.first], motions[self.second])
        axis = unit(self.axis)
        distance = point_in_plane(names, *pair, self.point_first, axis, self.point_second)
        return {"distance": row_following(distance, self.function, t)}

    def breakpoints(self) -> PyTree:
        """Return the breakpoints of the function, s."""
        return self.function.breakpoints()
