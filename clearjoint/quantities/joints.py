"""Quantities of joints: contacts, the journal in its bearing, reactions and angles."""

import math
from collections.abc import Collection
from typing import ClassVar, Protocol, runtime_checkable

import equinox as eqx
import jax.numpy as jnp

from ..fields.checks import require
from ..math.smoothing import norm_and_direction
from ..math.vectors import ZERO, Scalar, Vector
from ..model.bodies import NO_WRENCH, Wrench
from ..model.clearance_joints.journal_bases import BASES, HasJournal
from ..model.joints.base import AbstractConstraint, AbstractContactJoint, Motions, Row
from ..model.scene import Scene
from .base import (
    AbstractQuantity,
    Axes,
    Component,
    part,
    require_axes,
    require_component,
    require_known,
)
from .instant import Instant


class AbstractJointQuantity(AbstractQuantity):
    """A quantity of one joint, `joint` by name."""

    joint: eqx.AbstractVar[str]

    def check(self, scene: Scene) -> None:
        """Check that the scene has a joint of this name that has the quantity."""
        require_known("joint", self.joint, self.joints(scene))

    def joints(self, scene: Scene) -> Collection[str]:
        """Names of the scene's joints that have the quantity; all unless a subclass overrides
        it."""
        return scene.joints


class AbstractContactQuantity(AbstractJointQuantity):
    """A quantity of one contact of a joint, `contact` by name, "V" say."""

    contact: eqx.AbstractVar[str | None]

    def joints(self, scene: Scene) -> Collection[str]:
        """Names of the joints with contacts."""
        return scene.contact_joints()

    def check(self, scene: Scene) -> None:
        """Check that the scene has the joint, and the joint the contact."""
        super().check(scene)
        if self.contact is not None:
            require_known("contact", self.contact, scene.laws()[self.joint])


class ContactForce(AbstractContactQuantity):
    """Normal force of a contact of a joint, N; without `contact` the largest of the joint's.

    >>> largest = cj.quantities.ContactForce("shoulder")
    >>> base = cj.quantities.ContactForce("shoulder", "V")
    >>> base.unit
    'N'
    """

    joint: str = eqx.field(static=True)
    contact: str | None = eqx.field(default=None, static=True)
    unit: ClassVar[str | None] = "N"

    def __call__(self, now: Instant) -> Scalar:
        """The normal force, N."""
        contacts = now.contacts[self.joint]
        forces = contacts.values() if self.contact is None else [contacts[self.contact]]
        largest: Scalar = 0.0
        for force in forces:
            largest = jnp.maximum(largest, force.normal_force)
        return largest


class FrictionForce(AbstractContactQuantity):
    """Magnitude of the friction at a contact of a joint, N; zero without friction.

    >>> quantity = cj.quantities.FrictionForce("shoulder", "V")
    >>> quantity.unit
    'N'
    """

    joint: str = eqx.field(static=True)
    contact: str = eqx.field(static=True)
    unit: ClassVar[str | None] = "N"

    def __call__(self, now: Instant) -> Scalar:
        """The magnitude of the friction force, N."""
        friction = now.contacts[self.joint][self.contact].friction
        return 0.0 if friction is None else norm_and_direction(friction)[0]


class Penetration(AbstractContactQuantity):
    """Penetration of a contact, m: negative in flight, so that it rises through zero at onsets.

    >>> quantity = cj.quantities.Penetration("shoulder", "V")
    >>> quantity.unit
    'm'
    """

    joint: str = eqx.field(static=True)
    contact: str = eqx.field(static=True)
    unit: ClassVar[str | None] = "m"

    def __call__(self, now: Instant) -> Scalar:
        """The penetration, m; negative in flight."""
        return now.contacts[self.joint][self.contact].contact.gap.depth


class PenetrationRate(AbstractContactQuantity):
    """Rate of the penetration of a contact, m/s: at an onset, the entry speed.

    >>> quantity = cj.quantities.PenetrationRate("shoulder", "V")
    >>> quantity.unit
    'm/s'
    """

    joint: str = eqx.field(static=True)
    contact: str = eqx.field(static=True)
    unit: ClassVar[str | None] = "m/s"

    def __call__(self, now: Instant) -> Scalar:
        """The rate of the penetration, m/s; positive while the bodies approach."""
        return now.contacts[self.joint][self.contact].contact.gap.rate


class EntrySpeed(AbstractContactQuantity):
    """Speed at which a contact closed, m/s, while it lasts; zero in flight. Only contacts whose law
    uses its entry speed have it.

    >>> quantity = cj.quantities.EntrySpeed("shoulder", "V")
    >>> quantity.unit
    'm/s'
    """

    joint: str = eqx.field(static=True)
    contact: str = eqx.field(static=True)
    unit: ClassVar[str | None] = "m/s"

    def __call__(self, now: Instant) -> Scalar:
        """The entry speed, m/s; zero in flight."""
        return now.entry_speeds[self.joint][self.contact]


class BristleDeflection(AbstractContactQuantity):
    """Size of the deflection of a contact's bristles, m; zero in flight. Only contacts whose
    friction is an `AbstractBristleFriction` have it.

    >>> deflection = cj.quantities.BristleDeflection("shoulder", "V")
    >>> deflection.check(cj.mechanisms.double_pendulum(friction=cj.frictions.Dahl(0.1))[0])
    """

    joint: str = eqx.field(static=True)
    contact: str = eqx.field(static=True)
    unit: ClassVar[str | None] = "m"

    def joints(self, scene: Scene) -> Collection[str]:
        """Names of the joints with bristles."""
        return scene.bristle_laws()

    def check(self, scene: Scene) -> None:
        """Check that the scene has the joint, and that the contact has bristles."""
        super().check(scene)
        require_known("contact", self.contact, scene.bristle_laws()[self.joint])

    def __call__(self, now: Instant) -> Scalar:
        """The size of the deflection, m."""
        return norm_and_direction(now.bristles[self.joint][self.contact])[0]


class AbstractJournalQuantity(AbstractJointQuantity):
    """A quantity of the journal of a clearance joint, or of one of its bases, "V" or "W"."""

    unit: ClassVar[str | None] = "m"

    def joints(self, scene: Scene) -> Collection[str]:
        """Names of the clearance joints."""
        return [name for name, j in scene.joints.items() if isinstance(j, HasJournal)]

    def offset(self, now: Instant, base: str | None) -> Vector:
        """Vector from the bearing's centre to the journal's, or to that of a base, in the bearing's
        frame, m."""
        joint = now.scene.joints[self.joint]
        assert isinstance(joint, HasJournal)
        return joint.journal_offset(now.motions, base)


class JournalOffset(AbstractJournalQuantity):
    """Centre of a clearance joint's journal, or of one base, in the bearing's frame, m.

    Components "x" and "y" are across the bearing's axis, "z" is along it. `base` is "V" or "W".
    What a proximity probe on the bearing sees.

    >>> probes = {axis: cj.quantities.JournalOffset("shoulder", axis) for axis in ("x", "y")}
    >>> probes["x"].unit
    'm'
    """

    joint: str = eqx.field(static=True)
    component: Component = eqx.field(static=True)
    base: str | None = eqx.field(default=None, static=True)

    def __check_init__(self):
        require_component(self.component)
        _require_base(self.base)

    def __call__(self, now: Instant) -> Scalar:
        """The component of the offset, m."""
        return getattr(self.offset(now, self.base), self.component)


class Eccentricity(AbstractJournalQuantity):
    """Distance of the centre of a clearance joint's journal, or of one base, from the bearing's
    axis, m. `base` is "V" or "W".

    >>> eccentricity = cj.quantities.Eccentricity("shoulder", base="V")
    >>> eccentricity.check(cj.mechanisms.double_pendulum()[0])  # is there such a joint?
    """

    joint: str = eqx.field(static=True)
    base: str | None = eqx.field(default=None, static=True)

    def __check_init__(self):
        _require_base(self.base)

    def __call__(self, now: Instant) -> Scalar:
        """The distance from the bearing's axis, m."""
        offset = self.offset(now, self.base)
        return norm_and_direction(Vector(offset.x, offset.y, 0.0))[0]


class Multiplier(AbstractJointQuantity):
    """Multiplier of a constraint row, N or N m: of a driver, the moment it exerts.

    Joints that the coordinates eliminate have none; see `Reaction`.

    >>> torque = cj.quantities.Multiplier("motor", "angle")
    >>> torque.check(cj.mechanisms.slider_crank()[0])  # is there such a row?
    """

    joint: str = eqx.field(static=True)
    row: str = eqx.field(static=True)

    def __call__(self, now: Instant) -> Scalar:
        """The multiplier of the row, N or N m."""
        return now.dynamics.multipliers[self.joint][self.row]


class AbstractReaction(AbstractJointQuantity):
    """What a joint does to one of its bodies, `body` by name; the ground is a body here."""

    body: eqx.AbstractVar[str]

    def check(self, scene: Scene) -> None:
        """Check that the scene has the joint, and that the joint holds the body."""
        super().check(scene)
        require_known("body", self.body, scene.joints[self.joint].body_names())

    def constraint_wrench(self, now: Instant) -> Wrench:
        """What the joint's constraints do: the sum of the rows' directions times their
        multipliers."""
        dynamics, wrench = now.absolute_dynamics, NO_WRENCH
        for label, row in dynamics.rows[self.joint].items():
            if self.body in row.jacobian:
                pair, multiplier = row.jacobian[self.body], dynamics.multipliers[self.joint][label]
                wrench = wrench + Wrench(pair.force * multiplier, pair.moment * multiplier)
        return wrench


class Reaction(AbstractReaction):
    """Force of a joint on one of its bodies, N: its magnitude, or a global component.

    Of an ideal joint that of `observe`, also where the coordinates eliminate the joint; not unique,
    and then of least norm, where constraints are redundant. Of a joint with clearance the sum of
    its contacts' normal forces and friction, of its film's force and of what holds it axially. The
    ground is a body here.

    ```python
    import clearjoint as cj

    load = cj.quantities.Reaction("shoulder", "arm 2")
    outputs = {"largest load": cj.Peak(load, "N")}
    ```

    **Arguments:** `joint`, `body`: names; `component`: "x", "y", "z", or ``None`` for the
    magnitude.

    >>> force = cj.quantities.Reaction("elbow", "arm 3")
    >>> force.unit
    'N'
    """

    joint: str = eqx.field(static=True)
    body: str = eqx.field(static=True)
    component: Component | None = eqx.field(default=None, static=True)
    unit: ClassVar[str | None] = "N"

    def __check_init__(self):
        require_component(self.component, magnitude=True)

    def __call__(self, now: Instant) -> Scalar:
        """The force, N."""
        joint, force = now.scene.joints[self.joint], ZERO
        if isinstance(joint, AbstractContactJoint):
            force = self._contact_force(joint, now)
        if joint.rows(now.motions, now.time):
            force = force + self.constraint_wrench(now).force
        return part(force, self.component)

    def _contact_force(self, joint: AbstractContactJoint, now: Instant) -> Vector:
        """Of the contacts and the film on the body, N, global."""
        on_second = ZERO
        for loaded in now.contacts[self.joint].values():
            if loaded.contact.turning is None:
                on_second = on_second - loaded.contact.normal * loaded.normal_force
                on_second = on_second if loaded.friction is None else on_second + loaded.friction
        of_film = joint.film_wrenches(now.motions).get(self.body, NO_WRENCH).force
        return (on_second if self.body == joint.pair()[1] else -on_second) + of_film


class ReactionMoment(AbstractReaction):
    """Moment of an ideal joint on one of its bodies about the joint's point on it, N m: its
    magnitude, or a component. Of a driver the driving moment.

    Unique where the `Reaction` is.

    ```python
    import clearjoint as cj

    bending = cj.quantities.ReactionMoment("elbow", "arm 3", "x", axes="body")
    ```

    **Arguments:** `joint`, `body`: names; `component`: "x", "y", "z", or ``None`` for the
    magnitude; `axes`: "global" or "body", in which the component is taken.

    **Raises:** `ValueError` for other components or axes.
    """

    joint: str = eqx.field(static=True)
    body: str = eqx.field(static=True)
    component: Component | None = eqx.field(default=None, static=True)
    axes: Axes = eqx.field(default="global", static=True)
    unit: ClassVar[str | None] = "N m"

    def __check_init__(self):
        require_component(self.component, magnitude=True)
        require_axes(self.axes)

    def joints(self, scene: Scene) -> Collection[str]:
        """Names of the ideal joints."""
        return [name for name, j in scene.joints.items() if isinstance(j, AbstractConstraint)]

    def __call__(self, now: Instant) -> Scalar:
        """The moment, N m."""
        wrench, motion = self.constraint_wrench(now), now.motions[self.body]
        moment = wrench.moment
        for _, body, point in now.scene.joints[self.joint].attachments():
            if body == self.body:
                moment = moment - point.cross(motion.components(wrench.force))
        return part(moment if self.axes == "body" else motion.direction(moment), self.component)


class JointAngle(AbstractJointQuantity):
    """Angle of a joint's second body about its first, rad within (-pi, pi], right-handed.

    - Of a revolute, cylindrical or clearance joint: about the axis in the first body. It is zero
      where the bodies' frames are parallel, if the axis has the same components in both.
    - Of a driver or a drive torque: the angle that it drives.
    - Of a joint of one's own: if it has a method ``turn(motions)`` like these.

    Of a series that is saved often enough ``numpy.unwrap`` counts the revolutions; a state does not
    hold their number.

    >>> angle = cj.quantities.JointAngle("elbow")
    >>> angle.unit, angle.period == 2 * np.pi
    ('rad', True)
    """

    joint: str = eqx.field(static=True)
    unit: ClassVar[str | None] = "rad"
    period: ClassVar[float | None] = 2.0 * math.pi

    def joints(self, scene: Scene) -> Collection[str]:
        """Names of the joints and forces that have an angle."""
        return turning_elements(scene)

    def __call__(self, now: Instant) -> Scalar:
        """The angle, rad within (-pi, pi]."""
        return turning_elements(now.scene)[self.joint].relative_angle(now.motions).value


@runtime_checkable
class Turning(Protocol):
    """A joint or a force that has an angle."""

    def relative_angle(self, motions: Motions) -> Row:
        """The angle, rad."""
        ...


def _require_base(base: str | None) -> None:
    known = (*BASES, None)
    require(base in known, "base", base, f"one of {known}", "name one of them")


def turning_elements(scene: Scene) -> dict[str, Turning]:
    """The joints and forces that have an angle."""
    elements = {**scene.joints, **scene.forces}
    return {name: one for name, one in elements.items() if isinstance(one, Turning)}
