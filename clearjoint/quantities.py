"""Scalar functions of an instant, for reductions and sections.

Any function of an `Instant` serves; these are values that compare equal when they mean the same,
so that using them anew compiles nothing anew.
"""

from typing import Literal

import equinox as eqx
import jax.numpy as jnp

from .instant import Instant
from .joints.clearance import ClearanceJoint
from .smoothing import norm_and_direction
from .vectors import Scalar, Vector

Component = Literal["x", "y", "z"]


class ContactForce(eqx.Module):
    """Normal force of a contact of a joint, or the largest of its contacts, N."""

    joint: str = eqx.field(static=True)
    contact: str | None = eqx.field(default=None, static=True)

    def __call__(self, now: Instant) -> Scalar:
        """The force."""
        family = now.contacts[self.joint]
        chosen = family.values() if self.contact is None else [family[self.contact]]
        largest: Scalar = 0.0
        for force in chosen:
            largest = jnp.maximum(largest, force.normal_force)
        return largest


class Penetration(eqx.Module):
    """Penetration of a contact, m: negative in flight, so that it rises through zero at onsets."""

    joint: str = eqx.field(static=True)
    contact: str = eqx.field(static=True)

    def __call__(self, now: Instant) -> Scalar:
        """The penetration."""
        return now.contacts[self.joint][self.contact].contact.gap.depth


class PenetrationRate(eqx.Module):
    """Rate of the penetration of a contact, m/s: at an onset, the entry speed."""

    joint: str = eqx.field(static=True)
    contact: str = eqx.field(static=True)

    def __call__(self, now: Instant) -> Scalar:
        """The rate."""
        return now.contacts[self.joint][self.contact].contact.gap.rate


class EntrySpeed(eqx.Module):
    """Entry speed of a contact of a joint while it lasts, m/s; zero in flight."""

    joint: str = eqx.field(static=True)
    contact: str = eqx.field(static=True)

    def __call__(self, now: Instant) -> Scalar:
        """The entry speed."""
        return now.memory[self.joint][self.contact]


class JournalOffset(eqx.Module):
    """Centre of a clearance joint's journal, or of one base, in the bearing's frame, m.

    Components "x" and "y" are across the bearing's axis, "z" is along it. `base` is "V" or "W".
    """

    joint: str = eqx.field(static=True)
    component: Component = eqx.field(static=True)
    base: str | None = eqx.field(default=None, static=True)

    def __call__(self, now: Instant) -> Scalar:
        """The component."""
        return getattr(_journal_offset(now, self.joint, self.base), self.component)


class Eccentricity(eqx.Module):
    """Distance of the centre of a clearance joint's journal, or of one base, from the bearing's
    axis, m. `base` is "V" or "W"."""

    joint: str = eqx.field(static=True)
    base: str | None = eqx.field(default=None, static=True)

    def __call__(self, now: Instant) -> Scalar:
        """The distance."""
        offset = _journal_offset(now, self.joint, self.base)
        return norm_and_direction(Vector(offset.x, offset.y, 0.0))[0]


class Acceleration(eqx.Module):
    """Acceleration of a body's centre of mass, m/s^2: its magnitude, or a global component."""

    body: str = eqx.field(static=True)
    component: Component | None = eqx.field(default=None, static=True)

    def __call__(self, now: Instant) -> Scalar:
        """The acceleration."""
        return _part(now.dynamics.accelerations[self.body].linear, self.component)


class Position(eqx.Module):
    """Global coordinate of a body's centre of mass, m."""

    body: str = eqx.field(static=True)
    component: Component = eqx.field(static=True)

    def __call__(self, now: Instant) -> Scalar:
        """The coordinate."""
        return getattr(now.motions[self.body].position, self.component)


class Velocity(eqx.Module):
    """Velocity of a body's centre of mass, m/s: its magnitude, or a global component."""

    body: str = eqx.field(static=True)
    component: Component | None = eqx.field(default=None, static=True)

    def __call__(self, now: Instant) -> Scalar:
        """The velocity."""
        return _part(now.motions[self.body].velocity, self.component)


class Multiplier(eqx.Module):
    """Multiplier of a constraint row, N or N m: of a driver, the moment it exerts."""

    joint: str = eqx.field(static=True)
    row: str = eqx.field(static=True)

    def __call__(self, now: Instant) -> Scalar:
        """The multiplier."""
        return now.dynamics.multipliers[self.joint][self.row]


def _journal_offset(now: Instant, name: str, base: str | None) -> Vector:
    joint = now.scene.joints[name]
    assert isinstance(joint, ClearanceJoint)
    return joint.journal_offset(now.motions, base)


def _part(vector: Vector, component: Component | None) -> Scalar:
    return norm_and_direction(vector)[0] if component is None else getattr(vector, component)
