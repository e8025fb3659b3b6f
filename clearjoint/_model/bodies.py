"""Rigid bodies and homogeneous solids, their motion, and the state of a system."""

import math
from collections.abc import Mapping
from typing import Annotated

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree
from typing_extensions import override

from .._fields.checks import (
    as_number,
    caution_outside,
    caution_unless,
    checkable,
    concrete,
    require,
    require_axis,
    require_euler_parameters,
    require_finite,
    require_names,
    require_numbers,
    require_positive,
    require_shape,
    require_types,
)
from .._fields.objects import AbstractReadable, as_numbers, described, quantity
from .._fields.types import ArrayLike, Quadruple, QuadrupleLike, Single, Square, Triple, TripleLike
from .._math.vectors import IDENTITY, ZERO, Matrix, Scalar, Vector, add
from .densities import STEEL
from .tree_dataclass import tree_dataclass

AXES = ("x", "y", "z")
Number = PyTree
"""A number from the user, which JAX may trace, or ``None``."""


def _require_one(mass: Number, density: Number) -> None:
    options = {"mass": mass, "density": density}
    given = [name for name, value in options.items() if value is not None]
    remedy = "pass mass= in kg, or density= in kg/m^3, such as clearjoint.densities.STEEL"
    require(len(given) == 1, "mass", given or None, "given, or else a density", remedy)


def _mass(mass: Number, density: Number, volume: Number) -> Number:
    """Return the given mass, kg, or density, kg/m^3, times volume, m^3; a `ValueError` unless
    exactly one of mass and density is given."""
    _require_one(mass, density)
    if mass is not None:
        return _number("mass", mass, "kg")
    density = _number("density", density, "kg/m^3")
    remedy = "give it in kg/m^3; clearjoint.densities has some"
    # From foams to platinum.
    caution_outside("density", density, "kg/m^3", 10.0, 25e3, remedy)
    return density * volume


def _inner(inner_diameter: Number, diameter: Number) -> Number:
    """Return the checked inner diameter of a body, m: below its outer `diameter`, zero if solid."""
    inner = as_number(inner_diameter, "inner_diameter", "m")
    require_positive("inner_diameter", inner, "give it in m", zero=True)
    expected = "less than the diameter, {1} m"
    values = inner, diameter
    require_numbers(lambda d, outer: d < outer, "inner_diameter", values, expected, "give it in m")
    return inner


def _number(argument: str, value: Number, unit: str) -> Number:
    number = as_number(value, argument, unit)
    require_positive(argument, number, f"give it in {unit}")
    return number


GROUND = "ground"
"""Name of the fixed body, which is part of every scene but of no state.

>>> scene, _ = cj.mechanisms.double_pendulum()
>>> scene.joints["shoulder"].bearing_body == cj.GROUND
True
"""


def _require_inertia(argument: str, value: ArrayLike) -> None:
    """Raise a `ValueError` unless the value is an inertia, kg m^2, that a rigid body can have."""
    is_inertia, expected = np.shape(value) in ((3,), (3, 3)), "of shape (3,) or (3, 3)"
    remedy = "give three principal moments or the whole inertia matrix in kg m^2"
    require(is_inertia, argument, value, expected, remedy)
    require_finite(argument, value)
    if (numbers := checkable(value)) is None:
        return
    (inertia,) = numbers
    # The tests of the symmetry and of the largest moment allow for the rounding of given numbers:
    # the largest moment is at most (1 + 1e-6) times the sum of the other two, which is the sum of
    # all less itself. For a plate both are equal, but for rounding in single precision.
    total = inertia.sum() if inertia.ndim == 1 else inertia.trace()
    largest = total * (1 + 1e-6) / (2 + 1e-6)
    if inertia.ndim == 1:
        positive, is_rigid = inertia.min() > 0, inertia.max() <= largest
    else:
        # All principal moments are below `largest` if this number times the identity, less the
        # matrix, is positive definite.
        symmetric = abs(inertia - inertia.T).max() <= 1e-9 * abs(inertia).max()
        require(symmetric, argument, inertia, "symmetric", "average it with its transpose")
        positive = _is_positive_definite(inertia)
        is_rigid = _is_positive_definite(largest * np.eye(3) - inertia)
    remedy = "give every body a positive moment of inertia about each axis"
    require(positive, argument, inertia, "positive definite", remedy)
    expected = "such that no principal moment exceeds the sum of the other two"
    remedy = "check the order of the moments and their units (kg m^2)"
    require(is_rigid, argument, inertia, expected, remedy)


def _is_positive_definite(matrix: np.ndarray | jax.Array) -> bool | jax.Array:
    """Return whether a symmetric matrix, (3, 3), has positive pivots in Gaussian elimination.
    Eigenvalues are not used, since native code, which evaluates checks fast, can't compute them."""
    xp = matrix.__array_namespace__()
    (a, b, c), (_, d, e), (_, _, f) = matrix
    # Pivots that are not positive are replaced by one, so that nothing is divided by zero.
    first_pivot = xp.where(a > 0, a, 1.0)
    d, e, f = d - b * b / first_pivot, e - b * c / first_pivot, f - c * c / first_pivot
    second_pivot = xp.where(d > 0, d, 1.0)
    return (a > 0) & (d > 0) & (f - e * e / second_pivot > 0)


class Body(AbstractReadable):
    """A rigid body, whose frame has its origin at the centre of mass.

    `Body.rod`, `Body.cylinder`, `Body.box` and `Body.sphere` make homogeneous bodies from
    dimensions and either mass, kg, or density, kg/m^3. They raise a `ValueError` if a number is not
    positive, and warn (`UnusualValueWarning`) of a density outside 10 to 25e3 kg/m^3.

    **Arguments:**

    - `mass`: kg, positive.
    - `inertia`: kg m^2, about the centre of mass: three principal moments (the body frame is then
      the principal frame) or a symmetric positive definite (3, 3) matrix in the body frame.
    - `is_massless`: whether joint coordinates neglect the body's mass and inertia, for a rotor
      whose inertia is the `armature` of its hinge or slider, or for a light link between two
      joints. In absolute coordinates, they always count.

    **Raises:** `ValueError` if the mass or a principal moment is not positive, a principal moment
    exceeds the sum of the other two, the matrix is not symmetric, a shape is wrong, or a number is
    not finite. **Warns:** `UnusualValueWarning` if a homogeneous box of this mass and inertia has a
    density outside 0.01 to 1e6 kg/m^3.

    >>> cj.Body(mass=7.02, inertia=(0.001, 0.5855, 0.5855))
    Body(mass=7.02, inertia=[0.001, 0.5855, 0.5855])
    """

    mass: Single = quantity(
        "kg", positive=True, remedy='give the mass in kg, and use "ground" for a fixed body'
    )
    inertia: Triple | Square = quantity("kg m^2", check=_require_inertia)
    is_massless: bool = eqx.field(static=True, default=False, repr=False)

    @override
    def _caution_together(self) -> None:
        mass, inertia = concrete(self.mass), concrete(self.inertia)
        if mass is not None and inertia is not None and not self.is_massless:
            density = _box_density(float(mass), inertia)
            # Solid materials have about 10 to 2.2e4 kg/m^3. The range is wider, because inertias
            # without effect on a planar motion are often guessed, and because the box of an open
            # structure, such as a machine frame, is mostly empty.
            least, most = 1e-2, 1e6
            is_usual = least <= density <= most
            expected = f"a density between {least:g} and {most:g} kg/m^3"
            remedy = f"a box of this mass and inertia has {density:.3g} kg/m^3; give kg and kg m^2"
            caution_unless(is_usual, "mass", float(mass), "kg", expected, remedy)

    @staticmethod
    def rod(
        length: Annotated[float, "m"],
        *,
        mass: Annotated[float, "kg"] | None = None,
        density: Annotated[float, "kg/m^3"] | None = None,
        diameter: Annotated[float, "m"] | None = None,
        axis: str = "x",
    ) -> "Body":
        """Return a homogeneous round rod along one of the body's axes.

        **Arguments:**

        - `length`, `diameter`: m. The diameter may be omitted if the mass is given. The rod is then
          slender: its transverse moments are m l^2/12, and the moment about its axis is that of a
          round steel bar of the same mass and length.
        - `axis`: direction of the rod, "x", "y" or "z".

        **Raises:** `ValueError` also if a density is given without a diameter, or if the steel bar
        would be thicker than long.

        >>> bar = cj.Body.rod(length=0.4, diameter=0.02, density=cj.densities.STEEL)
        """
        if diameter is not None:
            return Body.cylinder(diameter, length, mass=mass, density=density, axis=axis)
        _require_one(mass, density)
        remedy = "pass diameter= in m, or mass= in kg instead of the density"
        require(density is None, "diameter", None, "given with a density", remedy)
        length, rod_mass = _number("length", length, "m"), _number("mass", mass, "kg")
        # A thin rod has no moment about its axis, but a body needs one. It is m d^2/8, with the
        # diameter d of a round steel bar, whose mass is rho pi/4 d^2 l.
        squared_diameter = 4.0 * rod_mass / (math.pi * STEEL * length)
        # The mass is among the values, since an error shows the first of them.
        fits, values = (lambda _, square, l: square <= l**2), (rod_mass, squared_diameter, length)
        remedy = "give its diameter in m, or check mass (kg) and length (m)"
        require_numbers(fits, "mass", values, "that of a rod longer than thick", remedy)
        about, across = rod_mass * squared_diameter / 8.0, rod_mass * length**2 / 12.0
        return _round_body(axis, rod_mass, about, across)

    @staticmethod
    def cylinder(
        diameter: Annotated[float, "m"],
        length: Annotated[float, "m"],
        *,
        mass: Annotated[float, "kg"] | None = None,
        density: Annotated[float, "kg/m^3"] | None = None,
        inner_diameter: Annotated[float, "m"] = 0.0,
        axis: str = "z",
    ) -> "Body":
        """Return a homogeneous cylinder about one of the body's axes: a shaft, disc, tube or ring.

        **Arguments:** `inner_diameter`: of the hole. `axis`: of symmetry, "x", "y" or "z".

        >>> tube = cj.Body.cylinder(0.04, 0.5, inner_diameter=0.036, mass=0.8, axis="x")
        """
        diameter, length = _number("diameter", diameter, "m"), _number("length", length, "m")
        inner = _inner(inner_diameter, diameter)
        mass = _mass(mass, density, 0.25 * math.pi * (diameter**2 - inner**2) * length)
        # The moments are m (D^2 + d^2)/8 about the axis and m (D^2 + d^2)/16 + m l^2/12 across it.
        squares = diameter**2 + inner**2
        across = mass * (squares / 16.0 + length**2 / 12.0)
        return _round_body(axis, mass, mass * squares / 8.0, across)

    @staticmethod
    def box(
        lengths: Annotated[Triple, "m"],
        *,
        mass: Annotated[float, "kg"] | None = None,
        density: Annotated[float, "kg/m^3"] | None = None,
    ) -> "Body":
        """Return a homogeneous box with the `lengths` of its sides, (3,) m, along the body's axes.

        >>> slider = cj.Body.box(lengths=(0.06, 0.04, 0.02), density=cj.densities.ALUMINIUM)
        """
        lengths = as_number(lengths, "lengths", "m")
        require_shape("lengths", lengths, (3,), "pass three lengths in m, along x, y and z")
        sides = [_number(f"lengths[{k}]", lengths[k], "m") for k in range(3)]
        mass = _mass(mass, density, sides[0] * sides[1] * sides[2])
        # The moment about x is m (b^2 + c^2)/12 for the lengths b and c along y and z.
        a, b, c = (side**2 for side in sides)
        return Body(mass, as_numbers([mass * pair / 12.0 for pair in (b + c, c + a, a + b)]))

    @staticmethod
    def sphere(
        diameter: Annotated[float, "m"],
        *,
        mass: Annotated[float, "kg"] | None = None,
        density: Annotated[float, "kg/m^3"] | None = None,
        inner_diameter: Annotated[float, "m"] = 0.0,
    ) -> "Body":
        """Return a homogeneous sphere, which has an `inner_diameter`, m, if it is hollow.

        >>> ball = cj.Body.sphere(diameter=0.01, density=cj.densities.STEEL)
        """
        diameter = _number("diameter", diameter, "m")
        inner = _inner(inner_diameter, diameter)
        cubes = diameter**3 - inner**3
        mass = _mass(mass, density, math.pi * cubes / 6.0)
        # The moment about every axis is m (D^5 - d^5)/(10 (D^3 - d^3)).
        return Body(mass, as_numbers([mass * (diameter**5 - inner**5) / (10.0 * cubes)] * 3))

    def gyration_radius(self) -> float:
        """Return the root mean square distance of the body's mass from its centre of mass, m."""
        inertia = np.asarray(self.inertia)
        # Each moment is an integral of two squared coordinates, so their sum counts each one twice.
        trace = inertia.sum() if inertia.ndim == 1 else np.trace(inertia)
        return float(np.sqrt(0.5 * trace / np.asarray(self.mass)))

    def angular_momentum(self, spin: Vector) -> Vector:
        """Return the angular momentum about the centre of mass, kg m^2/s in body axes, at a `spin`,
        rad/s in body axes. The body must be in scalar form (see `unpack`)."""
        if isinstance(self.inertia, Matrix):
            return self.inertia @ spin
        return spin.componentwise_product(self.inertia)


def _round_body(axis: str, mass: Number, about: Number, across: Number) -> Body:
    """Return a body with the moments of inertia, kg m^2, `about` its axis "x", "y" or "z", and
    `across` this axis."""
    require(axis in AXES, "axis", axis, f"one of {AXES}", "pass one of these")
    return Body(mass, as_numbers([about if axis == name else across for name in AXES]))


def _box_density(mass: float, inertia: np.ndarray) -> float:
    """Return the density, kg/m^3, of the homogeneous box with a body's mass, kg, and `inertia`,
    kg m^2: three principal moments or the matrix, (3, 3)."""
    moments = np.linalg.eigvalsh(inertia) if inertia.ndim == 2 else inertia
    # A box with the sides a, b, c has the moments I_a = m (b^2 + c^2)/12, and so on. Hence a^2 is
    # (6/m) (I_a + I_b + I_c - 2 I_a). Rounding may make it negative.
    sides = np.sqrt(np.maximum(6.0 * (moments.sum() - 2.0 * moments), 0.0) / mass)
    # The box of a rod or plate with idealised moments would have no thickness.
    return float(mass / np.maximum(sides, 1e-2 * sides.max()).prod())


class BodyState(AbstractReadable):
    """Position and velocity of one body; `body_state` makes it and explains the fields.

    >>> state = cj.body_state(position=(0.5, 0, 0), spin=(0, 0, 2))
    >>> state.orientation, state.spin
    (array([1., 0., 0., 0.]), array([0., 0., 2.]))
    """

    position: Triple = described("m", "position of the centre of mass, global")
    orientation: Quadruple = described("1", "Euler parameters, scalar first, body to global")
    velocity: Triple = described("m/s", "velocity of the centre of mass, global")
    spin: Triple = described("rad/s", "angular velocity in body axes")


class State(AbstractReadable):
    """State of all bodies of a scene, and of its contacts, at one time.

    To start a motion, `bodies` alone is enough.

    - `bodies`: `BodyState` of each body by name, without the ground.
    - `entry_speeds[joint][contact]`: entry speed of the current contact, m/s, zero without contact;
      only for laws that use it. When a run starts, a missing or zero entry speed of a closed
      contact is replaced: by the penetration rate if the depth is at most 1e-12 m, otherwise by 1e9
      m/s, which makes the damping negligible. States saved by `simulate_nonsmooth`, whose contacts
      are rigid, list zero for each contact.
    - `work`: energies since the start, J, by name: "normal damping", "friction", "film" and
      "stabilisation", positive if taken from the motion, and "supplied", positive if drives and
      loads supplied it; empty unless the run has ``Settings(ledger=True)``.
    - `bristles[joint][contact]`: bristle deflections, (3,) m in the axes of the joint's first body;
      zero without contact. Empty for scenes without bristle laws.
    - `memory[force]`: numbers that a sampled force, such as a `Servo`, remembers, by name. A run
      initialises those that are missing.

    **Raises:** `ValueError` if `bodies` is not a dictionary of `BodyState`s by non-empty names.

    >>> state = cj.State({"arm": cj.body_state(position=(0.5, 0, 0))})
    >>> state.bodies["arm"].position
    array([0.5, 0. , 0. ])
    """

    bodies: dict[str, BodyState]
    entry_speeds: dict[str, dict[str, Single]]
    work: dict[str, Single]
    bristles: dict[str, dict[str, Triple]]
    memory: dict[str, dict[str, Single]]

    def __init__(
        self,
        bodies: Mapping[str, BodyState],
        entry_speeds: dict[str, dict[str, Single]] | None = None,
        work: dict[str, Single] | None = None,
        bristles: dict[str, dict[str, Triple]] | None = None,
        memory: dict[str, dict[str, Single]] | None = None,
    ):
        remedy = "pass State({name: body_state(...)})"
        # The numbers are not checked here: `body_state` checks those that it gets, and a run checks
        # all numbers of its initial state.
        require_types("bodies", bodies, BodyState, "a BodyState", remedy)
        self.bodies = dict(bodies)
        self.entry_speeds = {} if entry_speeds is None else as_numbers(entry_speeds)
        self.work = {} if work is None else as_numbers(work)
        self.bristles = {} if bristles is None else as_numbers(bristles)
        self.memory = {} if memory is None else as_numbers(memory)
        for part in ("entry_speeds", "bristles", "memory"):
            remedy = f"pass {part}={{name: {{label: value}}}}"
            require_types(part, getattr(self, part), Mapping, "a dictionary", remedy)
        require_names("work", self.work, "pass work={name: value}")


@tree_dataclass
class Wrench:
    """Force at a body's centre of mass, N in global axes, and moment about it, N m in body axes.

    >>> motion = testing.moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> motion.wrench(extend.Vector(0.0, 10.0, 0.0), extend.Vector(0.5, 0.0, 0.0)).moment.z  # N m
    5.0
    """

    force: Vector
    moment: Vector

    def __add__(self, other: "Wrench") -> "Wrench":
        return Wrench(self.force + other.force, self.moment + other.moment)

    def __mul__(self, factor: Scalar) -> "Wrench":
        return Wrench(self.force * factor, self.moment * factor)


NO_WRENCH = Wrench(ZERO, ZERO)
"""The zero wrench.

>>> extend.NO_WRENCH.force
Vector(x=0.0, y=0.0, z=0.0)
"""


@tree_dataclass
class Anchor:
    """A point of a moving body near a fixed point of the ground, to reduce rounding errors.

    - `local`: the body's point, m from the centre of mass in body axes; `velocity`: of this point,
      m/s in global axes.
    - `origin`: the fixed point, m in global axes.
    - `offset`: from the fixed point to the body's point, m in global axes. As a difference of
      coordinates of about a metre it would have too few digits for penetrations of nanometres.
    """

    local: Vector
    origin: Vector
    offset: Vector
    velocity: Vector


@tree_dataclass
class Motion:
    """Position, orientation, velocity and spin of a body, from which elements compute their forces.

    In its methods, points of the body are in m from the centre of mass, in body axes.

    - `position`, `velocity`: of the centre of mass, m and m/s in global axes.
    - `rotation`: matrix that transforms components in body axes to global axes.
    - `spin`: angular velocity, rad/s in body axes.
    - `anchor`: optional point of the body, near which `point_from` and `velocity_at` round less.

    >>> motion = testing.moving((0, 0, 1), (1, 0, 0, 0), (2, 0, 0), (0, 0, 3))
    >>> motion.velocity_at(extend.Vector(0.5, 0.0, 0.0))  # v + w x r
    Vector(x=2, y=1.5, z=0.0)
    """

    position: Vector
    rotation: Matrix
    velocity: Vector
    spin: Vector
    anchor: Anchor | None = None

    def point(self, local: Vector) -> Vector:
        """Return the position of a point of the body, m in global axes."""
        return self.position + self.rotation @ local

    def point_from(self, origin: Vector, local: Vector) -> Vector:
        """Return the vector from a fixed point to a point of the body, m in global axes, with
        smaller rounding errors near the `anchor` than a difference of positions."""
        if self.anchor is None:
            return self.point(local) - origin
        # The small vectors are added first, so that large coordinates don't round them.
        near = self.anchor.offset + self.rotation @ (local - self.anchor.local)
        return (self.anchor.origin - origin) + near

    def direction(self, local: Vector) -> Vector:
        """Return the components in global axes of a vector `local` in body axes."""
        return self.rotation @ local

    def components(self, vector: Vector) -> Vector:
        """Return the components in body axes of a vector in global axes."""
        return self.rotation.transposed_times(vector)

    def velocity_at(self, local: Vector) -> Vector:
        """Return the velocity of a point of the body, m/s in global axes."""
        if self.anchor is None:
            return self.velocity + self.rotation @ self.spin.cross(local)
        arm = local - self.anchor.local
        return self.anchor.velocity + self.rotation @ self.spin.cross(arm)

    def wrench(self, force: Vector, local: Vector) -> Wrench:
        """Return the wrench of a force, N in global axes, that acts at a point of the body."""
        return Wrench(force, local.cross(self.components(force)))

    def torque(self, torque: Vector) -> Wrench:
        """Return the wrench of a pure torque, N m in global axes."""
        return Wrench(ZERO, self.rotation.transposed_times(torque))

    def power(self, wrench: Wrench) -> Scalar:
        """Return the power of a wrench that acts on the body, W."""
        return add(wrench.force.dot(self.velocity), wrench.moment.dot(self.spin))


GROUND_MOTION = Motion(ZERO, IDENTITY, ZERO, ZERO)


def body_state(
    position: TripleLike,
    orientation: QuadrupleLike = (1.0, 0.0, 0.0, 0.0),
    velocity: TripleLike = (0.0, 0.0, 0.0),
    spin: TripleLike = (0.0, 0.0, 0.0),
) -> BodyState:
    """Return the position and velocity of one body, with checked values.

    **Arguments:**

    - `position`: of the centre of mass, (3,) m in global axes.
    - `orientation`: (4,) Euler parameters, scalar first, that transform components in body axes to
      global axes, for example from `rotation`; parallel axes by default.
    - `velocity`: of the centre of mass, (3,) m/s in global axes; zero by default.
    - `spin`: (3,) rad/s, angular velocity in body axes; zero by default.

    **Raises:** `ValueError` if a shape is wrong, a number is not finite, or the Euler parameters
    don't have unit norm.

    >>> cj.body_state(position=(0.5, 0, 0), velocity=(0, 1, 0)).velocity
    array([0., 1., 0.])
    """
    numbers = BodyState(
        position=as_number(position, "position"),
        orientation=as_number(orientation, "orientation"),
        velocity=as_number(velocity, "velocity"),
        spin=as_number(spin, "spin"),
    )
    for name in ("position", "velocity", "spin"):
        require_shape(name, getattr(numbers, name), (3,), "pass three numbers")
    require_euler_parameters("orientation", numbers.orientation)
    return numbers


def rotation(axis: TripleLike, angle: Scalar) -> Quadruple:
    """Return the Euler parameters, (4,), scalar first, of a rotation about an axis.

    They transform components in the rotated frame to the original frame, as an `orientation` of
    `body_state`, joints and drives does. In scene files, write ``orientation = {axis = [0, 0, 1],
    angle = "30 deg"}`` instead.

    **Arguments:** `axis`: (3,), any length; its components are the same in both frames. `angle`:
    rad, right-handed.

    **Raises:** `ValueError` if the axis has zero length, a number is not finite, or a shape is
    wrong. **Warns:** `UnusualValueWarning` if the angle exceeds two revolutions.

    >>> tilted = cj.rotation(axis=(0, 0, 1), angle=np.radians(30.0))
    >>> state = cj.State({"arm": cj.body_state((0.5, 0.0, 0.0), orientation=tilted)})
    """
    vector, radians = as_number(axis, "axis"), as_number(angle, "angle", "rad")
    require_axis("axis", vector)
    require_shape("angle", radians, (), "pass one number in rad")
    # Two revolutions; a larger angle may be in degrees.
    caution_outside("angle", radians, "rad", -4.0 * math.pi, 4.0 * math.pi, "give it in rad")
    # Known numbers stay in NumPy, so that nothing is compiled when a scene is built.
    numpy = jnp if isinstance(vector, jax.Array) or isinstance(radians, jax.Array) else np
    direction = vector / numpy.sqrt(vector @ vector)
    sine, cosine = numpy.sin(0.5 * radians), numpy.cos(0.5 * radians)
    return numpy.stack([cosine, *(sine * direction[k] for k in range(3))])
