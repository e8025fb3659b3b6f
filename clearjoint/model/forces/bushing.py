"""A bushing: an elastic connection of two bodies along and about three axes."""

from typing import NamedTuple

from ...fields.checks import (
    checkable,
    require,
    require_euler_parameters,
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
    require_shape(argument, value, (3,), "pass a number for each of the bushing's axes")
    if (known := checkable(value)) is not None:
        (numbers,) = known
        is_valid, remedy = (numbers >= 0.0).all(), "give stiffness and damping in SI units"
        require(is_valid, argument, numbers, "zero or positive", remedy)


class _Strain(NamedTuple):
    """Deformation of the bushing, with components along its axes.

    - `axes`: matrix that transforms components along the bushing's axes to global components.
    - `shift`, `shift_rate`: displacement of the second body's point from the first body's, m, and
      its rate, m/s.
    - `rotation`, `rotation_rate`: rotation vector of the second body's frame relative to the
      first's, rad, and its rate, rad/s.
    """

    axes: Matrix
    shift: Vector
    shift_rate: Vector
    rotation: RotationVector
    rotation_rate: Vector


class Bushing(AbstractPairAtPoints, AbstractForce):
    """Springs and dampers along and about three axes, such as a rubber liner.

    The bushing's axes are fixed to the first body. Let s be the displacement of the second body's
    point from the first body's, and r the rotation vector (axis times angle) of the second body's
    frame relative to the first's. Force and moment derive from the energy (k s^2 + c r^2)/2 and the
    dissipation d s'^2 + b r'^2, summed over the axes. Rotations may therefore be large: about one
    axis the moment is exactly c times the angle, the order of rotations about several axes doesn't
    matter, and the elastic forces are conservative. The rotation must stay below half a revolution,
    where a rotation vector is singular.

    **Arguments:**

    - `first`, `second`: names of the bodies.
    - `point_first`, `point_second`: (3,) m in body axes.
    - `stiffness`, `damping`: k, N/m, and d, N s/m, along each axis, (3,).
    - `rotational_stiffness`, `rotational_damping`: c, N m/rad, and b, N m s/rad, about each axis,
      (3,).
    - `orientation_first`, `orientation_second`: (4,) Euler parameters that transform components in
      the bushing's frame to each body's frame; the body's frame by default. The two frames are
      parallel in the relaxed bushing.

    **Raises:** `ValueError` if a number is negative or an orientation is invalid.

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

    stiffness: Triple = quantity("N/m", check=_require_none_negative)
    damping: Triple = quantity("N s/m", check=_require_none_negative, default=NONE)
    rotational_stiffness: Triple = quantity("N m/rad", check=_require_none_negative, default=NONE)
    rotational_damping: Triple = quantity("N m s/rad", check=_require_none_negative, default=NONE)
    orientation_first: Quadruple = quantity("1", check=require_euler_parameters, default=PARALLEL)
    orientation_second: Quadruple = quantity("1", check=require_euler_parameters, default=PARALLEL)

    def _strain(self, motions: Motions) -> _Strain:
        """Return the deformation of the bushing in a motion of its bodies."""
        first, second = motions[self.first], motions[self.second]
        axes = first.rotation @ rotation_matrix(self.orientation_first)
        frame = second.rotation @ rotation_matrix(self.orientation_second)
        apart = second.point(self.point_second) - first.point(self.point_first)
        # The relative velocity is measured from the first body's material point at the place of the
        # second body's point, so that a common rotation does not count as deformation.
        point_in_first = self.point_first + first.components(apart)
        velocity = second.velocity_at(self.point_second) - first.velocity_at(point_in_first)
        spin = second.direction(second.spin) - first.direction(first.spin)
        rotation = rotation_vector(axes.T @ frame)
        return _Strain(
            axes,
            axes.transposed_times(apart),
            axes.transposed_times(velocity),
            rotation,
            rotation.rate(axes.transposed_times(spin)),
        )

    def wrenches(self, motions: Motions, t: Scalar) -> dict[str, Wrench]:
        """Return the wrench of all springs and dampers on each body, by body name.

        On the first body the forces and torques act in the direction of the deformation, on the
        second body they are equal and opposite.
        """
        del t
        first, second = motions[self.first], motions[self.second]
        strain = self._strain(motions)
        # Along the axes of the bushing: forces, N, from the shift, and a moment, N m, from the
        # rotation vector.
        forces_along = strain.shift.componentwise_product(
            self.stiffness
        ) + strain.shift_rate.componentwise_product(self.damping)
        conjugate_moment = strain.rotation.vector.componentwise_product(
            self.rotational_stiffness
        ) + strain.rotation_rate.componentwise_product(self.rotational_damping)
        force = strain.axes @ forces_along
        # The moment's power is its product with the rate of the rotation vector, which differs from
        # the relative angular velocity for large rotations. The torque has the same power with the
        # angular velocity; without this conversion the elastic torque would not be conservative.
        torque = strain.axes @ strain.rotation.torque(conjugate_moment)
        # Both forces act at the second body's point. Opposite forces at two points that are apart
        # may form a couple, which would not conserve angular momentum.
        apart = second.point(self.point_second) - first.point(self.point_first)
        point_in_first = self.point_first + first.components(apart)
        return {
            self.first: first.wrench(force, point_in_first) + first.torque(torque),
            self.second: second.wrench(-force, self.point_second) + second.torque(-torque),
        }

    def stored_energy(self, motions: Motions, t: Scalar) -> Scalar:
        """Return the energy of the springs along and about the three axes, J."""
        del t
        strain = self._strain(motions)
        energy = _weighted(self.stiffness, strain.shift)
        return 0.5 * (energy + _weighted(self.rotational_stiffness, strain.rotation.vector))

    def supplied_power(self, motions: Motions, t: Scalar) -> Scalar:
        """Return the power of the dampers along and about the three axes, W; never positive."""
        del t
        strain = self._strain(motions)
        power = _weighted(self.damping, strain.shift_rate)
        return -(power + _weighted(self.rotational_damping, strain.rotation_rate))

    def draw(self, pen: AbstractPen) -> None:
        """Draw a spring."""
        pen.spring(*self.ends())


def _weighted(weights: Vector, vector: Vector) -> Scalar:
    """Return the sum of the squared components of a vector, each times its weight."""
    return vector.componentwise_product(weights).dot(vector)
