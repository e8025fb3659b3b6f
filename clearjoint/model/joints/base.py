"""Interfaces of the elements of a scene: constraints, forces and contact joints.

User-defined elements subclass `AbstractConstraint`, `AbstractForce` or `AbstractContactJoint`; no
registration is needed. All methods receive the scalar types of `clearjoint.math.vectors`.
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
"""Motion of each body by name, including the ground.

>>> def height(motions: extend.Motions) -> extend.Scalar:
...     return motions["arm"].position.z
"""
ByLabel: TypeAlias = dict[str, dict[str, T]]
"""Values by joint name and then by the joint's label of a contact or constraint equation."""
Attachment: TypeAlias = tuple[str, str, Triple]
"""A point on a body: the element's argument for it, the body's name, and (3,) m in body axes."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True, slots=True)
class Row:
    """One scalar constraint equation Phi = 0 in a configuration.

    - `value`: Phi.
    - `jacobian`: for each body a force-moment pair, with the rate of Phi = sum(force . velocity +
      moment . spin) + `time_rate`. The reaction on a body is its pair times the multiplier.
    - `bias`: second derivative of Phi for zero accelerations.
    - `time_rate`: rate of Phi with all bodies at rest. It is zero unless Phi depends on time, as
      for a driver, which then supplies the power -multiplier time_rate.

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
    """Base class of everything in a scene that acts on bodies."""

    @abc.abstractmethod
    def body_names(self) -> tuple[str, ...]:
        """Return the names of the bodies it acts on, including the ground."""

    def breakpoints(self) -> PyTree:
        """Return the times in s at which the element is not a smooth function of time; none by
        default.

        A breakpoint is a jump or kink of the force, or a kink of the prescribed angle. Return a
        number, an array or a tuple of them, in any order. Breakpoints that are computed from the
        element's fields may be parameters. Integration steps end at breakpoints, each step sees one
        side only, and derivatives include the effect of the jump. A jump at an undeclared time
        costs many short steps, and `sensitivities` raises an error for it.
        """
        return ()

    def attachments(self) -> tuple[Attachment, ...]:
        """Return the element's points on bodies; none by default. The scene checks their units."""
        return ()

    def draw(self, pen: AbstractPen) -> None:
        """Draw the element with a pen; by default its points are marked."""
        for _, body, point in self.attachments():
            pen.mark(Marker(body, point))


class AbstractConstraint(AbstractElement):
    """An ideal joint: constraint equations Phi = 0 (eq. 27), enforced by multipliers.

    This massless rod between two centres of mass differentiates a residual:

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
    state = cj.State({"ball": cj.body_state((0.5, 0.0, 0.0))})
    ```
    """

    @abc.abstractmethod
    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return the constraint equations by name; they must be linearly independent."""

    def motion_subspace(self, parent: str) -> AbstractMotionSubspace | None:
        """Return the relative motion that the joint allows, with the body `parent` as the parent.

        With a motion subspace, joint coordinates replace the constraint equations. ``None``, the
        default, keeps the equations.
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
        """Return the wrench on each body by name; a wrench on the ground is ignored."""

    def stored_energy(self, motions: Motions, t: Scalar) -> Scalar:
        """Return the potential energy in J; 0 by default."""
        del motions, t
        return 0.0

    def supplied_power(self, motions: Motions, t: Scalar) -> Scalar:
        """Return the power in W that the element adds to the system, besides changes of its stored
        energy.

        The default, the total power of the wrenches, is right for an element without stored energy.
        """
        power: Scalar = 0.0
        for name, wrench in self.wrenches(motions, t).items():
            power = power + motions[name].power(wrench)
        return power


@jax.tree_util.register_dataclass
@dataclass(frozen=True, slots=True)
class Contact:
    """Geometry of one possible contact between two surfaces.

    - `gap`: penetration and its rate.
    - `normal`: global unit vector, the direction in which the second body penetrates the first. The
      normal force on the second body is -F normal, on the first +F normal.
    - `arm_first`, `arm_second`: contact points on the two surfaces, from each body's centre of mass
      in its axes, m (eq. 17).
    - `slip`: tangential velocity of the second body relative to the first, m/s, or ``None`` without
      friction.
    - `line_first`, `line_second`: optional points on the normal force's line of action, in body
      axes, m. They replace the arms without friction, if they need less arithmetic and rounding.
    - `turning`: only for a contact that acts as a couple: the derivatives of the penetration's rate
      with respect to the first and the second body's spin, m in body axes. A normal force F then
      acts as the moments -F times these vectors, without a net force. `normal` is the axis about
      which the second body rotates into the first, and there is no friction.

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
        """Return the points of action on the first and the second body, in body axes, m."""
        if has_friction or self.line_first is None or self.line_second is None:
            return self.arm_first, self.arm_second
        return self.line_first, self.line_second


class AbstractContactJoint(AbstractElement):
    """A joint with unilateral contacts, each with a normal law that may use the entry speed.

    Test a user-defined joint with `clearjoint.testing.check_contact_joint`.

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
        """Return the normal law of each contact by name."""

    @abc.abstractmethod
    def contacts(self, motions: Motions) -> dict[str, Contact]:
        """Return the geometry of each contact by name."""

    @abc.abstractmethod
    def friction_force(self, name: str, contact: Contact, normal_force: Scalar) -> Vector | None:
        """Return the friction force on the second body in N, or ``None`` without friction."""

    def bristle_laws(self) -> dict[str, AbstractBristleFriction]:
        """Return the bristle laws by contact name; none by default.

        They replace `friction_force` for these contacts, which must have a `slip`.
        """
        return {}

    @abc.abstractmethod
    def pair(self) -> tuple[str, str]:
        """Return the names of the first and the second body."""

    def body_names(self) -> tuple[str, ...]:
        """Return the names of the first and the second body."""
        return self.pair()

    def film_wrenches(self, motions: Motions) -> dict[str, Wrench]:
        """Return the wrench of a film on each body by name; none by default.

        All of the film's power is counted as dissipated.
        """
        del motions
        return {}

    def deepest(self) -> dict[str, Scalar]:
        """Return the largest meaningful penetrations in m by contact name; none by default.

        A run ends when a contact exceeds this depth.
        """
        return {}

    def law_limits(self, name: str, depth: Scalar) -> tuple[Limit, ...]:
        """Return the validity limits of a contact's law at a penetration, m; none by default.

        A run that records impacts warns of penetrations outside the limits.
        """
        del name, depth
        return ()

    def slid_out(self, motions: Motions) -> Scalar | None:
        """Return how far the second body has slid out of the first along the axis, m; negative
        inside.

        A run warns of positive values. ``None``, the default, means that this can't happen.
        """
        del motions
        return None

    def centred_joint(self) -> AbstractConstraint | None:
        """Return the ideal joint that holds the second body midway between its contacts.

        `assemble` moves a body that starts outside to this position. ``None`` by default.
        """
        return None

    def resting_joint(self, load: np.ndarray) -> AbstractConstraint | None:
        """Return the ideal joint that holds the second body at rest under a load, in packed form.

        Return ``None``, the default, if there is no position of rest.

        **Arguments:** `load`: (3,) N, of the second body on the first, in the first body's axes.
        """
        del load
        return None

    def anchor(self) -> tuple[str, Vector, Vector] | None:
        """Return a moving body, a point in its axes and the ground's point near it, or ``None``"""
        return None

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return constraint equations in addition to the contacts; none by default."""
        del motions, t
        return {}
