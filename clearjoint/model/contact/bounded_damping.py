"""Contact laws with bounded damping, as used in multibody programs.

The force is an elastic force, usually K delta^n with the penetration delta, m, and a damping that
acts with the penetration's rate, m/s. The damping is limited, so that the force starts and ends at
zero.
"""

import equinox as eqx
import jax.numpy as jnp

from ...fields.declarations import quantity
from ...fields.types import Single
from ...math.vectors import Scalar
from .gap import Gap
from .laws import AbstractElasticity, AbstractPowerLaw, as_stiffness, require_exponent


class AbstractBoundedDampingLaw(AbstractPowerLaw):
    """Base class of laws with the elastic force K delta^n and a damping that a subclass defines.

    The force must not jump at the onset of a contact, and does not use the entry speed, the rate at
    the onset.

    **Raises:** `ValueError` if the exponent n is below 1.
    """

    uses_entry_speed = False
    force_jumps = False

    def __check_init__(self):
        require_exponent(self.exponent)


class ElastoGap(AbstractBoundedDampingLaw):
    r"""Law F = K delta^n + D rate, with the damping force limited to the elastic force.

    $$F = K \delta^n + D \dot\delta, \quad |D \dot\delta| \le K \delta^n$$

    The force neither jumps nor becomes negative. Source: Modelica's
    Translational.Components.ElastoGap.

    **Arguments:**

    - `stiffness`: K, a number in N/m^n or an `AbstractElasticity`.
    - `damping`: D, N s/m, not negative.
    - `exponent`: n, at least 1; 1 by default.

    **Raises:** `ValueError` if a value is outside its range.

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
        """Return the normal force, N."""
        elastic = self.elastic_force(gap)
        return elastic + jnp.clip(self.damping * gap.rate, -elastic, elastic)


class ImpactFunction(AbstractBoundedDampingLaw):
    r"""Law F = max(0, K delta^n + D(delta) rate): the IMPACT function of Adams and SolidWorks.

    $$F = \max(0, K \delta^n + D s^2 (3 - 2 s) \dot\delta), \quad s = \min(\delta / d, 1)$$

    **Arguments:**

    - `stiffness`: K, a number in N/m^n or an `AbstractElasticity`.
    - `damping`: D, N s/m, the damping at depths of at least d; not negative.
    - `full_damping_depth`: d, m, up to which the damping rises from zero by a cubic polynomial.
    - `exponent`: n, at least 1; 1.5 by default.

    **Raises:** `ValueError` if a value is outside its range.

    >>> law = cj.laws.ImpactFunction(stiffness=1e9, damping=2e3, full_damping_depth=1e-4)
    >>> print(f"{law.force(extend.Gap(depth=1e-4, rate=0.1), None):.1f}")  # N: 1000 + 200
    1200.0
    """

    stiffness: AbstractElasticity = eqx.field(converter=as_stiffness)
    damping: Single = quantity("N s/m", positive=True, zero=True)
    full_damping_depth: Single = quantity("m", positive=True, remedy="give it in m")
    exponent: float = eqx.field(default=1.5, static=True)

    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        """Return the normal force, N."""
        ratio = jnp.clip(gap.depth / self.full_damping_depth, 0.0, 1.0)
        damping = self.damping * ratio**2 * (3.0 - 2.0 * ratio)
        return jnp.maximum(self.elastic_force(gap) + damping * gap.rate, 0.0)


class FloresKelvinVoigt(AbstractBoundedDampingLaw):
    r"""Flores' variant of the Kelvin-Voigt law, whose force is smaller in restitution.

    $$F = K \delta^n \;(\dot\delta > 0), \quad F = c K \delta^n \;(\dot\delta < 0)$$

    The force is K delta^n in compression and c K delta^n in restitution. The rebound speed of a
    free impact over its entry speed is sqrt(c). Where the rate changes its sign, the two forces are
    blended by a hyperbolic tangent, because integration steps don't end there. Impacts that are not
    much faster than the transition speed lose less energy. The law is that of the program DyS
    (github.com/ladisk/DyS), generalised to any exponent.

    **Arguments:**

    - `restitution`: c, 0 to 1.
    - `stiffness`: K, a number in N/m^n or an `AbstractElasticity`.
    - `transition_speed`: m/s, positive, scale of the hyperbolic tangent; 1e-3 by default.
    - `exponent`: n, at least 1; 1 by default.

    **Raises:** `ValueError` if a value is outside its range.

    >>> law = cj.laws.FloresKelvinVoigt(restitution=0.81, stiffness=1e6)
    >>> print(f"{law.force(extend.Gap(depth=1e-3, rate=0.1), None):.1f}")  # N, compression
    1000.0
    >>> print(f"{law.force(extend.Gap(depth=1e-3, rate=-0.1), None):.1f}")  # restitution
    810.0
    """

    restitution: Single = quantity("1", within=(0.0, 1.0), remedy="1 is elastic")
    stiffness: AbstractElasticity = eqx.field(converter=as_stiffness)
    transition_speed: Single = quantity("m/s", default=1e-3, positive=True, remedy="give m/s")
    exponent: float = eqx.field(default=1.0, static=True)

    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        """Return the normal force, N."""
        loading = 0.5 * (1.0 + jnp.tanh(gap.rate / self.transition_speed))
        full = self.stiffness.force(gap, self.exponent)
        return full * (self.restitution + (1.0 - self.restitution) * loading)

    def elastic_force(self, gap: Gap) -> Scalar:
        """Return (1 + c) K delta^n/2, N, the mean of the forces in compression and restitution.

        It doesn't depend on the rate, so that it is conservative. The rest of the force, at most
        (1 - c) K delta^n/2, opposes the rate and dissipates energy.
        """
        return 0.5 * (1.0 + self.restitution) * super().elastic_force(gap)

    def stored_energy(self, gap: Gap) -> Scalar:
        """Return the integral of the elastic force over the penetration, J."""
        return 0.5 * (1.0 + self.restitution) * super().stored_energy(gap)

    def delivered_restitution(self) -> Scalar:
        """Return rebound speed over entry speed of a free impact, sqrt(c).

        It is valid for impacts much faster than the transition speed.
        """
        return jnp.sqrt(self.restitution)
