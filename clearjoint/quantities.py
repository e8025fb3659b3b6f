"""Scalar functions of an instant, for reductions and sections.

Any function of an `Instant` serves; these are values that compare equal when they mean the same,
so that using them anew compiles nothing anew.
"""

from typing import Literal

import equinox as eqx
import jax.numpy as jnp

from .instant import Instant
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


def _part(vector: Vector, component: Component | None) -> Scalar:
    return norm_and_direction(vector)[0] if component is None else getattr(vector, component)
