"""A bushing: an elastic liner between two bodies."""

from typing import NamedTuple

import equinox as eqx

from ...fields.checks import (
    checkable,
    require,
    require_euler_parameters,
    require_point,
    require_shape,
)
from ...fields.declarations import quantity
from ...fields.types import ArrayLike, Quadruple, Triple
from ...math.rotation_vectors import RotationVector, rotation_vector
from ...math.rotations import rotation_matrix
from ...math.vectors import Matrix, Scalar, Vector
from ..bodies import Wrench
from ..joints.base import AbstractForce, Motions
from ..joints.pairs import AbstractPairAtPoints
from ..pen import AbstractPen

PARALLEL = (1.0, 0.0, 0.0, 0.0)
NONE = (0.0, 0.0, 0.0)


def _require_none_negative(argument: str, value: ArrayLike) -> None:
    """Check a number for each axis, none of them negative."""
    require_shape(argument, value, (3,), "pass a number for each of the bushing's axes")
    if (known := checkable(value)) is not None:
        (numbers,) = known
        fine, remedy = (numbers >= 0.0).all(), "give stiffness and damping in SI units"
        require(fine, argument, numbers, "zero or positive", remedy)


class _Strain(NamedTuple):
    """The bushing's axes in global ones, and how it is strained along them: shift m, turn rad, and
    their rates."""

    axes: Matrix
    shift: Vector
    shift_rate: Vector
    turn: RotationVector
    turn_rate: Vector


class Bushing(AbstractPairAtPoints, AbstractForce):
    """Springs and dampers along and about three axes: the liner of an elastic joint.

    The bushing's axes belong to the first body. Along them, the point of the second body is off
    that of the first by a shift s, and the frame of the second body turned against the first's by
    the rotation vector r, an axis times an angle. Force and moment of the second body are those of
    the energy (k s^2 + c r^2)/2 and of the dissipated power d s'^2 + b r'^2, summed over the axes.
    Hence turns may be large: about one axis the moment is exactly c times the angle, turns about
    several axes need no order, and the forces are conservative. Half a revolution, where a rotation
    vector has no direction, is out of reach; a torsional spring without such an end acts about a
    joint's own angle.

    **Arguments:**

    - names; points (3,) m in body axes.
    - `stiffness` k, N/m, and `damping` d, N s/m, along each axis, (3,).
    - `rotational_stiffness` c, N m/rad, and `rotational_damping` b, N m s/rad, about each, (3,).
    - `orientation_first`, `orientation_second`: the bushing's frame in each body, Euler parameters
      that turn its components into the body's; those of the body's own axes unless given. The
      frames are parallel where the bushing is relaxed.

    **Raises:** `ValueError` for negative numbers, or orientations that are none.

    ```python
    import clearjoint as cj

    liner = cj.Bushing(
        "frame", "arm", (0.3, 0.0, 0.0), (-0.2, 0.0, 0.0),
        stiffness=(2e6, 2e6, 4e5),
        damping=(200.0, 200.0, 100.0),
        rotational_stiffness=(300.0, 300.0, 5.0),
    )
    ```
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    point_first: Triple = quantity("m", check=require_point)
    point_second: Triple = quantity("m", check=require_point)
    stiffness: Triple = quantity("N/m", check=_require_none_negative)
    damping: Triple = quantity("N s/m", check=_require_none_negative, default=NONE)
    rotational_stiffness: Triple = quantity("N m/rad", check=_require_none_negative, default=NONE)
    rotational_damping: Triple = quantity("N m s/rad", check=_require_none_negative, default=NONE)
    orientation_first: Quadruple = quantity("1", check=require_euler_parameters, default=PARALLEL)
    orientation_second: Quadruple = quantity("1", check=require_euler_parameters, default=PARALLEL)

    def _strain(self, motions: Motions) -> _Strain:
        first, second = motions[self.first], motions[self.second]
        axes = first.rotation @ rotation_matrix(self.orientation_first)
        frame = second.rotation @ rotation_matrix(self.orientation_second)
        apart = second.point(self.point_second) - first.point(self.point_first)
        beside = self.point_first + first.components(apart)
        moving = second.velocity_at(self.point_second) - first.velocity_at(beside)
        spin = second.direction(second.spin) - first.direction(first.spin)
        turn = rotation_vector(axes.T @ frame)
        return _Strain(
            axes,
            axes.transposed_times(apart),
            axes.transposed_times(moving),
            turn,
            turn.rate(axes.transposed_times(spin)),
        )

    def wrenches(self, motions: Motions, t: Scalar) -> dict[str, Wrench]:
        """Equal and opposite forces at the second body's point, and opposite torques."""
        del t
        first, second = motions[self.first], motions[self.second]
        strain = self._strain(motions)
        along = strain.shift.componentwise_product(
            self.stiffness
        ) + strain.shift_rate.componentwise_product(self.damping)
        about = strain.turn.vector.componentwise_product(
            self.rotational_stiffness
        ) + strain.turn_rate.componentwise_product(self.rotational_damping)
        force = strain.axes @ along
        torque = strain.axes @ strain.turn.torque(about)
        apart = second.point(self.point_second) - first.point(self.point_first)
        beside = self.point_first + first.components(apart)
        return {
            self.first: first.wrench(force, beside) + first.torque(torque),
            self.second: second.wrench(-force, self.point_second) + second.torque(-torque),
        }

    def stored_energy(self, motions: Motions, t: Scalar) -> Scalar:
        """That of the six springs, J."""
        del t
        strain = self._strain(motions)
        energy = _weighted(self.stiffness, strain.shift)
        return 0.5 * (energy + _weighted(self.rotational_stiffness, strain.turn.vector))

    def supplied_power(self, motions: Motions, t: Scalar) -> Scalar:
        """Minus the dissipation of the six dampers, W."""
        del t
        strain = self._strain(motions)
        power = _weighted(self.damping, strain.shift_rate)
        return -(power + _weighted(self.rotational_damping, strain.turn_rate))

    def draw(self, pen: AbstractPen) -> None:
        """A spring."""
        pen.spring(*self.ends())


def _weighted(weights: Vector, vector: Vector) -> Scalar:
    """The squared components of a vector, weighted and summed."""
    return vector.componentwise_product(weights).dot(vector)
