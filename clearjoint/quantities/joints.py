"""Quantities of joints: contacts, the journal in its bearing, reactions, films and angles."""

import math
from collections.abc import Callable, Collection
from functools import reduce
from typing import ClassVar, Protocol, runtime_checkable

import equinox as eqx
from typing_extensions import override

from .._dynamics.equations_of_motion import constraint_wrenches
from .._fields.checks import require
from .._math.smoothing import norm_and_direction
from .._math.vectors import ZERO, Scalar, Vector, add
from .._model.bodies import GROUND, NO_WRENCH, Wrench
from .._model.clearance_joints.journal_bases import BASES, HasJournal
from .._model.joints.base import AbstractConstraint, AbstractContactJoint, Motions, Row
from .._model.joints.constraint_rows import row_rate
from .._model.scene import Scene
from .base import (
    AbstractQuantity,
    AbstractVectorQuantity,
    Axes,
    Component,
    Instant,
    as_axes,
    as_component,
    one_of,
    require_known,
)


class AbstractJointQuantity(AbstractQuantity):
    """Base class of quantities of a joint."""

    joint: str = eqx.field(static=True)

    @override
    def check(self, scene: Scene) -> None:
        require_known("joint", self.joint, self.joints(scene))

    def joints(self, scene: Scene) -> Collection[str]:
        """Return the names of the joints to which the quantity applies; all joints by default."""
        return scene.joints


class AbstractContactQuantity(AbstractJointQuantity):
    """Base class of quantities of a contact of a joint."""

    contact: str = eqx.field(static=True)

    @override
    def joints(self, scene: Scene) -> Collection[str]:
        return scene.contact_joints()

    @override
    def check(self, scene: Scene) -> None:
        super().check(scene)
        require_known("contact", self.contact, scene.laws()[self.joint])


class ContactForce(AbstractContactQuantity):
    """Normal force that a joint transmits by all of its contacts, or by one of them, N.

    The force of all contacts is the magnitude of the resultant of their normal forces: a journal
    that rests on both of its bases with 100 N each carries 200 N, and a journal that is jammed
    between opposite walls carries the difference of their forces. Name a contact for the load on
    one base, as tables of impacts list it: about half of the joint's force in a parallel impact.

    >>> of_joint = cj.quantities.ContactForce("shoulder")
    >>> of_base = cj.quantities.ContactForce("shoulder", "V")
    """

    contact: str | None = eqx.field(default=None, static=True)
    unit: ClassVar[str | None] = "N"

    @override
    def check(self, scene: Scene) -> None:
        if self.contact is not None:
            super().check(scene)
        else:  # all contacts of the joint
            require_known("joint", self.joint, self.joints(scene))

    @override
    def __call__(self, now: Instant) -> Scalar:
        contacts = now.contacts[self.joint]
        label = self.contact
        if label is None and len(contacts) == 1:  # the resultant of one force needs no norm
            (label,) = contacts
        if label is not None:
            return contacts[label].normal_force
        forces = [force.contact.normal * force.normal_force for force in contacts.values()]
        return norm_and_direction(reduce(Vector.__add__, forces))[0]


class FrictionForce(AbstractContactQuantity):
    """Magnitude of the friction force at a contact, N; zero without friction.

    This force does not include the moment of friction of flat faces that rotate on each other.

    >>> friction = cj.quantities.FrictionForce("shoulder", "V")
    """

    unit: ClassVar[str | None] = "N"

    @override
    def __call__(self, now: Instant) -> Scalar:
        friction = now.contacts[self.joint][self.contact].friction
        return 0.0 if friction is None else norm_and_direction(friction)[0]


class Penetration(AbstractContactQuantity):
    """Penetration of a contact, m; negative while the surfaces are apart.

    >>> depth = cj.quantities.Penetration("shoulder", "V")
    """

    unit: ClassVar[str | None] = "m"

    @override
    def __call__(self, now: Instant) -> Scalar:
        return now.contacts[self.joint][self.contact].contact.gap.depth


class PenetrationRate(AbstractContactQuantity):
    """Rate of a contact's penetration, m/s, positive while the bodies approach; at an onset it
    equals the entry speed.

    >>> rate = cj.quantities.PenetrationRate("shoulder", "V")
    """

    unit: ClassVar[str | None] = "m/s"

    @override
    def __call__(self, now: Instant) -> Scalar:
        return now.contacts[self.joint][self.contact].contact.gap.rate


class EntrySpeed(AbstractContactQuantity):
    """Entry speed of the current contact, the rate of the penetration at its onset, m/s; zero while
    the surfaces are apart.

    Only contacts whose law uses the entry speed have one. In a `Section` at the onset or end of a
    contact, the value is the entry speed of this contact. For a contact that began before the start
    of the run, the value is 1e9 m/s, unless the initial state contains the entry speed.

    >>> speed = cj.quantities.EntrySpeed("shoulder", "V")
    """

    unit: ClassVar[str | None] = "m/s"

    @override
    def check(self, scene: Scene) -> None:
        super().check(scene)
        laws = scene.contact_joints()[self.joint].laws()
        with_speed = [label for label, law in laws.items() if law.uses_entry_speed]
        require_known("contact", self.contact, with_speed)

    @override
    def __call__(self, now: Instant) -> Scalar:
        return now.entry_speeds[self.joint][self.contact]


class BristleDeflection(AbstractContactQuantity):
    """Magnitude of the bristle deflection of a contact, m; zero while the surfaces are apart.

    Only contacts with an `AbstractBristleFriction`, a friction law that models sticking by a
    deflection of the surfaces, have one.

    >>> deflection = cj.quantities.BristleDeflection("shoulder", "V")
    >>> deflection.check(cj.mechanisms.double_pendulum(friction=cj.frictions.Dahl(0.1))[0])
    """

    unit: ClassVar[str | None] = "m"

    @override
    def joints(self, scene: Scene) -> Collection[str]:
        return scene.bristle_laws()

    @override
    def check(self, scene: Scene) -> None:
        super().check(scene)
        require_known("contact", self.contact, scene.bristle_laws()[self.joint])

    @override
    def __call__(self, now: Instant) -> Scalar:
        return norm_and_direction(now.bristles[self.joint][self.contact])[0]


_base: Callable[[str | None], str | None] = one_of("base", *BASES, None)


class AbstractJournalQuantity(AbstractJointQuantity):
    """Base class of positions, m, of a journal or of the centre of one of its ends."""

    unit: ClassVar[str | None] = "m"

    @override
    def joints(self, scene: Scene) -> Collection[str]:
        return [name for name, j in scene.joints.items() if isinstance(j, HasJournal)]

    def offset(self, now: Instant, base: str | None) -> Vector:
        """Return the vector, m, from the bearing's centre to the centre of a `base` of the journal
        or, for ``None``, of the journal itself, in the frame of `JournalOffset`."""
        joint = now.scene.joints[self.joint]
        assert isinstance(joint, HasJournal)
        return joint.journal_offset(now.motions, base)


class JournalOffset(AbstractJournalQuantity):
    """Component of the vector from the bearing's centre to the centre of the journal, or of one of
    its ends, m: the signal of a proximity probe on the bearing.

    The component is taken in the bearing's frame, fixed in the bearing's body: z is the bearing's
    axis; x and y are perpendicular to z, by the formula of T. Duff et al. (Building an orthonormal
    basis, revisited, 2017). For a bearing axis of (0, 0, 1) the frame has the body's axes.

    >>> probes = {axis: cj.quantities.JournalOffset("shoulder", axis) for axis in ("x", "y")}
    """

    component: Component = eqx.field(static=True, converter=as_component)
    base: str | None = eqx.field(default=None, static=True, converter=_base)

    @override
    def __call__(self, now: Instant) -> Scalar:
        return getattr(self.offset(now, self.base), self.component)


class Eccentricity(AbstractJournalQuantity):
    """Distance of the centre of a journal, or of one of its ends, from the bearing's axis, m.

    >>> eccentricity = cj.quantities.Eccentricity("shoulder", base="V")
    >>> eccentricity.check(cj.mechanisms.double_pendulum()[0])  # does the scene have this joint?
    """

    base: str | None = eqx.field(default=None, static=True, converter=_base)

    @override
    def __call__(self, now: Instant) -> Scalar:
        offset = self.offset(now, self.base)
        return norm_and_direction(Vector(offset.x, offset.y, 0.0))[0]


class Multiplier(AbstractJointQuantity):
    """Lagrange multiplier of a constraint row: the force or moment by which the joint satisfies it.

    The row's Jacobian times the multiplier is the reaction on the bodies. The multiplier's unit is
    N for a row whose value is in m, and N m for a row in rad or without unit. For a driver, it is
    the driving force or moment, positive if it pushes the second body towards larger values.

    Prefer `Reaction`, which is a force in known axes, and exists for all joints. Multipliers depend
    on how the joint writes its equations. A joint that joint coordinates eliminate has none. With
    redundant constraints, multipliers are not unique, and those of least norm are computed.

    `row` is a key of the dictionary that the joint's method `rows` returns. **Raises:**
    `ValueError`, when evaluated, if the row is unknown or has no multiplier.

    >>> torque = cj.quantities.Multiplier("motor", "angle")
    >>> torque.check(cj.mechanisms.slider_crank()[0])  # does the scene have this joint?
    """

    row: str = eqx.field(static=True)

    @override
    def __call__(self, now: Instant) -> Scalar:
        multipliers = now.dynamics.multipliers.get(self.joint, {})
        expected = f"one of {sorted(multipliers)}, the rows of {self.joint!r} with a multiplier"
        remedy = "take Reaction if the joint coordinates satisfy the joint by themselves"
        require(self.row in multipliers, "row", self.row, expected, remedy)
        return multipliers[self.row]


class AbstractReaction(AbstractJointQuantity):
    """Base class of reactions of a joint on one of its bodies, `body`, which may be the ground."""

    body: str = eqx.field(static=True)

    @override
    def check(self, scene: Scene) -> None:
        super().check(scene)
        require_known("body", self.body, scene.joints[self.joint].body_names())

    def constraint_wrench(self, now: Instant) -> Wrench:
        """Return the force, N in global axes, and the moment about the centre of mass, N m in body
        axes, of the joint's constraints on the body, without those of contacts and films."""
        # In joint coordinates, rows of joints that the coordinates satisfy have no multipliers.
        return constraint_wrenches(now.absolute_dynamics, self.joint).get(self.body, NO_WRENCH)


class Reaction(AbstractVectorQuantity, AbstractReaction):
    """Force of a joint on one of its bodies, N: its magnitude or a global component.

    For an ideal joint the force follows from the Lagrange multipliers of its constraints, which are
    computed even if the run uses joint coordinates. With redundant constraints the force isn't
    unique, and the multipliers of least norm are used. For a joint with clearance the force is the
    sum of normal forces, friction, film force and axial reaction.

    >>> load = cj.quantities.Reaction("elbow", "arm 3")
    """

    unit: ClassVar[str | None] = "N"

    @override
    def vector(self, now: Instant) -> Vector:
        joint, force = now.scene.joints[self.joint], ZERO
        if isinstance(joint, AbstractContactJoint):
            force = self._contact_force(joint, now)
        if joint.rows(now.motions, now.time):
            force = force + self.constraint_wrench(now).force
        return force

    def _contact_force(self, joint: AbstractContactJoint, now: Instant) -> Vector:
        """Return the force of the joint's contacts and film on `body`, N in global axes."""
        # First the force on the joint's second body; the reaction on the first is its opposite.
        on_second = ZERO
        for loaded in now.contacts[self.joint].values():
            # A contact with `turning` or a `lever` acts as a couple, without a net force.
            if loaded.contact.turning is None and loaded.contact.lever is None:
                on_second = on_second - loaded.contact.normal * loaded.normal_force
                on_second = on_second if loaded.friction is None else on_second + loaded.friction
            # The additional force of a contact that also depends on an angle, as of gear teeth.
            if loaded.contact.side is not None:
                on_second = on_second + loaded.contact.side.on_second(loaded.normal_force)
        film_force = joint.film_wrenches(now.motions).get(self.body, NO_WRENCH).force
        return (on_second if self.body == joint.pair()[1] else -on_second) + film_force


class ReactionMoment(AbstractVectorQuantity, AbstractReaction):
    """Moment of an ideal joint or driver on one of its bodies, N m: its magnitude or a component.

    The moment refers to the joint's point on the body. If the joint has no point there, it refers
    to the centre of mass, or to the global origin for the ground. For a driver the quantity is the
    driving moment. With redundant constraints the moment isn't unique, and the Lagrange multipliers
    of least norm are used.

    >>> bending = cj.quantities.ReactionMoment("elbow", "arm 3", "x", axes="body")
    """

    axes: Axes = eqx.field(default="global", static=True, converter=as_axes)
    unit: ClassVar[str | None] = "N m"

    @override
    def joints(self, scene: Scene) -> Collection[str]:
        return [name for name, j in scene.joints.items() if isinstance(j, AbstractConstraint)]

    @override
    def vector(self, now: Instant) -> Vector:
        wrench, motion = self.constraint_wrench(now), now.motions[self.body]
        # The wrench refers to the centre of mass: move its moment to the joint's point.
        moment = wrench.moment
        for _, body, point in now.scene.joints[self.joint].attachments():
            if body == self.body:
                moment = moment - point.cross(motion.components(wrench.force))
        return moment if self.axes == "body" else motion.direction(moment)


class FilmForce(AbstractVectorQuantity, AbstractJointQuantity):
    """Force of a joint's lubricant film on its journal, N: its magnitude or a global component.

    The joint is a `LubricatedJoint`, or a user-defined joint with a method `film_wrenches`, from
    which the force on the joint's second body is taken; zero if there is none.

    >>> force = cj.quantities.FilmForce("bearing", "y")
    >>> force.check(cj.mechanisms.rotor_in_bearing(film=cj.films.CaponeFilm(0.02))[0])
    """

    unit: ClassVar[str | None] = "N"

    @override
    def joints(self, scene: Scene) -> Collection[str]:
        # The default returns no wrench: joints of the other classes have no film.
        kinds = {name: type(joint) for name, joint in scene.contact_joints().items()}
        default = AbstractContactJoint.film_wrenches
        return [name for name, kind in kinds.items() if kind.film_wrenches is not default]

    @override
    def vector(self, now: Instant) -> Vector:
        joint = now.scene.contact_joints()[self.joint]
        _, journal = joint.pair()
        return joint.film_wrenches(now.motions).get(journal, NO_WRENCH).force


@runtime_checkable
class HasRelativeAngle(Protocol):
    """Interface of a joint or force element that defines an angle between its two bodies."""

    def relative_angle(self, motions: Motions) -> Row:
        """Return the second body's angle relative to the first as a constraint row: `value` is the
        angle, rad; `jacobian` has the derivatives of the angle's rate by the bodies' velocities;
        and `bias` is its second time derivative without accelerations of the bodies, rad/s^2."""
        ...


class AbstractJointAngle(AbstractJointQuantity):
    """Base class of the angle of a joint, driver or drive torque, and of its time derivatives."""

    @override
    def joints(self, scene: Scene) -> Collection[str]:
        return elements_with_angle(scene)

    def angle(self, now: Instant) -> Row:
        """Return the `Row` whose value is the angle, rad."""
        return elements_with_angle(now.scene)[self.joint].relative_angle(now.motions)


class JointAngle(AbstractJointAngle):
    """Angle of a joint's second body relative to its first, rad in [-pi, pi], right-handed.

    - Revolute joints with or without clearance, cylindrical, screw and planar joints, and
      `Backlash`: the angle about the axis of the first body. If the axis has the same components in
      both bodies, the angle is zero while the bodies' frames are parallel. In general it is zero
      while these frames differ by the shortest rotation that makes the two axes parallel, or
      opposite if their components enclose more than 170 degrees.
    - Drivers of rotations, drive torques and torsional springs: the second body's angle about the
      element's axis, zero while the orientation of the second body relative to the first is the
      argument `orientation` of the element.
    - User-defined joints and forces with a method ``relative_angle(motions)``: the value of the
      constraint row (`clearjoint.extend.Row`) that it returns.

    A state doesn't contain the number of revolutions. ``numpy.unwrap`` recovers it from a series
    with more than two samples per revolution.

    >>> angle = cj.quantities.JointAngle("elbow")
    >>> angle.unit, angle.period == 2 * np.pi
    ('rad', True)
    """

    unit: ClassVar[str | None] = "rad"
    period: ClassVar[float | None] = 2.0 * math.pi

    @override
    def __call__(self, now: Instant) -> Scalar:
        return self.angle(now).value


class JointAngularVelocity(AbstractJointAngle):
    """Rate of a `JointAngle`, rad/s.

    While the joint's axes in both bodies are parallel, this is the relative angular velocity of the
    bodies about the axis.

    >>> speed = cj.quantities.JointAngularVelocity("crank bearing")
    """

    unit: ClassVar[str | None] = "rad/s"

    @override
    def __call__(self, now: Instant) -> Scalar:
        return row_rate(self.angle(now), now.motions)


class JointAngularAcceleration(AbstractJointAngle):
    """Second time derivative of a `JointAngle`, rad/s^2.

    >>> acceleration = cj.quantities.JointAngularAcceleration("crank pin")
    """

    unit: ClassVar[str | None] = "rad/s^2"

    @override
    def __call__(self, now: Instant) -> Scalar:
        row = self.angle(now)
        # The second time derivative of a row's value is the row's bias, the part that does not
        # depend on accelerations, plus the Jacobian times the accelerations. The ground has no
        # acceleration.
        total = row.bias
        for name, pair in row.jacobian.items():
            if name != GROUND:
                acceleration = now.dynamics.accelerations[name]
                total = add(total, pair.force.dot(acceleration.linear))
                total = add(total, pair.moment.dot(acceleration.angular))
        return total


def elements_with_angle(scene: Scene) -> dict[str, HasRelativeAngle]:
    """Return the scene's joints and forces with a method `relative_angle`."""
    elements = {**scene.joints, **scene.forces}.items()
    return {name: part for name, part in elements if isinstance(part, HasRelativeAngle)}
