"""Interfaces of the elements of a scene: constraints, forces and contact joints.

An element acts on bodies: it is a joint, a force or a driver, which prescribes a motion. In the
methods that compute forces and constraints, vectors are `Vector`s of three scalars, not arrays, and
so are the element's fields with three numbers.
"""

import abc
from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType
from typing import ClassVar, TypeAlias, TypeVar

import equinox as eqx
import numpy as np
from jaxtyping import PyTree
from typing_extensions import override

from ..._fields.checks import require, require_point
from ..._fields.objects import AbstractConverting, quantity
from ..._fields.types import Triple
from ..._math.vectors import Scalar, Vector
from ..bodies import Motion, Wrench
from ..contact.friction import AbstractBristleFriction
from ..contact.laws import AbstractContactLaw, Gap, Limit
from ..pen import AbstractPen, Marker
from ..tree_dataclass import tree_dataclass
from .motion_subspaces import AbstractMotionSubspace

T = TypeVar("T")
PARALLEL = (1.0, 0.0, 0.0, 0.0)
"""Euler parameters of parallel frames."""

Motions: TypeAlias = Mapping[str, Motion]
"""Motion of each body by name, including the ground.

>>> def height(motions: extend.Motions) -> extend.Scalar:
...     return motions["arm"].position.z
"""
ByLabel: TypeAlias = dict[str, dict[str, T]]
"""Values of contacts or constraint rows, ``values[joint][label]``."""
Attachment: TypeAlias = tuple[str, str, Triple]
"""A point that an element has on a body: name of the field that holds it, name of the body, and the
point, (3,) m from the centre of mass in body axes."""


@tree_dataclass
class Row:
    """One scalar constraint equation Phi = 0, evaluated for given positions and velocities.

    - `value`: Phi, in m, rad, or without unit.
    - `jacobian`: derivatives of the rate of Phi by the velocities, as a `Wrench` for each body by
      name: `force` by the velocity of the centre of mass in global axes, `moment` by the spin in
      body axes. The rate of Phi is sum(force . velocity + moment . spin) + `time_rate`. The
      reaction on a body is this wrench times the row's Lagrange multiplier.
    - `bias`: second time derivative of Phi if all linear and angular accelerations are zero.
    - `time_rate`: rate of Phi with all bodies at rest. It is zero unless Phi depends explicitly on
      time, as for a driver. The driver supplies the power -(multiplier * `time_rate`), W.

    >>> pull = extend.Wrench(extend.UNIT_X, extend.ZERO)
    >>> row = extend.Row(value=1e-3, jacobian={"ball": pull}, bias=0.0)  # x of the ball
    >>> row.time_rate
    0.0
    """

    value: Scalar
    jacobian: dict[str, Wrench]
    bias: Scalar
    time_rate: Scalar = 0.0


class AbstractElement(AbstractConverting):
    """Base class of joints, forces and drivers, which act on the bodies of a scene.

    `point_fields` maps the name of each field with a point to the name of the field that holds the
    name of the point's body.
    """

    point_fields: ClassVar[Mapping[str, str]] = MappingProxyType({})

    @abc.abstractmethod
    def body_names(self) -> tuple[str, ...]:
        """Return the names of the bodies on which the element acts; the ground is "ground"."""

    def breakpoints(self) -> PyTree:
        """Return the times in s at which the element is not smooth in time; none by default.

        They are the times of jumps and kinks of the force, or of kinks of the angle or distance
        that a driver prescribes: a number, an array, or a tuple of both, in any order. Compute them
        from the element's fields to get derivatives by them. Steps end at breakpoints: an
        undeclared jump of a force costs many short steps, and at an undeclared kink of a driver a
        run ends with `RESULTS.not_followed`. `sensitivities` raises an error for a class without
        this method that compares, rounds or clips a number that depends on time; a class that is
        smooth all the same defines the method to return ().
        """
        return ()

    def attachments(self) -> tuple[Attachment, ...]:
        """Return the points on bodies; by default those in the class attribute `point_fields`."""
        fields = self.point_fields.items()
        return tuple((point, getattr(self, body), getattr(self, point)) for point, body in fields)

    def draw(self, pen: AbstractPen) -> None:
        """Draw the element with a pen; by default a marker at each point of `attachments`. Where
        `load` or `view` guesses a state, it places each body such that the two markers of a symbol
        that connects it, such as a pin, coincide."""
        for _, body, point in self.attachments():
            pen.mark(Marker(body, point))


class AbstractConstraint(AbstractElement):
    """Base class of ideal joints and drivers: constraint equations Phi = 0.

    Lagrange multipliers, the forces and moments of the joint, enforce the equations. This example
    is a massless rod between two centres of mass, whose equation (d^2 - l^2)/2 = 0
    `rows_from_residual` differentiates:

    ```python
    import clearjoint as cj

    class Rod(cj.extend.AbstractConstraint):
        first: str
        second: str
        length: float  # m

        def body_names(self):
            return self.first, self.second

        def rows(self, motions, t):
            def residual(first, second):
                (position_first, _), (position_second, _) = first, second
                apart = position_second - position_first
                return (0.5 * (apart.dot(apart) - self.length**2),)

            names = self.body_names()
            pair = [motions[name] for name in names]
            return cj.extend.rows_from_residual(names, ("length",), residual, *pair)

    bodies = {"ball": cj.Body(1.0, (1e-3, 1e-3, 1e-3))}
    scene = cj.Scene(bodies, {"rod": Rod("ground", "ball", length=0.5)})
    ```
    """

    @abc.abstractmethod
    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return the linearly independent constraint rows by label, at time `t` in s."""

    def motion_subspace(self, parent: str) -> AbstractMotionSubspace | None:
        """Return the motion that the joint allows relative to the body `parent`, which replaces the
        constraint rows in joint coordinates; ``None``, the default, to keep the rows there."""
        return None


class AbstractForce(AbstractElement):
    """A force element without contact, such as a spring, a load or a drive torque.

    ```python
    import clearjoint as cj

    class Drag(cj.extend.AbstractForce):
        body: str
        factor: float  # N s^2/m^2
        point: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m, body axes

        def body_names(self):
            return (self.body,)

        def wrenches(self, motions, t):
            motion = motions[self.body]
            velocity = motion.velocity_at(self.point)
            speed, _ = cj.extend.norm_and_direction(velocity)
            return {self.body: motion.wrench(velocity * (-self.factor * speed), self.point)}

    air = Drag("ball", factor=0.02)
    ```
    """

    @abc.abstractmethod
    def wrenches(self, motions: Motions, t: Scalar) -> dict[str, Wrench]:
        """Return the wrench on each body by name, at time `t` in s; the ground's is ignored."""

    def stored_energy(self, motions: Motions, t: Scalar) -> Scalar:
        """Return the element's potential energy in J, at time `t` in s; 0 by default."""
        return 0.0

    def supplied_power(self, motions: Motions, t: Scalar) -> Scalar:
        """Return the power in W by which the element changes the total energy, at time `t` in s:
        the power of the wrenches plus the rate of `stored_energy`, zero for a spring and negative
        for a damper. The default is the power of the wrenches alone."""
        power: Scalar = 0.0
        for name, wrench in self.wrenches(motions, t).items():
            power = power + motions[name].power(wrench)
        return power

    def deviations(self, motions: Motions, t: Scalar) -> tuple[Scalar, ...]:
        """Return numbers by which a run detects a jump of the wrenches, at time `t` in s; none by
        default. One of them must change by more than pi in a step with a jump, as an angle does
        that jumps from pi to -pi. Runs with derivatives, which lack the effect of the jump, end
        there with `RESULTS.force_jumped`."""
        return ()


@tree_dataclass
class SideForce:
    """Force of a contact beside its normal force. A contact has one if its penetration or stiffness
    varies with an angle of the joint too, such as the mesh angle of gears. Opposite forces act on
    the two bodies at a common point.

    - `arm_first`, `arm_second`: this point, m from each body's centre of mass in its axes.
    - `slope`: global vector whose scalar product with the velocity of the second body's point
      relative to the first body's point is the rate of the penetration due to the angle; a normal
      force F causes the force -F `slope` on the second body.
    - `elastic`: force on the second body, N in global axes, since the stored energy varies with the
      angle at constant penetration.
    """

    arm_first: Vector
    arm_second: Vector
    slope: Vector
    elastic: Vector

    def on_second(self, normal_force: Scalar) -> Vector:
        """Return the force on the second body, N in global axes, for a normal force, N."""
        return self.elastic - self.slope * normal_force


@tree_dataclass
class Contact:
    """Geometry of one possible contact between two surfaces.

    - `gap`: penetration, m, and its rate, m/s.
    - `normal`: global unit vector, the direction in which the second body penetrates the first. The
      normal force on the second body is -F normal, on the first +F normal.
    - `arm_first`, `arm_second`: vector from each body's centre of mass to the contact point on its
      surface, m in body axes.
    - `slip`: tangential velocity of the second body relative to the first, m/s in global axes, or
      ``None`` without friction.
    - `line_first`, `line_second`: optional points on the normal force's line of action, such as the
      centre of a ball, m in body axes. Without friction the force acts there, which saves
      arithmetic and rounding.
    - `turning`: ``None``, except for a contact that acts as a couple: the derivatives of the
      penetration's rate by the two bodies' spins, m in body axes. A normal force F is then the
      moments -F times these vectors; `normal` is the axis about which the second body rotates into
      the first, and there is no friction.
    - `face_radius`: ``None``, except for two flat faces whose friction also resists their relative
      rotation: their mean radius, m. `slip` then has a component along the normal, this radius
      times the relative spin of the second body about the normal.
    - `lever`: ``None``, except for friction in an ideal hinge or ball: the radius, m, by which the
      friction F acts as a couple with the moment `lever` F. `slip` is then `lever` times the
      angular velocity of the second body relative to the first.
    - `side`: ``None``, except for a contact whose penetration or stiffness also varies with an
      angle of the joint: the force in addition to the normal force. There is then no friction.

    >>> gap = extend.Gap(depth=1e-6, rate=0.0)
    >>> arms = extend.Vector(0.0, 0.0, 0.0), extend.Vector(0.0, 0.0, -0.01)
    >>> contact = extend.Contact(gap, extend.UNIT_Z, *arms, slip=None)
    >>> contact.normal.z
    1.0
    """

    gap: Gap
    normal: Vector
    arm_first: Vector
    arm_second: Vector
    slip: Vector | None
    line_first: Vector | None = None
    line_second: Vector | None = None
    turning: tuple[Vector, Vector] | None = None
    face_radius: Scalar | None = None
    lever: Scalar | None = None
    side: SideForce | None = None

    def points_of_force(self, has_friction: bool) -> tuple[Vector, Vector]:
        """Return the points where the force acts on both bodies, m in body axes."""
        if has_friction or self.line_first is None or self.line_second is None:
            return self.arm_first, self.arm_second
        return self.line_first, self.line_second


class AbstractContactJoint(AbstractElement):
    """A joint with unilateral contacts between a first and a second body.

    Each contact has a label and a law for its normal force. This example is a ball on a horizontal
    floor. Test a user-defined joint with `clearjoint.testing.check_contact_joint`.

    ```python
    import clearjoint as cj

    class BallOnFloor(cj.extend.AbstractContactJoint):
        ball: str
        radius: float  # m
        law: cj.extend.AbstractContactLaw

        def pair(self):
            return "ground", self.ball

        def laws(self):
            return {"floor": self.law}

        def contacts(self, motions):
            ball, down = motions[self.ball], cj.extend.Vector(0.0, 0.0, -1.0)
            gap = cj.extend.Gap(self.radius - ball.position.z, -ball.velocity.z)
            on_floor = cj.extend.Vector(ball.position.x, ball.position.y, 0.0)
            on_ball = ball.components(down * self.radius)
            return {"floor": cj.extend.Contact(gap, down, on_floor, on_ball, slip=None)}

        def friction_force(self, name, contact, normal_force):
            return None

    floor = BallOnFloor("ball", radius=0.01, law=cj.laws.Hertz(1e9))
    ```
    """

    @abc.abstractmethod
    def laws(self) -> dict[str, AbstractContactLaw]:
        """Return the law of the normal force of each contact, by label."""

    @abc.abstractmethod
    def contacts(self, motions: Motions) -> dict[str, Contact]:
        """Return the geometry of each contact, by the labels that `laws` returns."""

    @abc.abstractmethod
    def friction_force(self, name: str, contact: Contact, normal_force: Scalar) -> Vector | None:
        """Return the friction force on the second body, N in global axes; ``None`` for none.

        With friction the contact's `slip` must not be ``None``. The force is tangential, except for
        a contact with a `face_radius`, where it may have a component along the normal: this
        component times the radius is the moment about the normal by which friction resists the
        relative rotation of the faces.
        """

    def bristle_laws(self) -> dict[str, AbstractBristleFriction]:
        """Return bristles that replace `friction_force`, by label of the contact; none by default.
        The contact's `slip` must not be ``None``, and its `face_radius` must be ``None``."""
        return {}

    @abc.abstractmethod
    def pair(self) -> tuple[str, str]:
        """Return the names of the first and the second body."""

    @override
    def body_names(self) -> tuple[str, ...]:
        return self.pair()

    def film_wrenches(self, motions: Motions) -> dict[str, Wrench]:
        """Return the wrench, on each body by name, of a film or another viscous drag, which stores
        no energy; empty by default."""
        return {}

    def deepest(self) -> dict[str, Scalar]:
        """Return the penetration that ends a run, m, by label of the contact; by default none."""
        return {}

    def law_limits(self, name: str, depth: Scalar) -> tuple[Limit, ...]:
        """Return the limits of validity of the law of contact `name` at a penetration, m; none by
        default. After a run with recorded impacts, they are checked at the largest penetration."""
        return ()

    def slid_out(self, motions: Motions) -> Scalar | None:
        """Return how far the second body has slid out of the first, m; ``None`` if it can't. Runs
        warn if this is positive at a saved time or at the end."""
        return None

    def centred_joint(self) -> AbstractConstraint | None:
        """Return the ideal joint that holds the second body midway between its contacts. `assemble`
        uses it for a body that starts outside its clearance; ``None`` by default."""
        return None

    def resting_joint(self, load: np.ndarray) -> AbstractConstraint | None:
        """Return the ideal joint that holds the second body where it rests under a load, for the
        joints in the argument `resting` of `assemble`; ``None``, the default, for no such joint.
        The load, which the contacts carry elastically, is the force of the second body on the
        first, (3,) N in the first body's axes."""
        return None

    def anchor(self) -> tuple[str, Vector, Vector] | None:
        """Return the name of a body that the joint connects with the ground, and two points near
        each other: of the body, m from its centre of mass in its axes, and of the ground, m from
        the origin; ``None``, the default, if there are no such points. The vector between them may
        replace the body's position as an integration variable, since a difference of large
        coordinates would lose digits."""
        return None

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return constraint rows in addition to the contacts, by label; empty by default."""
        return {}


def require_distinct(first: str, second: str) -> None:
    for argument, name in (("first", first), ("second", second)):
        require(isinstance(name, str), argument, name, "the name of a body", "pass the body's name")
    require(first != second, "second", second, "another body than `first`", "name two bodies")


class AbstractPair(AbstractElement):
    """Base class of elements between two different bodies, `first` and `second`."""

    first: eqx.AbstractVar[str]
    second: eqx.AbstractVar[str]

    @override
    def __check_init__(self):
        require_distinct(self.first, self.second)

    def pair(self) -> tuple[str, str]:
        """Return the names of the first and the second body."""
        return self.first, self.second

    @override
    def body_names(self) -> tuple[str, ...]:
        return self.pair()

    def _between(self, motions: Motions) -> tuple[tuple[str, str], Motion, Motion]:
        return self.pair(), motions[self.first], motions[self.second]


class AbstractNamedPair(AbstractPair):
    """Base class of elements between two bodies, whose names are the first two fields."""

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)


class AbstractPairAtPoints(AbstractNamedPair):
    """Base class of elements between a point of each of two bodies: `point_first`, `point_second`,
    (3,) m from the body's centre of mass in its axes; on the ground from the origin."""

    point_first: Triple = quantity("m", check=require_point)
    point_second: Triple = quantity("m", check=require_point)
    point_fields = {"point_first": "first", "point_second": "second"}

    def ends(
        self, axis_first: Triple | None = None, axis_second: Triple | None = None
    ) -> tuple[Marker, Marker]:
        """Return markers of both points, for drawing, with optional axes, (3,) in body axes."""
        first = Marker(self.first, self.point_first, axis_first)
        return first, Marker(self.second, self.point_second, axis_second)


def each_label(function: Callable[[str, str], T], table: Mapping[str, Iterable[str]]) -> ByLabel[T]:
    """Return ``function(joint, label)`` for each label in ``table[joint]``, by joint and label."""
    return {
        name: {label: function(name, label) for label in labels} for name, labels in table.items()
    }
