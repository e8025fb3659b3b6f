"""A force that begins at an instant."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp

import clearjoint as cj
from clearjoint.extend import ZERO, Vector, Wrench, optional_quantity, quantity


class Push(cj.extend.AbstractForce):
    """A force along X on a body from a time on, growing from there by `slope`; `how` compares the
    times in several ways."""

    body: str = eqx.field(static=True)
    force: Any = quantity("N")
    start: Any = quantity("s")
    how: Any = eqx.field(default=jnp.greater_equal, static=True)
    slope: Any = optional_quantity("N/s")

    def body_names(self):
        return (self.body,)

    def breakpoints(self):
        return self.start

    def wrenches(self, motions, t):
        growth = 0.0 if self.slope is None else self.slope * (t - self.start)
        force = jnp.where(self.how(t, self.start), self.force + growth, 0.0)
        return {self.body: Wrench(Vector(force, 0.0, 0.0), ZERO)}
