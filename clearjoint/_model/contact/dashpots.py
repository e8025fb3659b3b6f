"""Contact laws with a dashpot parallel to the spring, which don't use the entry speed.

`ElastoGap`, `ImpactFunction` and `FloresKelvinVoigt` have other kinds of damping, whose force is
zero at the onset.
"""

import abc
from typing import TYPE_CHECKING, ClassVar

import equinox as eqx
import jax.numpy as jnp
from typing_extensions import override

from ..._fields.checks import require_type
from ..._fields.objects import quantity
from ..._fields.types import Single
from ..._math.vectors import Scalar
from .laws import (
    AbstractElasticity,
    AbstractPowerLaw,
    AbstractStiffness,
    Gap,
    as_stiffness,
    require_exponent,
    require_rebound,
)


class AbstractDashpotLaw(AbstractPowerLaw):
    """Base class of laws F = max(0, K delta^n + D delta^m rate) for a penetration delta > 0.

    The force is zero as soon as the dashpot would pull more strongly in the rebound than the spring
    pushes. The ratio of rebound speed to entry speed in a free impact depends on this rule.

    A subclass declares the field `stiffness`, K, and the class constants `exponent`, n, and
    `damping_exponent`, m, and defines `damping`, which returns D. If m is zero, the force jumps at
    the onset: declare ``force_jumps = True``. If `stiffness` is an `AbstractElasticity`, its force
    replaces K delta^n.

    ```python
    import clearjoint as cj

    class Foam(cj.extend.AbstractDashpotLaw):
        stiffness: cj.extend.AbstractStiffness
        viscosity: float  # N s/m^2
        exponent = 1.5
        damping_exponent = 1.0

        def damping(self, gap):
            return self.viscosity

    law = Foam(stiffness=1e9, viscosity=1e6)
    ```
    """

    if TYPE_CHECKING:  # pyright mistakes AbstractClassVar for a field
        exponent: ClassVar[float]
        damping_exponent: ClassVar[float]
    else:
        exponent: eqx.AbstractClassVar[float]
        damping_exponent: eqx.AbstractClassVar[float]
    uses_entry_speed = False
    force_jumps = False

    @abc.abstractmethod
    def damping(self, gap: Gap) -> Scalar:
        """Return D, N s/m^(1 + `damping_exponent`), which may depend on the radii in `gap`."""

    @override
    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        # Without contact, a depth of one replaces the actual depth: a power with an exponent below
        # one has an infinite derivative at zero, and is NaN for negative numbers.
        closed = gap.depth > 0.0
        depth = jnp.where(closed, gap.depth, 1.0)
        dashpot = self.damping(gap) * depth**self.damping_exponent * self._damped_rate(gap)
        return jnp.where(closed, jnp.maximum(self.elastic_force(gap) + dashpot, 0.0), 0.0)

    def _damped_rate(self, gap: Gap) -> Scalar:
        return gap.rate


def damping_ratio(restitution: Scalar) -> Scalar:
    """Return the damping ratio -ln c/sqrt(pi^2 + ln^2 c) of a linear oscillator whose speed falls
    by the factor c, the `restitution`, in half a period."""
    logarithm = jnp.log(restitution)
    return -logarithm / jnp.sqrt(jnp.pi**2 + logarithm**2)


def clamped_restitution(ratio: Scalar) -> Scalar:
    r"""Return rebound speed over entry speed for an impact on a linear spring and dashpot.

    $$e = \exp\left(-\frac{2 z \arccos z}{\sqrt{1 - z^2}}\right)$$

    The mass is released where the sum of the two forces vanishes, since a contact can't pull (T.
    Schwager, T. Poeschel 2007).

    **Arguments:** `ratio`: the damping ratio z of the oscillator, below 1.

    >>> print(f"{cj.laws.clamped_restitution(0.2155):.3f}")  # of KelvinVoigt(restitution=0.5)
    0.550
    """
    return jnp.exp(-2.0 * ratio * jnp.arccos(ratio) / jnp.sqrt(1.0 - ratio**2))


class AbstractTunedDashpotLaw(AbstractDashpotLaw):
    """Base class of dashpot laws whose damping follows from a requested restitution. Arguments are
    those of `KelvinVoigt`. The stiffness must be that of a power law."""

    restitution: Single = quantity("1", within=(0.0, 1.0), remedy="1 is elastic")
    stiffness: AbstractElasticity = eqx.field(converter=as_stiffness)
    effective_mass: Single = quantity("kg", positive=True, remedy="give the mass that rebounds")

    @override
    def _check_together(self) -> None:
        expected = "a number or an AbstractStiffness"
        remedy = "the damping of this law is computed from the stiffness K of a power law"
        require_type("stiffness", self.stiffness, AbstractStiffness, expected, remedy)
        require_rebound(self.restitution)

    def _root(self, gap: Gap) -> Scalar:
        assert isinstance(self.stiffness, AbstractStiffness)
        return jnp.sqrt(self.stiffness.value(gap) * self.effective_mass)


class AbstractClampedDashpotLaw(AbstractTunedDashpotLaw):
    """Base class of laws whose damping would deliver the requested restitution if the force could
    pull. Since the force is clamped at zero, they deliver a higher one."""

    def delivered_restitution(self) -> Scalar:
        """Return rebound speed over entry speed of a free impact of the effective mass."""
        return clamped_restitution(damping_ratio(self.restitution))


class KelvinVoigt(AbstractClampedDashpotLaw):
    r"""Linear spring and dashpot whose damping follows from a restitution (W. Voigt, Kelvin).

    $$F = K \delta + 2 z \sqrt{K m}\, \dot\delta$$

    m is the `effective_mass`, kg: m1 m2/(m1 + m2) for two colliding bodies, the body's mass for an
    impact against a wall. z is the damping ratio of an oscillator that delivers the requested
    `restitution`, above 0, if the force may pull; since a contact can't, values 0.1, 0.5 and 0.9
    deliver 0.253, 0.550 and 0.902. At the onset the force jumps. S. A. Anagnostopoulos 1988 uses
    this law for colliding buildings. Choose `SpringDashpot` for a known damping coefficient.

    >>> law = cj.laws.KelvinVoigt(restitution=0.5, stiffness=1e6, effective_mass=1.0)
    >>> print(f"{law.delivered_restitution():.3f}")
    0.550
    """

    exponent = 1.0
    damping_exponent = 0.0
    force_jumps = True

    @override
    def damping(self, gap: Gap) -> Scalar:
        return 2.0 * damping_ratio(self.restitution) * self._root(gap)


class Tsuji(AbstractClampedDashpotLaw):
    r"""Nonlinear spring and dashpot whose damping follows from restitution (Y. Tsuji et al. 1992).

    $$F = K \delta^{3/2} + \sqrt{5} z \sqrt{K m}\, \delta^{1/4} \dot\delta$$

    m, z (D. Antypov, J. A. Elliott 2011) and the delivered restitution are those of `KelvinVoigt`,
    but the force begins at zero.

    >>> law = cj.laws.Tsuji(restitution=0.9, stiffness=1e9, effective_mass=1.0)
    >>> print(f"{law.delivered_restitution():.3f}")
    0.902
    """

    exponent = 1.5
    damping_exponent = 0.25

    @override
    def damping(self, gap: Gap) -> Scalar:
        return 5.0**0.5 * damping_ratio(self.restitution) * self._root(gap)


class Jankowski(AbstractTunedDashpotLaw):
    r"""A law with damping during the approach only (R. Jankowski 2005).

    $$F = K \delta^{3/2} + 2 z \sqrt{K m}\, \delta^{1/4} \dot\delta \;(\dot\delta > 0), \quad z =
    \frac{9 \sqrt{5}}{2} \frac{1 - c^2}{c (c (9 \pi - 16) + 16)}$$

    In the rebound the force is K delta^1.5. The force never pulls, and the delivered restitution is
    close to the requested one, c. The arguments are those of `KelvinVoigt`.

    >>> law = cj.laws.Jankowski(restitution=0.5, stiffness=1e9, effective_mass=1.0)
    >>> print(f"{law.force(extend.Gap(depth=1e-4, rate=-0.1), None):.1f}")  # N, on the rebound
    1000.0
    """

    exponent = 1.5
    damping_exponent = 0.25

    @override
    def damping(self, gap: Gap) -> Scalar:
        c = self.restitution
        ratio = 4.5 * 5.0**0.5 * (1.0 - c**2) / (c * (c * (9.0 * jnp.pi - 16.0) + 16.0))
        return 2.0 * ratio * self._root(gap)

    @override
    def _damped_rate(self, gap: Gap) -> Scalar:
        return jnp.maximum(gap.rate, 0.0)


class AbstractGivenDashpotLaw(AbstractDashpotLaw):
    """Base class of laws F = max(0, K delta^n + D delta^m rate) with a given D. `stiffness` is K, a
    number in N/m^n, or an `AbstractElasticity`, whose force replaces K delta^n;
    `damping_coefficient` is D, N s/m^(1+m), not negative."""

    stiffness: AbstractElasticity = eqx.field(converter=as_stiffness)
    damping_coefficient: Single = quantity(
        "N s/m^(1+m)", positive=True, zero=True, remedy="give D in N, m and s"
    )

    @override
    def damping(self, gap: Gap) -> Scalar:
        return self.damping_coefficient


class SpringDashpot(AbstractGivenDashpotLaw):
    r"""Linear spring and dashpot with a given damping coefficient, N s/m.

    $$F = K \delta + D \dot\delta$$

    Take it for stops and flanks whose D is known or fitted, also overdamped ones; `KelvinVoigt`
    computes D from a restitution and a mass. The force jumps at the onset. A free impact of the
    mass m has the damping ratio z = D/(2 sqrt(K m)), and below 1 it delivers the restitution
    `clamped_restitution(z)`.

    >>> law = cj.laws.SpringDashpot(stiffness=1e6, damping_coefficient=2e3)
    >>> print(f"{law.force(extend.Gap(depth=1e-4, rate=0.1), None):.1f}")  # N: 100 + 200
    300.0
    """

    exponent = 1.0
    damping_exponent = 0.0
    force_jumps = True


class KuwabaraKono(AbstractGivenDashpotLaw):
    r"""Law for viscous spheres (G. Kuwabara, K. Kono 1987; N. V. Brilliantov et al. 1996).

    $$F = K \delta^{3/2} + D \delta^{1/2} \dot\delta$$

    `damping_coefficient` is D, N s/m^1.5. The restitution decreases with the entry speed, as with
    metals. The force begins at zero, but the derivative of the damping force by the penetration is
    infinite at the onset.

    >>> law = cj.laws.KuwabaraKono(stiffness=1e9, damping_coefficient=2e5)
    >>> print(f"{law.force(extend.Gap(depth=1e-4, rate=0.1), None):.1f}")  # N: 1000 + 200
    1200.0
    """

    exponent = 1.5
    damping_exponent = 0.5


class BordbarHyppanen(AbstractGivenDashpotLaw):
    r"""Law of M. H. Bordbar, T. Hyppanen 2007.

    $$F = K \delta^{1.5} + D \delta^{0.65} \dot\delta$$

    `damping_coefficient` is D, N s/m^1.65.

    >>> law = cj.laws.BordbarHyppanen(stiffness=1e9, damping_coefficient=1e6)
    >>> print(f"{law.force(extend.Gap(depth=1e-4, rate=0.1), None):.1f}")
    1251.2
    """

    exponent = 1.5
    damping_exponent = 0.65


class Ristow(AbstractGivenDashpotLaw):
    r"""Law of G. H. Ristow 1992, whose force jumps at the onset.

    $$F = K \delta^{3/2} + D \dot\delta$$

    `damping_coefficient` is D, N s/m.

    >>> law = cj.laws.Ristow(stiffness=1e9, damping_coefficient=2e3)
    >>> print(f"{law.force(extend.Gap(depth=1e-4, rate=0.1), None):.1f}")  # N: 1000 + 200
    1200.0
    """

    exponent = 1.5
    damping_exponent = 0.0
    force_jumps = True


class AbstractBoundedDampingLaw(AbstractPowerLaw):
    """Base class of laws with the elastic force K delta^n and a damping force that begins at zero.
    `stiffness` is K, a number in N/m^n, or an `AbstractElasticity`, whose force replaces K delta^n;
    `exponent` is n, at least 1."""

    uses_entry_speed = False
    force_jumps = False

    @override
    def __check_init__(self):
        require_exponent(self.exponent)


class ElastoGap(AbstractBoundedDampingLaw):
    r"""Linear dashpot whose force is limited to the elastic force.

    $$F = K \delta^n + D \dot\delta, \quad |D \dot\delta| \le K \delta^n$$

    The force neither jumps nor becomes negative, as in Modelica's
    Translational.Components.ElastoGap. `damping` is D, N s/m, not negative; n is 1 by default.

    >>> law = cj.laws.ElastoGap(stiffness=1e6, damping=5e3)
    >>> print(law.force(extend.Gap(depth=1e-3, rate=1.0), None))  # twice the elastic force at most
    2000.0
    """

    stiffness: AbstractElasticity = eqx.field(converter=as_stiffness)
    damping: Single = quantity("N s/m", positive=True, zero=True)
    exponent: float = eqx.field(default=1.0, static=True)

    @override
    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        elastic = self.elastic_force(gap)
        return elastic + jnp.clip(self.damping * gap.rate, -elastic, elastic)


class ImpactFunction(AbstractBoundedDampingLaw):
    r"""The IMPACT function of Adams and SolidWorks, whose damping grows with the penetration.

    $$F = \max(0, K \delta^n + D s^2 (3 - 2 s) \dot\delta), \quad s = \min(\delta / d, 1)$$

    `damping` is D, N s/m, not negative, and `full_damping_depth` d, m, positive; n defaults to 1.5.

    >>> law = cj.laws.ImpactFunction(stiffness=1e9, damping=2e3, full_damping_depth=1e-4)
    >>> print(f"{law.force(extend.Gap(depth=1e-4, rate=0.1), None):.1f}")  # N: 1000 + 200
    1200.0
    """

    stiffness: AbstractElasticity = eqx.field(converter=as_stiffness)
    damping: Single = quantity("N s/m", positive=True, zero=True)
    full_damping_depth: Single = quantity("m", positive=True, remedy="give it in m")
    exponent: float = eqx.field(default=1.5, static=True)

    @override
    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        ratio = jnp.clip(gap.depth / self.full_damping_depth, 0.0, 1.0)
        damping = self.damping * ratio**2 * (3.0 - 2.0 * ratio)
        return jnp.maximum(self.elastic_force(gap) + damping * gap.rate, 0.0)


class FloresKelvinVoigt(AbstractBoundedDampingLaw):
    r"""Flores' variant of the Kelvin-Voigt law: an elastic force that is smaller in the rebound.

    $$F = K \delta^n \;(\dot\delta > 0), \quad F = c K \delta^n \;(\dot\delta < 0)$$

    With c, the argument `restitution`, a free impact delivers the restitution sqrt(c). Steps don't
    end where the rate changes its sign: a hyperbolic tangent blends the two forces there, so that
    impacts which are not much faster than the `transition_speed`, m/s, 1e-3 by default, lose less
    energy. n is 1 by default. The law is that of the program DyS (github.com/ladisk/DyS),
    generalised to any exponent.

    >>> law = cj.laws.FloresKelvinVoigt(restitution=0.81, stiffness=1e6)
    >>> print(f"{law.force(extend.Gap(depth=1e-3, rate=-0.1), None):.1f}")  # N, in the rebound
    810.0
    """

    restitution: Single = quantity("1", within=(0.0, 1.0), remedy="1 is elastic")
    stiffness: AbstractElasticity = eqx.field(converter=as_stiffness)
    transition_speed: Single = quantity("m/s", default=1e-3, positive=True, remedy="give m/s")
    exponent: float = eqx.field(default=1.0, static=True)

    @override
    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        loading = 0.5 * (1.0 + jnp.tanh(gap.rate / self.transition_speed))
        full = self.stiffness.force(gap, self.exponent)
        return full * (self.restitution + (1.0 - self.restitution) * loading)

    @override
    def elastic_force(self, gap: Gap) -> Scalar:
        """Return the mean of the forces in compression and rebound, N, which is conservative."""
        return 0.5 * (1.0 + self.restitution) * super().elastic_force(gap)

    @override
    def stored_energy(self, gap: Gap) -> Scalar:
        return 0.5 * (1.0 + self.restitution) * super().stored_energy(gap)

    def delivered_restitution(self) -> Scalar:
        """Return sqrt(c), for impacts much faster than the transition speed."""
        return jnp.sqrt(self.restitution)
