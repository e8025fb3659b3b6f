"""Quantities of joints: contacts, the journal in its bearing, reactions and angles."""

import math
from collections.abc import Collection
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp

from ..fields.checks import require
from ..math.smoothing import norm_and_direction
from ..math.vectors import ZERO, Scalar, Vector
from ..model.joints.base import AbstractConstraint
from ..model.joints.clearance import BASES, ClearanceJoint
from ..model.scene import Scene
from .base import AbstractQuantity, Component, part, require_component, require_known
from .instant import Instant


class AbstractJointQuantity(AbstractQuantity):
    """A quantity of one joint."""

    joint: eqx.AbstractVar[str]

    def check(self, scene: Scene) -> None:
        """The joint must be there."""
        require_known("joint", self.joint, self.joints(scene))

    def joints(self, scene: Scene) -> Collection[str]:
        """Names of the scene's joints that have the quantity; all unless a subclass tells."""
        return scene.joints


class AbstractContactQuantity(AbstractJointQuantity):
    """A quantity of one contact of a joint, "V" say."""

    contact: eqx.AbstractVar[Any]

    def joints(self, scene: Scene) -> Collection[str]:
        """Those with contacts."""
        return scene.contact_joints()

    def check(self, scene: Scene) -> None:
        """The contact must be there, too."""
        super().check(scene)
        if self.contact is not None:
            require_known("contact", self.contact, scene.laws()[self.joint])


class ContactForce(AbstractContactQuantity):
    """Normal force of a contact of a joint, or the largest of its contacts, N."""

    joint: str = eqx.field(static=True)
    contact: str | None = eqx.field(default=None, static=True)
    unit: ClassVar[str | None] = "N"

    def __call__(self, now: Instant) -> Scalar:
        """The force."""
        family = now.contacts[self.joint]
        chosen = family.values() if self.contact is None else [family[self.contact]]
        largest: Scalar = 0.0
        for force in chosen:
            largest = jnp.maximum(largest, force.normal_force)
        return largest


class FrictionForce(AbstractContactQuantity):
    """Magnitude of the friction at a contact of a joint, N; zero without friction."""

    joint: str = eqx.field(static=True)
    contact: str = eqx.field(static=True)
    unit: ClassVar[str | None] = "N"

    def __call__(self, now: Instant) -> Scalar:
        """The force."""
        friction = now.contacts[self.joint][self.contact].friction
        return 0.0 if friction is None else norm_and_direction(friction)[0]


class Penetration(AbstractContactQuantity):
    """Penetration of a contact, m: negative in flight, so that it rises through zero at onsets."""

    joint: str = eqx.field(static=True)
    contact: str = eqx.field(static=True)
    unit: ClassVar[str | None] = "m"

    def __call__(self, now: Instant) -> Scalar:
        """The penetration."""
        return now.contacts[self.joint][self.contact].contact.gap.depth


class PenetrationRate(AbstractContactQuantity):
    """Rate of the penetration of a contact, m/s: at an onset, the entry speed."""

    joint: str = eqx.field(static=True)
    contact: str = eqx.field(static=True)
    unit: ClassVar[str | None] = "m/s"

    def __call__(self, now: Instant) -> Scalar:
        """The rate."""
        return now.contacts[self.joint][self.contact].contact.gap.rate


class EntrySpeed(AbstractContactQuantity):
    """Entry speed of a contact while it lasts, m/s; zero in flight. Of a law with memory."""

    joint: str = eqx.field(static=True)
    contact: str = eqx.field(static=True)
    unit: ClassVar[str | None] = "m/s"

    def __call__(self, now: Instant) -> Scalar:
        """The entry speed."""
        return now.memory[self.joint][self.contact]


class AbstractJournalQuantity(AbstractJointQuantity):
    """A quantity of the journal of a clearance joint, or of one of its bases, "V" or "W"."""

    unit: ClassVar[str | None] = "m"

    def joints(self, scene: Scene) -> Collection[str]:
        """The clearance joints."""
        return [name for name, j in scene.joints.items() if isinstance(j, ClearanceJoint)]

    def offset(self, now: Instant, base: str | None) -> Vector:
        """From the bearing's centre, in its frame, m."""
        joint = now.scene.joints[self.joint]
        assert isinstance(joint, ClearanceJoint)
        return joint.journal_offset(now.motions, base)


class JournalOffset(AbstractJournalQuantity):
    """Centre of a clearance joint's journal, or of one base, in the bearing's frame, m.

    Components "x" and "y" are across the bearing's axis, "z" is along it. `base` is "V" or "W".
    What a proximity probe on the bearing sees.
    """

    joint: str = eqx.field(static=True)
    component: Component = eqx.field(static=True)
    base: str | None = eqx.field(default=None, static=True)

    def __check_init__(self):
        require_component(self.component)
        _require_base(self.base)

    def __call__(self, now: Instant) -> Scalar:
        """The component."""
        return getattr(self.offset(now, self.base), self.component)


class Eccentricity(AbstractJournalQuantity):
    """Distance of the centre of a clearance joint's journal, or of one base, from the bearing's
    axis, m. `base` is "V" or "W"."""

    joint: str = eqx.field(static=True)
    base: str | None = eqx.field(default=None, static=True)

    def __check_init__(self):
        _require_base(self.base)

    def __call__(self, now: Instant) -> Scalar:
        """The distance."""
        offset = self.offset(now, self.base)
        return norm_and_direction(Vector(offset.x, offset.y, 0.0))[0]


class Multiplier(AbstractJointQuantity):
    """Multiplier of a constraint row, N or N m: of a driver, the moment it exerts.

    Joints that the coordinates eliminate have none; see `Reaction`.
    """

    joint: str = eqx.field(static=True)
    row: str = eqx.field(static=True)

    def __call__(self, now: Instant) -> Scalar:
        """The multiplier."""
        return now.dynamics.multipliers[self.joint][self.row]


class Reaction(AbstractJointQuantity):
    """Force of an ideal joint on one of its bodies, N: its magnitude, or a global component.

    That of `observe`, also where the coordinates eliminate the joint. The ground is a body here.
    Not unique, and then of least norm, where constraints are redundant.
    """

    joint: str = eqx.field(static=True)
    body: str = eqx.field(static=True)
    component: Component | None = eqx.field(default=None, static=True)
    unit: ClassVar[str | None] = "N"

    def __check_init__(self):
        require_component(self.component, magnitude=True)

    def joints(self, scene: Scene) -> Collection[str]:
        """The ideal ones."""
        return [name for name, j in scene.joints.items() if isinstance(j, AbstractConstraint)]

    def check(self, scene: Scene) -> None:
        """The body must be one of the joint's."""
        super().check(scene)
        require_known("body", self.body, scene.joints[self.joint].body_names())

    def __call__(self, now: Instant) -> Scalar:
        """The rows' directions times their multipliers."""
        dynamics, force = now.absolute_dynamics, ZERO
        for label, row in dynamics.rows[self.joint].items():
            if self.body in row.jacobian:
                multiplier = dynamics.multipliers[self.joint][label]
                force = force + row.jacobian[self.body].force * multiplier
        return part(force, self.component)


class JointAngle(AbstractJointQuantity):
    """Angle of a joint's second body about its first, rad within (-pi, pi], right-handed.

    Of a revolute, cylindrical or clearance joint: about the first body's axis, zero where both
    bodies' frames are parallel if both name the axis by the same components. Of a driver: its own.
    A joint of one's own has it if it has a method `turn` as these.
    """

    joint: str = eqx.field(static=True)
    unit: ClassVar[str | None] = "rad"
    period: ClassVar[float | None] = 2.0 * math.pi

    def joints(self, scene: Scene) -> Collection[str]:
        """Those that turn, drives among the forces included."""
        return [name for name, element in _elements(scene).items() if hasattr(element, "turn")]

    def __call__(self, now: Instant) -> Scalar:
        """The angle."""
        return _elements(now.scene)[self.joint].turn(now.motions).value


def _require_base(base: Any) -> None:
    known = (*BASES, None)
    require(base in known, "base", base, f"one of {known}", "name one of them")


def _elements(scene: Scene) -> dict[str, Any]:
    return {**scene.joints, **scene.forces}
