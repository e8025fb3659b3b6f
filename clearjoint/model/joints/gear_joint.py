"""Ideal mesh of two gears."""

import math
from dataclasses import replace

import equinox as eqx

from ...fields.checks import (
    checkable,
    require,
    require_axis,
    require_euler_parameters,
    require_positive,
)
from ...fields.declarations import quantity
from ...fields.types import ArrayLike, Quadruple, Single, Triple
from ...math.functions import wrapped
from ...math.rotations import rotation_matrix, transverse_axes, unit
from ...math.vectors import EulerParameters, Scalar, Vector
from .base import AbstractConstraint, Motions, Row
from .constraint_rows import turning_angle
from .pairs import require_distinct
from .row_combinations import scaled_row, sum_of_rows

IDENTITY = (1.0, 0.0, 0.0, 0.0)


def _require_teeth(argument: str, value: ArrayLike) -> None:
    remedy = "give a whole number of teeth; of two pulleys, whole numbers in their radii's ratio"
    require_positive(argument, value, remedy)
    if (known := checkable(value)) is not None:
        (number,) = known
        require(number.round() == number, argument, number, "a whole number, positive", remedy)


class GearJoint(AbstractConstraint):
    """Fixed speed ratio of two gears on a carrier, from their numbers of teeth; one row.

    The carrier is the housing, usually "ground", or the moving arm of an epicyclic gear. The gears
    rotate in opposite senses about axes of the same direction, unless `internal` is set for a ring
    gear or for two pulleys of a belt. For bevel gears the axes may have any directions. The gear
    joint doesn't hold the axes: add revolute joints, ideal or with clearance.

    Angles are taken modulo a tooth, so that the number of revolutions is unlimited: of all meshing
    positions, the gear joint holds the nearest.

    The Lagrange multiplier is the moment on the first gear in N m. The moments on gears and carrier
    equal those of a real mesh, but the force between the teeth, which loads the bearings, is not
    modelled.

    ```python
    import clearjoint as cj

    gears = cj.GearJoint("ground", "pinion", "wheel", (0, 0, 1), (0, 0, 1), 17, 51)
    ```

    **Arguments:**

    - `carrier`, `first`, `second`: names of the carrier's and the two gears' bodies.
    - `axis_first`, `axis_second`: axis of each gear, (3,) in the carrier's axes, any length.
    - `teeth_first`, `teeth_second`: numbers of teeth, whole and positive.
    - `internal`: whether the gears rotate in the same sense; by default they don't.
    - `offset`: rad, the first gear's angle when the second gear's angle is zero.
    - `orientation_first`, `orientation_second`: (4,) Euler parameters, scalar first, that transform
      components in the gear's frame to the carrier's frame at gear angle zero; parallel frames by
      default.

    **Raises:** `ValueError` if a number of teeth is not whole and positive, or an axis or
    orientation is invalid.
    """

    carrier: str = eqx.field(static=True)
    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    axis_first: Triple = quantity("1", check=require_axis)
    axis_second: Triple = quantity("1", check=require_axis)
    teeth_first: Single = quantity("1", check=_require_teeth)
    teeth_second: Single = quantity("1", check=_require_teeth)
    internal: bool = eqx.field(default=False, static=True)
    offset: Single = quantity("rad", shape=(), default=0.0)
    orientation_first: Quadruple = quantity("1", check=require_euler_parameters, default=IDENTITY)
    orientation_second: Quadruple = quantity("1", check=require_euler_parameters, default=IDENTITY)

    def __check_init__(self):
        require_distinct(self.first, self.second)
        for gear in (self.first, self.second):
            remedy = "name the body that carries the gears"
            require(self.carrier != gear, "carrier", gear, "another body than the gears", remedy)

    def body_names(self) -> tuple[str, ...]:
        """Return the names of the carrier, the first and the second gear."""
        return self.carrier, self.first, self.second

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return the row "mesh": the angular error of the first gear, rad.

        The error is the angle of the first gear less the angle that follows from the second gear,
        modulo a tooth of the first gear.
        """
        del t
        first = self._angle(motions, self.first, self.axis_first, self.orientation_first)
        second = self._angle(motions, self.second, self.axis_second, self.orientation_second)
        ratio = self.teeth_second / self.teeth_first
        mesh = sum_of_rows((first, scaled_row(second, -ratio if self.internal else ratio)))
        tooth = 2.0 * math.pi / self.teeth_first
        return {"mesh": replace(mesh, value=wrapped(mesh.value - self.offset, tooth))}

    def _angle(
        self, motions: Motions, gear: str, axis: Vector, orientation: EulerParameters
    ) -> Row:
        """Return a gear's angle relative to the carrier, rad within (-pi, pi], as a row.

        `axis` is in the carrier's axes; `orientation` transforms from the gear's axes to the
        carrier's at angle zero.
        """
        start, _ = transverse_axes(unit(axis))
        direction = rotation_matrix(orientation).transposed_times(start)
        pair = motions[self.carrier], motions[gear]
        return turning_angle((self.carrier, gear), *pair, unit(axis), direction)
