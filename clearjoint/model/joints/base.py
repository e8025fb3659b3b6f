"""What an element of a scene may do: constrain, push, and touch.

A third party subclasses `AbstractConstraint`, `AbstractForce` or `AbstractContactJoint`; nothing is
registered. All methods work on the scalar form of `clearjoint.math.vectors`.
"""

import abc
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias, TypeVar

import jax
import numpy as np
from jaxtyping import PyTree

from ...fields.conversion import AbstractConverting
from ...fields.types import Triple
from ...math.vectors import Scalar, Vector
from ..bodies import Motion, Wrench
from ..contact.bristles import AbstractBristleFriction
from ..contact.gap import Gap
from ..contact.laws import AbstractContactLaw
from ..contact.limits import Limit
from ..pen import AbstractPen, Marker
from .motion_subspaces import AbstractMotionSubspace

T = TypeVar("T")

Motions: TypeAlias = Mapping[str, Motion]
"""Motion of each body by name, the ground included.

>>> def height(motions: extend.Motions) -> extend.Scalar:
...     return motions["arm"].position.z
"""
ByLabel: TypeAlias = dict[str, dict[str, T]]
"""One of each contact, or of each constraint equation, by the joint's name and its own label."""
Attachment: TypeAlias = tuple[str, str, Triple]
"""A point on a body: the element's argument for it, the body's name, and (3,) m in its axes."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True, slots=True)
class Row:
    """One scalar constraint at a configuration.

    `value` is Phi; `jacobian[body]` the wrench-like pair with Phi's rate = force . velocity +
    moment . spin + `time_rate` (so that the reaction on the body is this pair times the
    multiplier); `bias` is Phi's second derivative where all accelerations are zero.
    `time_rate` is the rate of Phi while all bodies stand still: zero unless Phi depends on time,
    as a driver's does, which then supplies the power -multiplier time_rate.

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
    """Anything in a scene that names bodies."""

    @abc.abstractmethod
    def body_names(self) -> tuple[str, ...]:
        """Names of the bodies it acts on, the ground included."""

    def breakpoints(self) -> PyTree:
        """Times in s where the element changes as no smooth function of time does: its force jumps
        or has a kink, or the angle it prescribes has a kink. None by default.

        A number, an array or a tuple of such, in any order; computed from the element's own numbers
        they may be parameters. Steps end there, each sees one side only, and derivatives have the
        jump's own term. A force that jumps at an instant that it does not declare is integrated
        with many short steps, and `sensitivities` refuses it.
        """
        return ()

    def attachments(self) -> tuple[Attachment, ...]:
        """The points that it has on bodies, by which the scene checks units; none by default."""
        return ()

    def draw(self, pen: AbstractPen) -> None:
        """Say what it looks like in the words of a pen; its points are marked by default."""
        for _, body, point in self.attachments():
            pen.mark(Marker(body, point))


class AbstractConstraint(AbstractElement):
    """An ideal joint: constraint equations Phi = 0 (eq. 27) that the multipliers enforce.

    A rod without mass between two centres of mass, by a residual that is differentiated:

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
                (here, _), (there, _) = first, second
                apart = there - here
                return (0.5 * (apart.dot(apart) - self.length**2),)

            names = self.body_names()
            pair = [motions[name] for name in names]
            return cj.extend.rows_from_residual(names, ("length",), residual, *pair)

    bodies = {"ball": cj.Body(1.0, (1e-3, 1e-3, 1e-3))}
    scene = cj.Scene(bodies, {"rod": Rod("ground", "ball", length=0.5)})
    state = cj.State({"ball": cj.body_state((0.5, 0.0, 0.0))})
    ```
    """

    @abc.abstractmethod
    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """The constraint equations by name, independent of each other."""

    def motion_subspace(self, parent: str) -> AbstractMotionSubspace | None:
        """The motion that the joint leaves the other one of its two bodies against the given one.

        Joint coordinates follow it and leave the constraint equations out. ``None``, the default,
        keeps them in.
        """
        del parent
        return None


class AbstractForce(AbstractElement):
    """A force element without contact.

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

    bodies = {"ball": cj.Body(1.0, (1e-3, 1e-3, 1e-3))}
    scene = cj.Scene(bodies, forces={"air": Drag("ball", factor=0.02)}, gravity=(0, 0, -9.81))
    ```
    """

    @abc.abstractmethod
    def wrenches(self, motions: Motions, t: Scalar) -> dict[str, Wrench]:
        """Wrench on each body by name; the ground's is never used."""

    def stored_energy(self, motions: Motions, t: Scalar) -> Scalar:
        """Potential energy in J; 0 unless the element stores some."""
        del motions, t
        return 0.0

    def supplied_power(self, motions: Motions, t: Scalar) -> Scalar:
        """Power in W that enters the system beside the change of the stored energy.

        The default, all the power of the wrenches, is right for an element that stores nothing.
        """
        power: Scalar = 0.0
        for name, wrench in self.wrenches(motions, t).items():
            power = power + motions[name].power(wrench)
        return power


@jax.tree_util.register_dataclass
@dataclass(frozen=True, slots=True)
class Contact:
    """Geometry of one possible contact between two surfaces.

    `normal` is the direction in which the second body penetrates the first, a global unit vector:
    the normal force on the second body is -F normal, on the first +F normal. `arm_first` and
    `arm_second` are the contact points on the two surfaces, from each body's centre of mass in its
    axes, m (eq. 17). `slip` is the tangential velocity of the second body relative to the first,
    m/s, or ``None`` without friction. A normal force alone may act at any points on its line,
    `line_first` and `line_second`, if some are known with less arithmetic and rounding.

    A contact that only turns the bodies has `turning`: the derivatives of the penetration's rate by
    the spin of the first and of the second body, m in body axes. A normal force F is then no force,
    but the moments -F times these; `normal` is the axis about which the second body turns into the
    first, and there is no friction.

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

    def points_of_force(self, has_friction: bool) -> tuple[Vector, Vector]:
        """Where the force acts on the first and on the second body, in their axes, m."""
        if has_friction or self.line_first is None or self.line_second is None:
            return self.arm_first, self.arm_second
        return self.line_first, self.line_second


class AbstractContactJoint(AbstractElement):
    """A joint of unilateral contacts, each with a normal law that may remember its impact;
    `clearjoint.testing.check_contact_joint` tells whether it behaves.

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

    bodies = {"ball": cj.Body(0.1, (4e-6, 4e-6, 4e-6))}
    joints = {"floor": BallOnFloor("ball", radius=0.01, law=cj.laws.Hertz(1e9))}
    scene = cj.Scene(bodies, joints, gravity=(0.0, 0.0, -9.81))
    ```
    """

    @abc.abstractmethod
    def laws(self) -> dict[str, AbstractContactLaw]:
        """The law of each contact by name."""

    @abc.abstractmethod
    def contacts(self, motions: Motions) -> dict[str, Contact]:
        """The geometry of each contact by name."""

    @abc.abstractmethod
    def friction_force(self, name: str, contact: Contact, normal_force: Scalar) -> Vector | None:
        """Friction on the second body in N, or ``None`` where there is none."""

    def bristle_laws(self) -> dict[str, AbstractBristleFriction]:
        """The laws of the contacts whose friction comes from bristles, by name; none by default.

        There the law's friction acts in the place of `friction_force`, and contacts have a slip.
        """
        return {}

    @abc.abstractmethod
    def pair(self) -> tuple[str, str]:
        """Names of the first and the second body."""

    def body_names(self) -> tuple[str, ...]:
        """Names of the first and the second body."""
        return self.pair()

    def film_wrenches(self, motions: Motions) -> dict[str, Wrench]:
        """What a film between the surfaces does to each body, by name, beside the contacts; all of
        its power is dissipated. None by default."""
        del motions
        return {}

    def deepest(self) -> dict[str, Scalar]:
        """Penetrations in m beyond which contacts make no sense, by name, of those that know one; a
        run ends there. None by default."""
        return {}

    def law_limits(self, name: str, depth: Scalar) -> tuple[Limit, ...]:
        """What the law of a contact holds for, with what it is at a penetration, m; a run that
        keeps its impacts warns of penetrations beyond. None by default."""
        del name, depth
        return ()

    def slid_out(self, motions: Motions) -> Scalar | None:
        """How far the second body has slid out of the first along the axis, m, negative inside.

        A run warns where it is positive. ``None``, the default, for a joint that it can't leave.
        """
        del motions
        return None

    def centred_joint(self) -> AbstractConstraint | None:
        """The ideal joint that holds the second body midway between its contacts.

        `assemble` puts a body there that starts outside. ``None``, the default, where there is no
        such place.
        """
        return None

    def resting_joint(self, load: np.ndarray) -> AbstractConstraint | None:
        """The ideal joint that holds the second body where a load lets it rest; ``None``, the
        default, where it can't rest. In packed form, as `centred_joint`.

        **Arguments:** `load`: (3,) N, of the second body on the first, in the first one's axes.
        """
        del load
        return None

    def anchor(self) -> tuple[str, Vector, Vector] | None:
        """A moving body, a point of it (body axes), and the ground's point that it stays near."""
        return None

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Constraint equations that the joint adds to its contacts; none by default."""
        del motions, t
        return {}
