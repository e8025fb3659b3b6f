"""Normal contact laws: the force from penetration, its rate, and the memory of the impact.

All laws here are of the Hunt-Crossley family F = K delta^n (1 + chi rate/entry speed); they differ
in chi. A law of another form subclasses `AbstractContactLaw`; `clearjoint.testing.check_law` tells
whether it behaves.
"""

import abc
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from .fields import (
    as_number,
    concrete,
    optional_quantity,
    quantity,
    require,
    require_positive,
    require_range,
)
from .readable import AbstractReadable
from .restitution import delivered_restitution
from .smoothing import positive_power, ramp
from .vectors import Scalar, Vector

UNKNOWN_ENTRY_SPEED = 1e9
"""Entry speed, m/s, given to a contact that exists before the motion starts: its impact was not
seen, so it is taken as elastic, for which an entry speed beyond all others stands."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True, slots=True)
class Gap:
    """All that a law may know of a contact.

    `depth`: penetration, m, negative in flight (eq. 13); `rate`: its time derivative, m/s (eq. 21);
    `bearing_radius` and radial `clearance`: m (``None`` for flat surfaces). The clearance is given,
    and not the journal's radius, since a difference of radii would spoil its last digits.
    """

    depth: Scalar
    rate: Scalar
    bearing_radius: Scalar | None = None
    clearance: Scalar | None = None

    @property
    def journal_radius(self) -> Scalar:
        """Bearing radius less clearance, m."""
        assert self.bearing_radius is not None and self.clearance is not None
        return self.bearing_radius - self.clearance


class AbstractStiffness(AbstractReadable):
    """The generalised stiffness K of a law."""

    @abc.abstractmethod
    def value(self, gap: Gap) -> Scalar:
        """K in N/m^n."""


class GivenStiffness(AbstractStiffness):
    """A stiffness known from elsewhere, N/m^n."""

    stiffness: Any = quantity("N/m^n")

    def __check_init__(self):
        require_positive("stiffness", self.stiffness, "give K in N/m^n")

    def value(self, gap: Gap) -> Scalar:
        """K in N/m^n."""
        return self.stiffness


class RavnStiffness(AbstractStiffness):
    """Internal contact of two spherical surfaces (P. Ravn 1998; Flores et al. 2006, section 4).

    K = 4/(3 (s_i + s_j)) sqrt(R_i R_j/(R_i - R_j)) with s = (1 - nu^2)/E. It follows the radii, so
    that a swept clearance changes it.

    **Arguments:** Young's moduli in Pa and Poisson's ratios of bearing and journal; the journal's
    are the bearing's unless given.
    """

    young_modulus: Any = quantity("Pa")
    poisson_ratio: Any = quantity("1")
    journal_young_modulus: Any = optional_quantity("Pa")
    journal_poisson_ratio: Any = optional_quantity("1")

    def __check_init__(self):
        require_positive("young_modulus", self.young_modulus, "give E in Pa")
        require_range("poisson_ratio", self.poisson_ratio, -1.0, 0.5, "give nu of the material")
        if self.journal_young_modulus is not None:
            require_positive("journal_young_modulus", self.journal_young_modulus, "give E in Pa")
        if self.journal_poisson_ratio is not None:
            require_range("journal_poisson_ratio", self.journal_poisson_ratio, -1.0, 0.5, "give nu")

    def value(self, gap: Gap) -> Scalar:
        """K in N/m^1.5."""
        assert gap.bearing_radius is not None and gap.clearance is not None
        modulus = self.journal_young_modulus
        ratio = self.journal_poisson_ratio
        modulus = self.young_modulus if modulus is None else modulus
        ratio = self.poisson_ratio if ratio is None else ratio
        compliance = (1 - self.poisson_ratio**2) / self.young_modulus + (1 - ratio**2) / modulus
        radii = gap.bearing_radius * gap.journal_radius
        return 4.0 / (3.0 * compliance) * jnp.sqrt(radii / gap.clearance)


def _as_stiffness(value: Any) -> AbstractStiffness:
    return value if isinstance(value, AbstractStiffness) else GivenStiffness(as_number(value))


class AbstractContactLaw(AbstractReadable):
    """A normal force law.

    A subclass gives the force and the stored energy; a law with `has_memory` gets the entry speed
    of the present contact, found at the true onset and kept to the separation.

    `force_jumps`: whether the force may be other than zero right after the onset or before the
    separation, as that of a parallel damper is. What follows of it, derivatives above all, is then
    taken into account, for one more evaluation a step. A class that has a `force` of its own and
    says nothing is taken to jump: declare ``force_jumps = False`` for one that begins and ends at
    zero.
    """

    has_memory: eqx.AbstractClassVar[bool]
    force_jumps = True

    def __init_subclass__(cls, **options: Any):
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
    - `exponent`: n, at least 1.
    - `smoothing`: width w in m, or ``None``. With it the penetration becomes a ramp that begins at
      delta = -w, and the clamp a ramp of relative width w/(w + delta).
    """

    stiffness: eqx.AbstractVar[AbstractStiffness]
    exponent: eqx.AbstractVar[float]
    smoothing: eqx.AbstractVar[Any]
    force_jumps = False

    @abc.abstractmethod
    def damping_factor(self) -> Scalar:
        """chi, the hysteresis damping factor times the entry speed over K."""

    def __check_init__(self):
        require(self.exponent >= 1.0, "exponent", self.exponent, "at least 1", "use 1.5 for Hertz")
        if self.smoothing is not None:
            require_positive("smoothing", self.smoothing, "give a width in m, or None")

    def reach(self) -> Scalar:
        """Distance ahead of the surface at which the force begins, m."""
        return 0.0 if self.smoothing is None else self.smoothing

    def _depth(self, gap: Gap) -> Scalar:
        return gap.depth if self.smoothing is None else ramp(gap.depth, self.smoothing)

    def elastic_force(self, gap: Gap) -> Scalar:
        """K delta^n, N."""
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

    stiffness: AbstractStiffness = eqx.field(converter=_as_stiffness)
    exponent: float = eqx.field(default=1.5, static=True)
    smoothing: Any = optional_quantity("m")
    has_memory = False

    def damping_factor(self) -> Scalar:
        """chi = 0."""
        return 0.0


class MemorylessHuntCrossley(AbstractHertzianLaw):
    """F = K delta^n (1 + a rate) with a given damping a (K. H. Hunt, F. R. E. Crossley 1975).

    Keeps no memory: a = 3 (1 - c)/(2 v) is what `HuntCrossley` has at one entry speed v, the
    `design_speed`, m/s. There the `restitution` c is requested, and the one that
    `delivered_restitution` reports is delivered. Slower impacts lose less and faster ones more, as
    metals do, and a contact that begins slowly isn't stiff.
    """

    restitution: Any = quantity("1")
    stiffness: AbstractStiffness = eqx.field(converter=_as_stiffness)
    design_speed: Any = quantity("m/s")
    exponent: float = eqx.field(default=1.5, static=True)
    smoothing: Any = optional_quantity("m")
    has_memory = False
    force_jumps = False

    def __check_init__(self):
        require_range("restitution", self.restitution, 0.0, 1.0, "1 is elastic, 0 is plastic")
        require_positive("design_speed", self.design_speed, "give a typical entry speed in m/s")

    def damping_factor(self) -> Scalar:
        """chi = 3 (1 - c)/2, at the design speed."""
        return 1.5 * (1.0 - self.restitution)

    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        """Normal force in N; an entry speed is not looked at."""
        return super().force(gap, self.design_speed)


class AbstractDampedLaw(AbstractHertzianLaw):
    """A law of the family with a requested restitution and a floor on the entry speed.

    At low entry speed the damping term diverges: `entry_speed_floor` (m/s) bounds it from below.
    """

    restitution: eqx.AbstractVar[Any]
    entry_speed_floor: eqx.AbstractVar[Any]
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

    restitution: Any = quantity("1")
    stiffness: AbstractStiffness = eqx.field(converter=_as_stiffness)
    exponent: float = eqx.field(default=1.5, static=True)
    entry_speed_floor: Any = quantity("m/s", default=1e-6)
    smoothing: Any = optional_quantity("m")

    def damping_factor(self) -> Scalar:
        """chi = 3 (1 - c)/2."""
        return 1.5 * (1.0 - self.restitution)


class LankaraniNikravesh(AbstractDampedLaw):
    """chi = 3 (1 - c^2)/4, the paper's law (eq. 24; H. M. Lankarani, P. E. Nikravesh 1990)."""

    restitution: Any = quantity("1")
    stiffness: AbstractStiffness = eqx.field(converter=_as_stiffness)
    exponent: float = eqx.field(default=1.5, static=True)
    entry_speed_floor: Any = quantity("m/s", default=1e-6)
    smoothing: Any = optional_quantity("m")

    def damping_factor(self) -> Scalar:
        """chi = 3 (1 - c^2)/4."""
        return 0.75 * (1.0 - self.restitution**2)


class Flores2011(AbstractDampedLaw):
    """chi = 8 (1 - c)/(5 c), for the whole range of restitution but 0 (P. Flores et al. 2011)."""

    restitution: Any = quantity("1")
    stiffness: AbstractStiffness = eqx.field(converter=_as_stiffness)
    exponent: float = eqx.field(default=1.5, static=True)
    entry_speed_floor: Any = quantity("m/s", default=1e-6)
    smoothing: Any = optional_quantity("m")

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


def slip_velocity(relative: Vector, normal: Vector, rate: Scalar) -> Vector:
    """The tangential part of a relative velocity, m/s."""
    return relative - normal * rate
