"""A reduction that looks at the end of a run only."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp

import clearjoint as cj


class AtEnd(cj.extend.AbstractReduction):
    """A function of the last instant of a run."""

    function: Callable[[Any], Any]
    unit: str = "1"

    def start(self, now):
        return jnp.zeros(())

    def update(self, tally, now):
        return tally

    def results(self, tally, now):
        return {"": self.function(now)}

    def units(self):
        return {"": self.unit}
