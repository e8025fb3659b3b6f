"""Springs, dampers, bushings and applied loads: force elements without contact."""

from typing import NamedTuple

import equinox as eqx
from jaxtyping import PyTree
from typing_extensions import override

from .._fields.checks import require_euler_parameters, require_numbers, require_point, require_shape
from .._fields.objects import quantity
from .._fields.types import ArrayLike, Quadruple, Single, Triple
from .._math.rotations import RotationVector, rotation_matrix, rotation_vector
from .._math.smoothing import TURN, norm_and_direction, where, wrapped
from .._math.vectors import Matrix, Scalar, Vector, pack, unpack
from .bodies import Wrench
from .drives.drivers import SI, AbstractDriveAboutAxis, AbstractDriveTorque
from .drives.functions_of_time import TripleInTime, breakpoints_of, triple_in_time, vector_at
from .joints.base import PARALLEL, AbstractForce, AbstractPairAtPoints, Motions
from .pen import AbstractPen, Marker

NONE = (0.0, 0.0, 0.0)


class SpringDamper(AbstractPairAtPoints, AbstractForce):
    """A linear spring and damper between a point of one body and a point of another.

    The force acts along the line between the points; where they coincide, it is zero.

    **Arguments:**

    - `point_first`, `point_second`: (3,) m from each body's centre of mass in its axes.
    - `stiffness`: N/m, not negative.
    - `damping`: N s/m, not negative; zero by default.
    - `free_length`: length without spring force, m, not negative; zero by default.

    >>> spring = cj.SpringDamper("ground", "ball", (0, 0, 0), (0, 0, 0), stiffness=100.0)
    >>> ball = testing.moving((0.1, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> wrenches = extend.unpack(spring).wrenches({"ground": still, "ball": ball}, 0.0)
    >>> print(f"{wrenches['ball'].force.x:.1f} N")
    -10.0 N
    """

    stiffness: Single = quantity("N/m", positive=True, zero=True, remedy=SI)
    damping: Single = quantity("N s/m", default=0.0, positive=True, zero=True, remedy=SI)
    free_length: Single = quantity("m", default=0.0, positive=True, zero=True, remedy=SI)

    def _stretch(self, motions: Motions) -> tuple[Scalar, Scalar, Vector]:
        """Return the length beyond the free length, m, its rate, m/s, and the global unit vector
        from the first to the second point, which is zero where the points coincide."""
        first, second = motions[self.first], motions[self.second]
        apart = second.point(self.point_second) - first.point(self.point_first)
        length, direction = norm_and_direction(apart)
        velocity = second.velocity_at(self.point_second) - first.velocity_at(self.point_first)
        return length - self.free_length, velocity.dot(direction), direction

    @override
    def wrenches(self, motions: Motions, t: Scalar) -> dict[str, Wrench]:
        stretch, rate, direction = self._stretch(motions)
        force = direction * (self.stiffness * stretch + self.damping * rate)
        return {
            self.first: motions[self.first].wrench(force, self.point_first),
            self.second: motions[self.second].wrench(-force, self.point_second),
        }

    @override
    def stored_energy(self, motions: Motions, t: Scalar) -> Scalar:
        return 0.5 * self.stiffness * self._stretch(motions)[0] ** 2

    @override
    def supplied_power(self, motions: Motions, t: Scalar) -> Scalar:
        return -self.damping * self._stretch(motions)[1] ** 2

    @override
    def deviations(self, motions: Motions, t: Scalar) -> tuple[Scalar, ...]:
        # With a free length, the force is reversed at once where the points pass each other. The
        # direction is then reversed too, and one of its components changes by more than one, since
        # the change of the unit vector has the length two. Half a turn makes this more than pi.
        jumps = self.stiffness * self.free_length > 0.0
        return tuple(where(jumps, 0.5 * TURN * part, 0.0) for part in self._stretch(motions)[2])

    @override
    def draw(self, pen: AbstractPen) -> None:
        pen.spring(*self.ends())


class TorsionalSpring(AbstractDriveAboutAxis, AbstractDriveTorque):
    """A linear torsional spring and damper about a common axis of two bodies.

    The twist is the angle between the bodies less the rest angle, within half a revolution since
    positions don't tell revolutions apart. The torque jumps where the twist is half a revolution.

    **Arguments:**

    - `stiffness`: N m/rad. `damping`: N m s/rad, zero by default. Neither is negative.
    - `rest_angle`: angle of the unloaded spring, rad; zero by default.
    - `axis`: (3,) in the first body's axes, any length.
    - `orientation`: (4,) Euler parameters, scalar first, that transform components in the second
      body's axes to the first body's axes at angle zero; parallel axes by default.

    >>> spring = cj.TorsionalSpring("ground", "lever", (0, 0, 1), stiffness=5.0, damping=0.1)
    >>> spring.body_names()
    ('ground', 'lever')
    """

    stiffness: Single = quantity("N m/rad", shape=(), positive=True, zero=True, remedy=SI)
    damping: Single = quantity(
        "N m s/rad", shape=(), default=0.0, positive=True, zero=True, remedy=SI
    )
    rest_angle: Single = quantity("rad", shape=(), default=0.0)
    orientation: Quadruple = quantity("1", default=PARALLEL)

    @override
    def torque_at(self, angle: Scalar, speed: Scalar, t: Scalar) -> Scalar:
        return -(self.stiffness * self._twist(angle) + self.damping * speed)

    @override
    def stored_energy(self, motions: Motions, t: Scalar) -> Scalar:
        return 0.5 * self.stiffness * self._twist(self.relative_angle(motions).value) ** 2

    @override
    def supplied_power(self, motions: Motions, t: Scalar) -> Scalar:
        return -self.damping * self.speed(motions) ** 2

    def _twist(self, angle: Scalar) -> Scalar:
        return wrapped(angle - self.rest_angle, TURN)

    @override
    def deviations(self, motions: Motions, t: Scalar) -> tuple[Scalar, ...]:
        twist = self._twist(self.relative_angle(motions).value)
        return (where(self.stiffness > 0.0, twist, 0.0),)


class AppliedLoad(AbstractForce):
    """A force and a torque on a body in global axes, constant or functions of time.

    For a load that depends on the motion, subclass `AbstractForce`.

    **Arguments:**

    - `body`: name of the body.
    - `force`: (3,) N. `torque`: (3,) N m. Both are zero by default. Each component is a number, a
      function of time such as `PiecewiseConstant`, or a Python function of the time in s, which
      can't declare the times of its jumps and kinks. One function that returns three numbers will
      do too, such as a `PiecewiseConstant` with values (N, 3).
    - `point`: where the force acts, (3,) m in body axes; the centre of mass by default.

    >>> weight = cj.AppliedLoad("rod", force=(0.0, -20.0, 0.0), point=(0.1, 0.0, 0.0))
    >>> kick = cj.PiecewiseConstant([0.0, 0.1, 0.12], [0.0, 500.0, 0.0])
    >>> kicked = cj.AppliedLoad("rod", force=(kick, 0.0, 0.0))
    >>> shaken = cj.AppliedLoad("rod", force=(lambda t: 40.0 * jnp.cos(300.0 * t), 0.0, 0.0))
    """

    body: str = eqx.field(static=True)
    force: TripleInTime = triple_in_time("N", default=NONE)
    torque: TripleInTime = triple_in_time("N m", default=NONE)
    point: Triple = quantity("m", check=require_point, default=NONE)
    point_fields = {"point": "body"}

    @override
    def body_names(self) -> tuple[str, ...]:
        return (self.body,)

    @override
    def wrenches(self, motions: Motions, t: Scalar) -> dict[str, Wrench]:
        motion = motions[self.body]
        force, torque = vector_at(self.force, t), vector_at(self.torque, t)
        return {self.body: motion.wrench(force, self.point) + motion.torque(torque)}

    @override
    def breakpoints(self) -> PyTree:
        return breakpoints_of(self.force, self.torque)

    @override
    def draw(self, pen: AbstractPen) -> None:
        force = unpack(self.force)  # in scalar form, as `vector_at` needs it; the pen needs arrays
        constant = isinstance(force, Vector)
        marker = Marker(self.body, self.point)
        pen.load(marker, pack(force) if constant else lambda t: pack(vector_at(force, t)))


def _require_none_negative(argument: str, value: ArrayLike) -> None:
    require_shape(argument, value, (3,), "pass a number for each of the bushing's axes")
    expected, remedy = "zero or positive", "give stiffness and damping in SI units"
    require_numbers(lambda k: (k >= 0.0).all(), argument, (value,), expected, remedy)


class _Strain(NamedTuple):
    """Deformation of a bushing and its rate, with components along the bushing's axes.

    - `point_in_first`: point of the first body that coincides with the second body's point, m from
      the first body's centre of mass in its axes.
    - `axes`: matrix that transforms components along the bushing's axes to global components.
    - `shift`: displacement of the second body's point from the first body's, m.
    - `rotation`: rotation vector from the bushing's axes to those of `orientation_second`, rad.
    """

    point_in_first: Vector
    axes: Matrix
    shift: Vector
    shift_rate: Vector
    rotation: RotationVector
    rotation_rate: Vector


class Bushing(AbstractPairAtPoints, AbstractForce):
    """Springs and dampers along and about three axes, such as a rubber liner.

    The bushing's axes are fixed to the first body. Let s be the displacement of the second body's
    point from the first body's, and r the rotation vector (axis times angle) from the bushing's
    axes to those that `orientation_second` defines on the second body. With the stiffnesses k and c
    and the dampings d and b below, force and moment derive from the energy (k s^2 + c r^2)/2 and
    the dissipated power d s'^2 + b r'^2, each summed over the axes. Rotations may therefore be
    large: the elastic forces are conservative, and about one axis the moment is exactly c times the
    angle. Half a revolution, where r is singular, must not be reached.

    **Arguments:**

    - `point_first`, `point_second`: (3,) m from each body's centre of mass in its axes.
    - `stiffness`, `damping`: k, N/m, and d, N s/m, along each axis, (3,), not negative.
    - `rotational_stiffness`, `rotational_damping`: c, N m/rad, and b, N m s/rad, about each axis,
      (3,), not negative. All but `stiffness` are zero by default.
    - `orientation_first`, `orientation_second`: (4,) Euler parameters, scalar first, that transform
      components along axes on each body to the body's frame; by default the body's axes. Those on
      the first body are the bushing's. In a relaxed bushing, both are parallel and points coincide.

    >>> ends = (0.3, 0.0, 0.0), (-0.2, 0.0, 0.0)
    >>> liner = cj.Bushing("frame", "arm", *ends, stiffness=(2e6, 2e6, 4e5))
    """

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
        # The relative velocity is that of two material points at the same place, so that a common
        # rotation of both bodies does not count as deformation.
        point_in_first = self.point_first + first.components(apart)
        velocity = second.velocity_at(self.point_second) - first.velocity_at(point_in_first)
        spin = second.direction(second.spin) - first.direction(first.spin)
        rotation = rotation_vector(axes.T @ frame)
        shift, shift_rate = axes.transposed_times(apart), axes.transposed_times(velocity)
        rotation_rate = rotation.rate(axes.transposed_times(spin))
        return _Strain(point_in_first, axes, shift, shift_rate, rotation, rotation_rate)

    @override
    def wrenches(self, motions: Motions, t: Scalar) -> dict[str, Wrench]:
        first, second = motions[self.first], motions[self.second]
        strain = self._strain(motions)
        # Along the axes of the bushing: forces, N, from the shift, and a moment, N m, from the
        # rotation vector.
        times = Vector.componentwise_product
        forces_along = times(strain.shift, self.stiffness) + times(strain.shift_rate, self.damping)
        conjugate_moment = times(strain.rotation.vector, self.rotational_stiffness)
        conjugate_moment += times(strain.rotation_rate, self.rotational_damping)
        force = strain.axes @ forces_along
        # The moment's power is its product with the rate of the rotation vector, which differs from
        # the relative angular velocity for large rotations. The torque has the same power with the
        # angular velocity; without this conversion the elastic torque would not be conservative.
        torque = strain.axes @ strain.rotation.torque(conjugate_moment)
        # Both forces act at the second body's point. Opposite forces at two points that are apart
        # may form a couple, which would not conserve angular momentum.
        return {
            self.first: first.wrench(force, strain.point_in_first) + first.torque(torque),
            self.second: second.wrench(-force, self.point_second) + second.torque(-torque),
        }

    @override
    def stored_energy(self, motions: Motions, t: Scalar) -> Scalar:
        strain = self._strain(motions)
        energy = _weighted(self.stiffness, strain.shift)
        return 0.5 * (energy + _weighted(self.rotational_stiffness, strain.rotation.vector))

    @override
    def supplied_power(self, motions: Motions, t: Scalar) -> Scalar:
        strain = self._strain(motions)
        power = _weighted(self.damping, strain.shift_rate)
        return -(power + _weighted(self.rotational_damping, strain.rotation_rate))

    @override
    def deviations(self, motions: Motions, t: Scalar) -> tuple[Scalar, ...]:
        stiffness, rotation = self.rotational_stiffness, self._strain(motions).rotation.vector
        return tuple(where(k > 0.0, r, 0.0) for k, r in zip(stiffness, rotation, strict=True))

    @override
    def draw(self, pen: AbstractPen) -> None:
        pen.spring(*self.ends())


def _weighted(weights: Vector, vector: Vector) -> Scalar:
    return vector.componentwise_product(weights).dot(vector)
