"""Normal contact laws: the force from penetration, its rate, and the memory of the impact.

All laws here are of the Hunt-Crossley family F = K delta^n (1 + chi rate/entry speed); they differ
in chi. A law of another form subclasses `AbstractContactLaw`; `clearjoint.testing.check_law` tells
whether it behaves.
"""

import abc
from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import PyTree

from ...fields.checks import concrete, require, require_positive, require_range
from ...fields.conversion import AbstractConverting
from ...fields.declarations import optional_quantity, quantity
from ...fields.types import Single
from ...math.smoothing import positive_power, ramp
from ...math.vectors import Scalar
from .gap import Gap
from .restitution import delivered_restitution
from .stiffness import AbstractStiffness, as_stiffness

UNKNOWN_ENTRY_SPEED = 1e9
"""Entry speed, m/s, given to a contact that exists before the motion starts: its impact was not
seen, so it is taken as elastic, for which an entry speed beyond all others stands."""


class AbstractContactLaw(AbstractConverting):
    """A normal force law.

    A subclass gives the force and the stored energy; a law with `has_memory` gets the entry speed
    of the present contact, found at the true onset and kept to the separation.

    `force_jumps`: whether the force may be other than zero right after the onset or before the
    separation, as that of a parallel damper is. What follows of it, derivatives above all, is then
    taken into account, for one more evaluation a step. A class that has a `force` of its own and
    says nothing is taken to jump: declare ``force_jumps = False`` for one that begins and ends at
    zero.

    ```python
    import clearjoint as cj
    import jax.numpy as jnp
    from clearjoint.testing import check_law

    class Elastomer(cj.AbstractContactLaw):
        stiffness: float  # N/m
        damping: float  # s/m
        has_memory = False
        force_jumps = False

        def elastic_force(self, gap):
            return self.stiffness * jnp.maximum(gap.depth, 0.0)

        def force(self, gap, entry_speed):
            return self.elastic_force(gap) * jnp.maximum(1.0 + self.damping * gap.rate, 0.0)

        def stored_energy(self, gap):
            return 0.5 * self.stiffness * jnp.maximum(gap.depth, 0.0) ** 2

    law = Elastomer(stiffness=1e8, damping=0.5)
    check_law(law)
    scene, state = cj.double_pendulum(law=law)
    ```
    """

    if TYPE_CHECKING:  # pyright takes equinox's for a field
        has_memory: ClassVar[bool]
    else:
        has_memory: eqx.AbstractClassVar[bool]
    force_jumps = True

    def __init_subclass__(cls, **options: object):
        super().__init_subclass__(**options)
        if "force" in cls.__dict__ and "force_jumps" not in cls.__dict__:
            cls.force_jumps = True

    @abc.abstractmethod
    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        """Normal force in N, never negative; `entry_speed` is ``None`` without memory."""

    @abc.abstractmethod
    def elastic_force(self, gap: Gap) -> Scalar:
        """The part of the force that comes from stored energy, N."""

    @abc.abstractmethod
    def stored_energy(self, gap: Gap) -> Scalar:
        """Elastic energy in J."""

    def reach(self) -> Scalar:
        """Distance ahead of the surface at which the force begins, m; 0 for an exact law."""
        return 0.0


class AbstractHertzianLaw(AbstractContactLaw):
    """F = K delta^n (1 + chi rate/entry speed), clamped at zero.

    A subclass declares the fields below and implements `damping_factor`. Its rebound of a free mass
    then has the restitution that `delivered_restitution` reports, which differs from the requested.

    - `stiffness`: an `AbstractStiffness`, or a number in N/m^n.
    - `exponent`: n, at least 1; a static field makes 1 and 1.5 cheap.
    - `smoothing`: width w in m, or ``None``. With it the penetration becomes a ramp that begins at
      delta = -w, and the clamp a ramp of relative width w/(w + delta).

    ```python
    import clearjoint as cj
    import equinox as eqx

    class Damped(cj.AbstractHertzianLaw):
        stiffness: cj.AbstractStiffness
        factor: float
        exponent: float = eqx.field(default=1.5, static=True)
        smoothing: float | None = None
        has_memory = True

        def damping_factor(self):
            return self.factor

    law = Damped(stiffness=1e9, factor=0.2)
    ```
    """

    stiffness: eqx.AbstractVar[AbstractStiffness]
    exponent: eqx.AbstractVar[float]
    smoothing: eqx.AbstractVar[Single | None]
    force_jumps = False

    @abc.abstractmethod
    def damping_factor(self) -> Scalar:
        """chi, the hysteresis damping factor times the entry speed over K."""

    @classmethod
    def field_converter(cls, name: str) -> Callable[[PyTree], PyTree]:
        """A number given as the `stiffness` is a `GivenStiffness`."""
        return as_stiffness if name == "stiffness" else super().field_converter(name)

    def __check_init__(self):
        exponent = concrete(self.exponent)
        if exponent is not None:
            least = bool(exponent >= 1.0)
            require(least, "exponent", float(exponent), "at least 1", "use 1.5 for Hertz")
        if self.smoothing is not None:
            require_positive("smoothing", self.smoothing, "give a width in m, or None")

    def reach(self) -> Scalar:
        """Distance ahead of the surface at which the force begins, m."""
        return 0.0 if self.smoothing is None else self.smoothing

    def _depth(self, gap: Gap) -> Scalar:
        return gap.depth if self.smoothing is None else ramp(gap.depth, self.smoothing)

    def elastic_force(self, gap: Gap) -> Scalar:
        """K delta^n, the force without damping, N."""
        return self.stiffness.value(gap) * positive_power(self._depth(gap), self.exponent)

    def stored_energy(self, gap: Gap) -> Scalar:
        """K delta^(n+1)/(n+1), J; with smoothing, the integral over the ramp as well."""
        n, w = self.exponent, self.smoothing
        stiffness = self.stiffness.value(gap)
        if w is None:
            return stiffness * positive_power(gap.depth, n + 1) / (n + 1)
        inside = jnp.clip(gap.depth, -w, w) + w
        below = positive_power(inside, 2 * n + 1) / ((4 * w) ** n * (2 * n + 1))
        above = (positive_power(jnp.maximum(gap.depth, w), n + 1) - w ** (n + 1)) / (n + 1)
        return stiffness * (below + above)

    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        """Normal force in N (eq. 24)."""
        if entry_speed is None:
            return self.elastic_force(gap)
        factor = 1.0 + self.damping_factor() * gap.rate / entry_speed
        return self.elastic_force(gap) * ramp(factor, self._clamp_width(gap))

    def _clamp_width(self, gap: Gap) -> Scalar | None:
        if self.smoothing is None:
            return None
        return self.smoothing / (self.smoothing + jnp.maximum(gap.depth, 0.0))

    def delivered_restitution(self) -> Scalar:
        """Rebound over entry speed of a free impact, by the exact relation."""
        return delivered_restitution(self.damping_factor())


class Hertz(AbstractHertzianLaw):
    """Purely elastic contact, F = K delta^n (H. Hertz 1881). Keeps no memory."""

    stiffness: AbstractStiffness = eqx.field(converter=as_stiffness)
    exponent: float = eqx.field(default=1.5, static=True)
    smoothing: Single | None = optional_quantity("m")
    has_memory = False

    def damping_factor(self) -> Scalar:
        """chi = 0: nothing is lost."""
        return 0.0


class MemorylessHuntCrossley(AbstractHertzianLaw):
    """F = K delta^n (1 + a rate) with a given damping a (K. H. Hunt, F. R. E. Crossley 1975).

    Keeps no memory: a = 3 (1 - c)/(2 v) is what `HuntCrossley` has at one entry speed v, the
    `design_speed`, m/s. There the `restitution` c is requested, and the one that
    `delivered_restitution` reports is delivered. Slower impacts lose less and faster ones more, as
    metals do, and a contact that begins slowly isn't stiff.
    """

    restitution: Single = quantity("1", within=(0.0, 1.0), remedy="1 is elastic, 0 is plastic")
    stiffness: AbstractStiffness = eqx.field(converter=as_stiffness)
    design_speed: Single = quantity(
        "m/s", positive=True, remedy="give a typical entry speed in m/s"
    )
    exponent: float = eqx.field(default=1.5, static=True)
    smoothing: Single | None = optional_quantity("m")
    has_memory = False
    force_jumps = False

    def damping_factor(self) -> Scalar:
        """chi = 3 (1 - c)/2, at the design speed."""
        return 1.5 * (1.0 - self.restitution)

    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        """Normal force in N, with the damping of the design speed at every entry speed."""
        return super().force(gap, self.design_speed)


class AbstractDampedLaw(AbstractHertzianLaw):
    """A law of the family with a requested restitution and a floor on the entry speed.

    Its fields are those of all such laws; a subclass says the `damping_factor`. At low entry speed
    the damping term diverges: `entry_speed_floor` (m/s) bounds it from below.

    ```python
    import clearjoint as cj

    class Gonthier(cj.AbstractDampedLaw):
        def damping_factor(self):
            return (1.0 - self.restitution**2) / self.restitution

    law = Gonthier(restitution=0.8, stiffness=cj.RavnStiffness(207e9, 0.3))
    ```
    """

    restitution: Single = quantity("1")
    stiffness: AbstractStiffness = eqx.field(converter=as_stiffness)
    exponent: float = eqx.field(default=1.5, static=True)
    entry_speed_floor: Single = quantity("m/s", default=1e-6)
    smoothing: Single | None = optional_quantity("m")
    has_memory = True
    force_jumps = False

    def __check_init__(self):
        require_range("restitution", self.restitution, 0.0, 1.0, "1 is elastic, 0 is plastic")
        require_positive(
            "entry_speed_floor", self.entry_speed_floor, "give a small speed in m/s, e.g. 1e-6"
        )

    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        """Normal force in N, with the entry speed floored."""
        assert entry_speed is not None
        return super().force(gap, jnp.maximum(entry_speed, self.entry_speed_floor))


class HuntCrossley(AbstractDampedLaw):
    """chi = 3 (1 - c)/2 (K. H. Hunt, F. R. E. Crossley 1975)."""

    def damping_factor(self) -> Scalar:
        """chi = 3 (1 - c)/2."""
        return 1.5 * (1.0 - self.restitution)


class LankaraniNikravesh(AbstractDampedLaw):
    """chi = 3 (1 - c^2)/4, the paper's law (eq. 24; H. M. Lankarani, P. E. Nikravesh 1990)."""

    def damping_factor(self) -> Scalar:
        """chi = 3 (1 - c^2)/4."""
        return 0.75 * (1.0 - self.restitution**2)


class Flores2011(AbstractDampedLaw):
    """chi = 8 (1 - c)/(5 c), for the whole range of restitution but 0 (P. Flores et al. 2011)."""

    def __check_init__(self):
        restitution = concrete(self.restitution)
        if restitution is not None:
            require(
                bool(restitution > 0),
                "restitution",
                float(restitution),
                "positive for this law",
                "its damping is infinite at 0; use a small value such as 0.01",
            )

    def damping_factor(self) -> Scalar:
        """chi = 8 (1 - c)/(5 c)."""
        return 1.6 * (1.0 - self.restitution) / self.restitution


def contact_normal_force(law: AbstractContactLaw, gap: Gap, entry_speed: Scalar | None) -> Scalar:
    """Normal force of a contact, N. Without an entry speed on record (memory zero) the present rate
    stands for it, which it is at the onset."""
    if law.has_memory:
        assert entry_speed is not None
        entry_speed = jnp.where(entry_speed > 0.0, entry_speed, gap.rate)
    return law.force(gap, entry_speed)
