"""Laws whose damping is bounded by the elastic force or grows from zero: those of other programs,
and one that is softer on the way out."""

import equinox as eqx
import jax.numpy as jnp

from ...fields.checks import checkable, require
from ...fields.declarations import quantity
from ...fields.types import Single
from ...math.vectors import Scalar
from .gap import Gap
from .laws import AbstractElasticLaw
from .stiffness import AbstractElasticity, as_stiffness


class AbstractBoundedDampingLaw(AbstractElasticLaw):
    """An elastic force K delta^n with damping of its own, without memory or jumps."""

    exponent: eqx.AbstractVar[float]
    uses_entry_speed = False
    force_jumps = False

    def __check_init__(self):
        if (known := checkable(self.exponent)) is not None:
            (exponent,) = known
            require(exponent >= 1.0, "exponent", exponent, "at least 1", "use 1.5 for Hertz")

    def slope_jumps(self) -> bool:
        """Unless the elastic force, which bounds the damping, begins as a power above one."""
        return not self.stiffness.begins_flat(self.exponent)

    def elastic_force(self, gap: Gap) -> Scalar:
        """K delta^n, N."""
        return self.stiffness.force(gap, self.exponent)

    def stored_energy(self, gap: Gap) -> Scalar:
        """K delta^(n+1)/(n+1), J."""
        return self.stiffness.energy(gap, self.exponent)


class ElastoGap(AbstractBoundedDampingLaw):
    r"""F = K delta^n + D rate with the damping force no larger than the elastic one (Modelica's
    Translational.Components.ElastoGap): it neither jumps nor pulls. `damping` D in N s/m.

    $$F = K \delta^n + D \dot\delta, \quad |D \dot\delta| \le K \delta^n$$

    >>> law = cj.laws.ElastoGap(stiffness=1e6, damping=5e3)
    >>> print(law.force(extend.Gap(depth=1e-3, rate=0.1), None))  # N: 1000 + 500
    1500.0
    >>> print(law.force(extend.Gap(depth=1e-3, rate=1.0), None))  # twice the elastic force at most
    2000.0
    """

    stiffness: AbstractElasticity = eqx.field(converter=as_stiffness)
    damping: Single = quantity("N s/m", positive=True, zero=True)
    exponent: float = eqx.field(default=1.0, static=True)

    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        """Normal force in N."""
        del entry_speed
        elastic = self.elastic_force(gap)
        return elastic + jnp.clip(self.damping * gap.rate, -elastic, elastic)


class ImpactFunction(AbstractBoundedDampingLaw):
    r"""F = max(0, K delta^n + D(delta) rate), the IMPACT function of Adams and SolidWorks Motion.

    $$F = \max(0, K \delta^n + D s^2 (3 - 2 s) \dot\delta), \quad s = \min(\delta / d, 1)$$

    D rises from zero to `damping` (N s/m) over the `full_damping_depth` d (m), as the cubic
    s^2 (3 - 2 s) of s = delta/d.

    >>> law = cj.laws.ImpactFunction(stiffness=1e9, damping=2e3, full_damping_depth=1e-4)
    >>> print(f"{law.force(extend.Gap(depth=1e-4, rate=0.1), None):.1f}")  # N: 1000 + 200
    1200.0
    """

    stiffness: AbstractElasticity = eqx.field(converter=as_stiffness)
    damping: Single = quantity("N s/m", positive=True, zero=True)
    full_damping_depth: Single = quantity("m", positive=True, remedy="give it in m")
    exponent: float = eqx.field(default=1.5, static=True)

    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        """Normal force in N."""
        del entry_speed
        part = jnp.clip(gap.depth / self.full_damping_depth, 0.0, 1.0)
        damping = self.damping * part**2 * (3.0 - 2.0 * part)
        return jnp.maximum(self.elastic_force(gap) + damping * gap.rate, 0.0)


class FloresKelvinVoigt(AbstractBoundedDampingLaw):
    r"""F = K delta^n on the way in and c K delta^n on the way out, Flores' variant of Kelvin-Voigt.

    $$F = K \delta^n \;(\dot\delta > 0), \quad F = c K \delta^n \;(\dot\delta < 0)$$

    It delivers sqrt(c). Where the rate turns, the force goes from one to the other as a hyperbolic
    tangent of the rate over the `transition_speed` (m/s), since no step lands there; impacts that
    are hardly faster lose less.

    >>> law = cj.laws.FloresKelvinVoigt(restitution=0.81, stiffness=1e6)
    >>> print(f"{law.force(extend.Gap(depth=1e-3, rate=0.1), None):.1f}")  # N, on the way in
    1000.0
    >>> print(f"{law.force(extend.Gap(depth=1e-3, rate=-0.1), None):.1f}")  # on the way out
    810.0
    """

    restitution: Single = quantity("1", within=(0.0, 1.0), remedy="1 is elastic")
    stiffness: AbstractElasticity = eqx.field(converter=as_stiffness)
    transition_speed: Single = quantity("m/s", default=1e-3, positive=True, remedy="give m/s")
    exponent: float = eqx.field(default=1.0, static=True)

    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        """Normal force in N."""
        del entry_speed
        loading = 0.5 * (1.0 + jnp.tanh(gap.rate / self.transition_speed))
        full = self.stiffness.force(gap, self.exponent)
        return full * (self.restitution + (1.0 - self.restitution) * loading)

    def elastic_force(self, gap: Gap) -> Scalar:
        """The mean of both, N: what one is above it, the other is below."""
        return 0.5 * (1.0 + self.restitution) * super().elastic_force(gap)

    def stored_energy(self, gap: Gap) -> Scalar:
        """Its integral, J."""
        return 0.5 * (1.0 + self.restitution) * super().stored_energy(gap)

    def delivered_restitution(self) -> Scalar:
        """sqrt(c), for impacts much faster than the transition speed."""
        return jnp.sqrt(self.restitution)
