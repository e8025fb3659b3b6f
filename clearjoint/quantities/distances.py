"""Distances between points of two bodies: what a displacement sensor between them reads."""

from typing import ClassVar

import equinox as eqx

from ..fields.checks import require_axis, require_point
from ..math.rotations import unit
from ..math.smoothing import norm_and_direction
from ..math.vectors import Scalar, Vector
from ..model.bodies import GROUND
from ..model.scene import Scene
from .base import AbstractQuantity, numbers, optional_numbers, require_known
from .instant import Instant


class Distance(AbstractQuantity):
    """Distance between a point of each of two bodies, m: straight, or along an axis of the first.

    The second is signed: how far the second point has gone along the axis, as of a slider in its
    guide.

    ```python
    import clearjoint as cj

    stretch = cj.quantities.Distance("ground", (0, 0, 0), "arm 2", (0.5, 0, 0))
    stroke = cj.quantities.Distance("ground", (0, 0, 0), "slider", (0, 0, 0), along=(1, 0, 0))
    ```

    **Arguments:**

    - `first`, `second`: names of the bodies, of which one may be the ground.
    - `point_first`, `point_second`: (3,) m, each in its body's axes.
    - `along`: (3,) in the first body's axes, of any length; ``None`` for the straight distance.

    **Raises:** `ValueError` for points or an axis that are none.
    """

    first: str = eqx.field(static=True)
    point_first: tuple[float, ...] = eqx.field(static=True, converter=numbers)
    second: str = eqx.field(static=True)
    point_second: tuple[float, ...] = eqx.field(static=True, converter=numbers)
    along: tuple[float, ...] | None = eqx.field(
        default=None, static=True, converter=optional_numbers
    )
    unit: ClassVar[str | None] = "m"

    def __check_init__(self):
        require_point("point_first", self.point_first)
        require_point("point_second", self.point_second)
        if self.along is not None:
            require_axis("along", self.along)

    def check(self, scene: Scene) -> None:
        """Check that the scene has both bodies."""
        for argument in ("first", "second"):
            require_known(argument, getattr(self, argument), [GROUND, *scene.bodies])

    def __call__(self, now: Instant) -> Scalar:
        """The distance, m."""
        first, second = now.motions[self.first], now.motions[self.second]
        start = first.point(Vector(*self.point_first))
        apart = second.point_from(start, Vector(*self.point_second))
        if self.along is None:
            return norm_and_direction(apart)[0]
        return apart.dot(first.direction(unit(Vector(*self.along))))
