"""The Hunt-Crossley family of contact laws: base classes, and laws without a requested restitution.

The normal force is F = K delta^n (1 + chi rate/entry speed), N, with the penetration delta, m, its
rate, m/s, and the entry speed, m/s, which is the rate at the onset of the contact. chi is a
dimensionless damping factor.
"""

import abc
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp

from ...fields.checks import require, require_positive, require_range
from ...fields.declarations import optional_quantity, quantity
from ...fields.types import Single
from ...math.smoothing import positive_power, ramp
from ...math.vectors import Scalar
from .gap import Gap
from .laws import (
    AbstractElasticity,
    AbstractElasticLaw,
    AbstractStiffness,
    as_stiffness,
    require_exponent,
)
from .restitution import delivered_restitution


class AbstractHertzianLaw(AbstractElasticLaw):
    """Base class of laws F = K delta^n (1 + chi rate/entry speed), which is never negative.

    delta is the penetration and chi the damping factor. A subclass declares the fields below and
    implements `damping_factor`. The ratio of rebound speed to entry speed in a free impact is then
    `delivered_restitution`, which may differ from the requested restitution.

    - `stiffness`: an `AbstractStiffness`, a number in N/m^n, or an `AbstractCylinder`, whose force
      replaces K delta^n.
    - `exponent`: n, at least 1; as a static field, the values 1 and 1.5 are computed without a
      general power. A cylinder ignores it.
    - `smoothing`: width w in m, or ``None``. With it, the penetration is replaced by a ramp that
      begins at delta = -w, is the parabola (delta + w)^2/(4 w) up to delta = w, and delta above.
      The factor 1 + chi rate/entry speed, which is otherwise limited to at least zero, is replaced
      by such a ramp of the factor, with the dimensionless width w/(w + delta); delta counts as zero
      in it before contact.

    **Raises:** `ValueError` if n is below 1, or the width is not positive or given with a stiffness
    that is not an `AbstractStiffness`.

    ```python
    import clearjoint as cj
    import equinox as eqx

    class Damped(cj.extend.AbstractHertzianLaw):
        stiffness: cj.extend.AbstractStiffness
        factor: float
        exponent: float = eqx.field(default=1.5, static=True)
        smoothing: float | None = None
        uses_entry_speed = True

        def damping_factor(self):
            return self.factor

    law = Damped(stiffness=1e9, factor=0.2)
    ```
    """

    exponent: eqx.AbstractVar[float]
    smoothing: eqx.AbstractVar[Single | None]
    force_jumps = False

    @abc.abstractmethod
    def damping_factor(self) -> Scalar:
        """Return chi, dimensionless: the factor of rate/entry speed in the force.

        The hysteresis damping factor of the literature is chi K/(entry speed).
        """

    def __check_init__(self):
        require_exponent(self.exponent)
        if self.smoothing is not None:
            require_positive("smoothing", self.smoothing, "give a width in m, or None")
            fine = isinstance(self.stiffness, AbstractStiffness)
            expected = f"None with {type(self.stiffness).__name__}"
            remedy = "it smooths a power of the penetration"
            require(fine, "smoothing", self.smoothing, expected, remedy)

    def onset_offset(self) -> Scalar:
        """Return the distance of the surfaces at which the force begins, m: the smoothing width."""
        return 0.0 if self.smoothing is None else self.smoothing

    def slope_jumps(self) -> bool:
        """Return whether the derivative of the force by the penetration may jump at the onset.

        It doesn't for a smoothed law, or for an exponent above one.
        """
        return self.smoothing is None and not self.stiffness.begins_flat(self.exponent)

    def elastic_force(self, gap: Gap) -> Scalar:
        """Return K delta^n, the force without damping, N."""
        if self.smoothing is not None:
            gap = replace(gap, depth=ramp(gap.depth, self.smoothing))
        return self.stiffness.force(gap, self.exponent)

    def stored_energy(self, gap: Gap) -> Scalar:
        """Return K delta^(n+1)/(n+1), J; with smoothing the integral includes the ramp."""
        n, w = self.exponent, self.smoothing
        if w is None:
            return self.stiffness.energy(gap, n)
        assert isinstance(self.stiffness, AbstractStiffness)
        # The ramp is (delta + w)^2/(4 w) for |delta| < w, and delta above: one integral for each.
        inside = jnp.clip(gap.depth, -w, w) + w
        below = positive_power(inside, 2 * n + 1) / ((4 * w) ** n * (2 * n + 1))
        above = (positive_power(jnp.maximum(gap.depth, w), n + 1) - w ** (n + 1)) / (n + 1)
        return self.stiffness.value(gap) * (below + above)

    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        """Return the normal force, N, never negative; the elastic force for an `entry_speed` of
        ``None``."""
        if entry_speed is None:
            return self.elastic_force(gap)
        # The quotient doesn't change during a step: in this order it is computed only once.
        factor = 1.0 + (self.damping_factor() / entry_speed) * gap.rate
        return self.elastic_force(gap) * ramp(factor, self._clamp_width(gap))

    def _clamp_width(self, gap: Gap) -> Scalar | None:
        """Return the dimensionless width w/(w + delta) of the ramp that limits the damping.

        It is one at the onset and tends to zero at penetrations delta well above the smoothing
        width w, where only the usual limit of zero remains. Without smoothing it is ``None``.
        """
        if self.smoothing is None:
            return None
        return self.smoothing / (self.smoothing + jnp.maximum(gap.depth, 0.0))

    def delivered_restitution(self) -> Scalar:
        """Return rebound speed over entry speed of a free impact, from the `damping_factor`."""
        return delivered_restitution(self.damping_factor())


class Hertz(AbstractHertzianLaw):
    r"""Purely elastic contact, F = K delta^n (H. Hertz 1881); it doesn't use the entry speed.

    $$F = K \delta^n$$

    **Arguments:** `stiffness`: K, a number in N/m^n, an `AbstractStiffness`, or an
    `AbstractCylinder`. `exponent`: n, at least 1; 1.5 by default. `smoothing`: width in m over
    which the force begins smoothly, or ``None``, the default.

    **Raises:** `ValueError` if a value is outside its range.

    >>> law = cj.laws.Hertz(stiffness=1e9)
    >>> print(f"{law.force(extend.Gap(depth=1e-4, rate=0.0), None):.1f}")  # N: 1e9 (1e-4)^1.5
    1000.0
    """

    stiffness: AbstractElasticity = eqx.field(converter=as_stiffness)
    exponent: float = eqx.field(default=1.5, static=True)
    smoothing: Single | None = optional_quantity("m")
    uses_entry_speed = False

    def damping_factor(self) -> Scalar:
        """Return chi = 0: there is no damping."""
        return 0.0


class MemorylessHuntCrossley(AbstractHertzianLaw):
    r"""F = K delta^n (1 + a rate) with a given damping a (K. H. Hunt, F. R. E. Crossley 1975).

    $$F = K \delta^n (1 + a \dot\delta), \quad a = \frac{3 (1 - c)}{2 v}$$

    The damping a doesn't depend on the entry speed. It equals that of `HuntCrossley` at the entry
    speed v, the `design_speed`, m/s. The `restitution` c is requested for this speed, at which
    impacts have the restitution `delivered_restitution`. Slower impacts lose less and faster
    impacts more, as with metals. Unlike with `HuntCrossley`, a contact with a slow onset has no
    large damping, which would make the differential equations stiff.

    **Arguments:**

    - `restitution`: c, 0 to 1.
    - `stiffness`: K, a number in N/m^n, an `AbstractStiffness`, or an `AbstractCylinder`.
    - `design_speed`: v, m/s, positive.
    - `exponent`: n, at least 1; 1.5 by default.
    - `smoothing`: width in m over which the force begins smoothly, or ``None``, the default.

    **Raises:** `ValueError` if a value is outside its range.

    >>> law = cj.laws.MemorylessHuntCrossley(restitution=0.8, stiffness=1e9, design_speed=0.1)
    >>> print(f"{law.delivered_restitution():.4f}")
    0.8329
    >>> print(f"{law.force(extend.Gap(depth=1e-4, rate=0.1), None):.1f}")  # N: 1000 (1 + 0.3)
    1300.0
    """

    restitution: Single = quantity("1", within=(0.0, 1.0), remedy="1 is elastic, 0 is plastic")
    stiffness: AbstractElasticity = eqx.field(converter=as_stiffness)
    design_speed: Single = quantity(
        "m/s", positive=True, remedy="give a typical entry speed in m/s"
    )
    exponent: float = eqx.field(default=1.5, static=True)
    smoothing: Single | None = optional_quantity("m")
    uses_entry_speed = False
    force_jumps = False

    def damping_factor(self) -> Scalar:
        """Return chi = 3 (1 - c)/2, dimensionless, for the requested restitution c.

        The damping is a = chi/v, s/m, with the design speed v.
        """
        return 1.5 * (1.0 - self.restitution)

    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        """Return the normal force, N, with the damping of the design speed at every entry speed."""
        return super().force(gap, self.design_speed)


class AbstractDampedLaw(AbstractHertzianLaw):
    """Base class of Hunt-Crossley laws with a requested restitution and a lower limit of the entry
    speed.

    A subclass defines `damping_factor`, usually from `restitution`.

    **Arguments:**

    - `restitution`: requested ratio of rebound speed to entry speed, c, 0 to 1.
    - `stiffness`: K, a number in N/m^n, an `AbstractStiffness`, or an `AbstractCylinder`.
    - `exponent`: n, at least 1; 1.5 by default.
    - `smoothing`: width in m over which the force begins smoothly, or ``None``, the default.
    - `entry_speed_floor`: m/s, positive, 1e-6 by default; slower entry speeds are replaced by it,
      because the damping diverges at zero entry speed.

    **Raises:** `ValueError` if a value is outside its range.

    ```python
    import clearjoint as cj

    class Gonthier(cj.extend.AbstractDampedLaw):
        def damping_factor(self):
            return (1.0 - self.restitution**2) / self.restitution

    law = Gonthier(restitution=0.8, stiffness=cj.laws.RavnStiffness(207e9, 0.3))
    ```
    """

    restitution: Single = quantity("1")
    stiffness: AbstractElasticity = eqx.field(converter=as_stiffness)
    exponent: float = eqx.field(default=1.5, static=True)
    entry_speed_floor: Single = quantity("m/s", default=1e-6)
    smoothing: Single | None = optional_quantity("m")
    uses_entry_speed = True
    force_jumps = False

    def __check_init__(self):
        require_range("restitution", self.restitution, 0.0, 1.0, "1 is elastic, 0 is plastic")
        require_positive(
            "entry_speed_floor", self.entry_speed_floor, "give a small speed in m/s, e.g. 1e-6"
        )

    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        """Return the normal force, N, with an entry speed of at least `entry_speed_floor`."""
        assert entry_speed is not None
        return super().force(gap, jnp.maximum(entry_speed, self.entry_speed_floor))
