"""Force elements whose memory changes at periodic instants only, such as sampled controllers."""

import abc
from collections.abc import Mapping
from typing import TypeAlias

import equinox as eqx
import jax.numpy as jnp
from typing_extensions import override

from ..._math.vectors import Scalar
from ..bodies import Wrench
from .base import AbstractForce, Motions

ForceMemory: TypeAlias = Mapping[str, Scalar]
"""Memory of a sampled force: numbers by name, in SI units."""
ROUNDINGS = 8.0
"""Difference, in units of rounding error, up to which a time counts as equal to a breakpoint or
instant: an element may compute it in another order of operations."""


class Periodic(eqx.Module):
    """Equidistant instants: `offset` plus all whole multiples of `period`, s.

    >>> extend.Periodic(0.005, offset=0.001).instant(2.0)
    0.011
    """

    period: Scalar
    offset: Scalar = 0.0

    def instant(self, number: Scalar) -> Scalar:
        """Return `offset` + `number` `period`, s, the instant of a whole `number`."""
        return self.offset + number * self.period

    def latest(self, t: Scalar) -> Scalar:
        """Return the latest instant, s, that is not later than the time t, s. Here an instant that
        is later by a rounding error counts as not later."""
        # A run decides in the same way which instants are after its start. A tolerance in periods
        # would be less than rounding errors at late times, and at early ones make an instant count
        # twice.
        nearest = jnp.round((t - self.offset) / self.period)
        rounding = ROUNDINGS * jnp.finfo(jnp.result_type(float)).eps * jnp.abs(t)
        is_later = self.instant(nearest) > t + rounding
        return self.instant(jnp.where(is_later, nearest - 1.0, nearest))


class AbstractSampledForce(AbstractForce):
    """Base class of force elements with a memory that changes at periodic instants only.

    Between these instants the memory is constant. It is a part of the run's state, so that
    derivatives, sweeps and restarted runs carry it. Steps end at the instants, of which there may
    be any number. Derivatives are those of the sampled law, also by periods and offsets.

    ```python
    import clearjoint as cj

    class SampledDamper(cj.extend.AbstractSampledForce):
        body: str
        damping: float  # N s/m
        period: float  # s

        def body_names(self):
            return (self.body,)

        def instants(self):
            return {"sample": cj.extend.Periodic(self.period)}

        def initial_memory(self, motions, t):
            return {"force": -self.damping * motions[self.body].velocity.x}

        def updated_memory(self, name, memory, motions, t):
            return self.initial_memory(motions, t)

        def held_wrenches(self, memory, motions, t):
            force = cj.extend.Vector(memory["force"], 0.0, 0.0)
            return {self.body: motions[self.body].wrench(force, cj.extend.ZERO)}

    brake = SampledDamper("ball", damping=2.0, period=0.01)
    ```
    """

    @abc.abstractmethod
    def instants(self) -> dict[str, Periodic]:
        """Return the instants at which the memory changes, by name. If some of them coincide, the
        memory changes in the order of this dictionary."""

    @abc.abstractmethod
    def initial_memory(self, motions: Motions, t: Scalar) -> dict[str, Scalar]:
        """Return the memory of a run that starts at `t` in s without one. `State.memory` may give
        some or all of its numbers instead."""

    @abc.abstractmethod
    def updated_memory(
        self, name: str, memory: ForceMemory, motions: Motions, t: Scalar
    ) -> dict[str, Scalar]:
        """Return the memory after an instant: `name` is a key of `instants`, `t` its time in s."""

    @abc.abstractmethod
    def held_wrenches(self, memory: ForceMemory, motions: Motions, t: Scalar) -> dict[str, Wrench]:
        """Return the wrench on each body by name, as `AbstractForce.wrenches` does, between two
        instants. It must be smooth in time there."""

    @override
    def wrenches(self, motions: Motions, t: Scalar) -> dict[str, Wrench]:
        return self.held_wrenches(self.initial_memory(motions, t), motions, t)

    @override
    def breakpoints(self) -> tuple[()]:
        # `instants` declare the times at which the force jumps.
        return ()
