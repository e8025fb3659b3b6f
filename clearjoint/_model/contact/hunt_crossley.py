"""The Hunt-Crossley contact laws: base classes, damping factors, delivered restitution.

The normal force is F = K delta^n (1 + chi v/v0), N, with the penetration delta, m, its rate v, m/s,
and the entry speed v0, m/s, which is the rate at the onset of the contact. `stiffness` is K, N/m^n,
and `exponent` is n, 1.5 unless a class says otherwise. chi, dimensionless, is the damping factor.
An `AbstractCylinder`, the elasticity of a line contact, may be given as `stiffness`; its force then
replaces K delta^n.

`restitution` is c, the requested ratio of rebound speed to entry speed in a free impact, in which
only the contact force acts. The actual ratio follows from chi alone, and most of the published
factors meet the request only approximately. The examples print the ratio that a law delivers, which
`delivered_restitution` computes. `ExactRestitution` delivers the requested value.

`AbstractDampedLaw` describes the arguments of its subclasses, and the values that they refuse.
Subclasses of `AbstractReboundingLaw` also refuse c = 0, for which chi would be infinite. `Hertz`
and `MemorylessHuntCrossley` have arguments of their own.
"""

import abc
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jaxtyping import ArrayLike, Float

from ..._fields.cautions import LawRangeWarning, caution
from ..._fields.checks import concrete, require, require_positive
from ..._fields.objects import optional_quantity, quantity
from ..._fields.types import Single
from ..._math.smoothing import positive_power, ramp
from ..._math.vectors import Scalar
from .laws import (
    AbstractElasticity,
    AbstractElasticLaw,
    AbstractStiffness,
    Gap,
    as_stiffness,
    require_exponent,
    require_rebound,
)

_SERIES_BELOW = 1e-5
"""Damping factor chi below which the series 1 - 2 chi/3 gives the delivered restitution more
accurately than the numerical solution, which is rounded."""
_NEWTON = optimistix.Newton(rtol=1e-14, atol=1e-14)
_MOST_STEPS = 32
"""Step limit of Newton's method, which converges in a few steps for every damping factor."""


def delivered_restitution(damping_factor: Float[ArrayLike, "..."]) -> Float[jax.Array, "..."]:
    r"""Return rebound speed over entry speed of a free impact with a Hunt-Crossley law.

    This ratio e is 1 for chi = 0. For chi > 0 it is the positive solution of

    $$\chi (1 + e) = \ln \frac{1 + \chi}{1 - \chi e}$$

    **Arguments:** `damping_factor`: chi of F = K delta^n (1 + chi rate/entry speed), not negative;
    a number or an array of any shape.

    **Returns:** e in (0, 1], of the same shape; differentiable.

    >>> print(f"{cj.laws.delivered_restitution(0.3):.4f}")
    0.8329
    """
    return _solve_restitution(jnp.asarray(damping_factor, dtype=float))


@jnp.vectorize
def _solve_restitution(damping_factor: jax.Array) -> jax.Array:
    """Return the restitution e for one damping factor chi, a scalar."""
    # The unknown is y = -ln(1 - chi e), which stays exact where chi e rounds to one. In terms
    # of y the equation is y - 1 + exp(-y) = loss, with loss = chi - ln(1 + chi). The left side is
    # about y^2/2 for small y and y - 1 for large y; for every loss, `start` is an upper bound of
    # the solution. For small chi the series is returned. `jnp.where` evaluates the numerical
    # solution there too: it is then found for `_SERIES_BELOW`, where it and its derivative are
    # finite.
    small = damping_factor < _SERIES_BELOW
    chi = jnp.where(small, _SERIES_BELOW, damping_factor)
    loss = chi - jnp.log1p(chi)
    start = loss + jnp.sqrt(2.0 * loss)
    root = optimistix.root_find(
        _residual, _NEWTON, start, args=loss, max_steps=_MOST_STEPS, throw=False
    ).value
    series = 1.0 - 2.0 * damping_factor / 3.0
    return jnp.where(small, series, -jnp.expm1(-root) / chi)


def _residual(y: Scalar, loss: Scalar) -> Scalar:
    """Return the residual y - 1 + exp(-y) - loss for the unknown y = -ln(1 - chi e).

    `loss` is chi - ln(1 + chi). For y > 0 the residual is convex and increases with y, so that
    Newton's method converges.
    """
    return y + jnp.expm1(-y) - loss


_SERIES_TERMS = 18
"""Number of terms of the power series in `_chord`, enough for an error as small as rounding."""
_SERIES_WITHIN = 0.1
"""Largest absolute value of x for which `_chord` is computed by its power series."""
_EXACT_STEPS = 5
"""Steps of Newton's method in `_logarithm`; four reach rounding accuracy for restitutions between
1e-6 and 1."""


def exact_damping_factor(restitution: Float[ArrayLike, ""]) -> Scalar:
    """Return the damping factor chi with which a free impact delivers a given restitution.

    **Arguments:** `restitution`: e in (0, 1].

    **Returns:** the solution chi of chi (1 + e) = ln[(1 + chi)/(1 - chi e)], zero for e = 1 and
    approximately 1/e for small e; differentiable.

    >>> chi = cj.laws.exact_damping_factor(0.8)
    >>> print(f"{cj.laws.delivered_restitution(chi):.6f}")
    0.800000
    """
    e = jnp.asarray(restitution, dtype=float)
    return -jnp.expm1(-_logarithm(e)) / e


@jax.custom_jvp
def _logarithm(e: Scalar) -> Scalar:
    """Return y = -ln(1 - chi e) for a restitution e and its exact damping factor chi.

    Unlike chi e, y doesn't lose digits where chi e rounds to one.
    """
    # For e above 0.4, start from the damping factor of Carvalho and Martins, whose error is below
    # 0.5 % there. For smaller e, start from 1 plus the asymptote of y for small e, which is
    # 1 + 1/e - ln(1 + 1/e). `jnp.where` evaluates both expressions for every e: the minimum keeps
    # the first one finite for the smaller e, for which it is not used.
    approximate = 1.5 * (1.0 - e) * (11.0 - e) / (1.0 + 9.0 * e)
    start = jnp.where(
        e > 0.4, -jnp.log1p(-jnp.minimum(approximate * e, 0.9)), 2.0 + 1.0 / e - jnp.log1p(1.0 / e)
    )

    def step(_: int, y: Scalar) -> Scalar:
        value, slope = jax.jvp(lambda y: _relation(y, e), (y,), (jnp.ones_like(y),))
        return y - value / slope

    return jax.lax.fori_loop(0, _EXACT_STEPS, step, start)


@_logarithm.defjvp
def _logarithm_along(primals: tuple[Scalar], tangents: tuple[Scalar]) -> tuple[Scalar, Scalar]:
    """Return y and its tangent, which is -(dr/de)/(dr/dy) times the tangent of e.

    r(y, e) is the value of `_relation`. It is zero for every e and the y returned for this e, from
    which dy/de follows.
    """
    (e,), (along,) = primals, tangents
    y = _logarithm(e)
    by_y = jax.grad(_relation)(y, e)
    by_e = jax.grad(_relation, argnums=1)(y, e)
    return y, -by_e / by_y * along


def _relation(y: Scalar, e: Scalar) -> Scalar:
    """Return a residual that increases with y and is zero for the unknown y = -ln(1 - chi e).

    The equation chi (1 + e) = ln[(1 + chi)/(1 - chi e)] states that x - ln(1 + x) is the same for
    x = chi and x = -chi e. The residual is the difference of the square roots of twice these two
    values, divided by chi and thus without the trivial root chi = 0.
    """
    # `loss` is chi e here.
    loss = -jnp.expm1(-y)
    return e * _chord(-loss, -y) - _chord(loss / e, jnp.log1p(loss / e))


def _chord(x: Scalar, logarithm: Scalar) -> Scalar:
    """Return sqrt(2 (x - ln(1 + x)))/|x|, accurate near zero too.

    **Arguments:** `x`: above -1; `logarithm`: ln(1 + x), which the caller knows more accurately
    than it can be computed from x.
    """
    near = jnp.abs(x) < _SERIES_WITHIN
    small = jnp.where(near, x, 0.0)
    large, logarithm = jnp.where(near, 1.0, x), jnp.where(near, 0.0, logarithm)
    series = jnp.polyval(_COEFFICIENTS, small)
    return jnp.sqrt(jnp.where(near, series, 2.0 * (large - logarithm) / large**2))


_COEFFICIENTS = np.array([2.0 * (-1.0) ** k / (k + 2) for k in range(_SERIES_TERMS)][::-1])
"""Power series of 2 (x - ln(1 + x))/x^2, highest power first."""


class AbstractHertzianLaw(AbstractElasticLaw):
    """Base class of laws F = K delta^n (1 + chi rate/entry speed), or zero where this is negative.

    delta is the penetration and chi the damping factor. A subclass declares the fields below, sets
    the class attribute `uses_entry_speed` (whether the force needs the entry speed) and implements
    `damping_factor`. The ratio of rebound speed to entry speed in a free impact is then
    `delivered_restitution`, which may differ from the requested restitution.

    - `stiffness`: an `AbstractStiffness`, a number in N/m^n, or an `AbstractCylinder`, whose force
      replaces K delta^n.
    - `exponent`: n, at least 1. Declare it as a static field, so that the compiled program can do
      without a general power for the values 1 and 1.5. A cylinder ignores it.
    - `smoothing`: width w in m, or ``None``. If a width is given, a ramp replaces the penetration:
      zero below delta = -w, the parabola (delta + w)^2/(4 w) up to delta = w, and delta above.
      The factor 1 + chi rate/entry speed is replaced by a ramp of the same form, whose
      dimensionless width is w/(w + max(delta, 0)). For ``None``, the penetration is not changed,
      and a negative factor is replaced by zero.

    **Raises:** `ValueError` if n is below 1, a number given as stiffness is not positive, or the
    width is not positive or given with a stiffness that is not an `AbstractStiffness`.

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
        """Return the distance of the surfaces at which the force begins, m: the smoothing width, or
        0 without smoothing."""
        return 0.0 if self.smoothing is None else self.smoothing

    def slope_jumps(self) -> bool:
        """Return whether the derivative of the force by the penetration may jump at the onset.

        It doesn't for a smoothed law, or if the method `begins_flat` of the stiffness returns
        ``True``, as for K delta^n with n above one.
        """
        return self.smoothing is None and not self.stiffness.begins_flat(self.exponent)

    def elastic_force(self, gap: Gap) -> Scalar:
        """Return the force without damping, N: K delta^n, in which delta is replaced by its ramp if
        `smoothing` is given."""
        if self.smoothing is not None:
            gap = replace(gap, depth=ramp(gap.depth, self.smoothing))
        return self.stiffness.force(gap, self.exponent)

    def stored_energy(self, gap: Gap) -> Scalar:
        """Return K delta^(n+1)/(n+1), J; with `smoothing`, the integral of the smoothed elastic
        force over the penetration."""
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
        width = self.smoothing
        if width is not None:
            # The width of the factor's ramp tends to zero at penetrations well above the smoothing
            # width. There the ramp is nearly max(factor, 0), as it is exactly without smoothing.
            width = width / (width + jnp.maximum(gap.depth, 0.0))
        return self.elastic_force(gap) * ramp(factor, width)

    def delivered_restitution(self) -> Scalar:
        """Return rebound speed over entry speed of a free impact, from the `damping_factor`.

        An effect of `smoothing` on this ratio is neglected.
        """
        return delivered_restitution(self.damping_factor())


class Hertz(AbstractHertzianLaw):
    r"""Purely elastic contact, F = K delta^n (H. Hertz 1881); it doesn't use the entry speed.

    $$F = K \delta^n$$

    **Arguments:** `stiffness`: K, a number in N/m^n, an `AbstractStiffness`, or an
    `AbstractCylinder`. `exponent`: n, at least 1; 1.5 by default. `smoothing`: positive width in m
    over which the force begins smoothly, or ``None``, the default; an `AbstractCylinder` needs
    ``None``.

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
    r"""F = K delta^n (1 + a rate) with a constant damping a (K. H. Hunt, F. R. E. Crossley 1975).

    $$F = K \delta^n (1 + a \dot\delta), \quad a = \frac{3 (1 - c)}{2 v}$$

    The damping a doesn't depend on the entry speed. It equals that of `HuntCrossley` at the entry
    speed v, the `design_speed`, m/s. The requested `restitution` c and the method
    `delivered_restitution` apply to impacts at this speed. Slower impacts lose a smaller part of
    their energy and faster impacts a larger one, as with metals. Unlike with `HuntCrossley`, a
    contact with a slow onset has no large damping, which would make the differential equations
    stiff.

    **Arguments:**

    - `restitution`: c, 0 to 1.
    - `stiffness`: K, a number in N/m^n, an `AbstractStiffness`, or an `AbstractCylinder`.
    - `design_speed`: v, m/s, positive.
    - `exponent`: n, at least 1; 1.5 by default.
    - `smoothing`: positive width in m over which the force begins smoothly, or ``None``, the
      default; an `AbstractCylinder` needs ``None``.

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
    - `smoothing`: positive width in m over which the force begins smoothly, or ``None``, the
      default; an `AbstractCylinder` needs ``None``.
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

    restitution: Single = quantity("1", within=(0.0, 1.0), remedy="1 is elastic, 0 is plastic")
    stiffness: AbstractElasticity = eqx.field(converter=as_stiffness)
    exponent: float = eqx.field(default=1.5, static=True)
    entry_speed_floor: Single = quantity(
        "m/s", default=1e-6, positive=True, remedy="give a small speed in m/s, e.g. 1e-6"
    )
    smoothing: Single | None = optional_quantity("m")
    uses_entry_speed = True
    force_jumps = False

    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        """Return the normal force, N, with an entry speed of at least `entry_speed_floor`.

        The `entry_speed`, m/s, must be known: ``None`` is for laws that do not use it.
        """
        assert entry_speed is not None
        return super().force(gap, jnp.maximum(entry_speed, self.entry_speed_floor))


class HuntCrossley(AbstractDampedLaw):
    r"""Law with the damping factor chi = 3 (1 - c)/2.

    Source: K. H. Hunt, F. R. E. Crossley 1975; D. W. Marhefka, D. E. Orin 1999.

    $$\chi = \frac{3 (1 - c)}{2}$$

    >>> law = cj.laws.HuntCrossley(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.3000, delivers 0.8329
    """

    def damping_factor(self) -> Scalar:
        """Return chi = 3 (1 - c)/2."""
        return 1.5 * (1.0 - self.restitution)


class HerbertMcWhannell(AbstractDampedLaw):
    r"""Law with the damping factor chi = 6 (1 - c)/((2 c - 1)^2 + 3).

    Source: R. G. Herbert, D. C. McWhannell 1977.

    $$\chi = \frac{6 (1 - c)}{(2 c - 1)^2 + 3}$$

    >>> law = cj.laws.HerbertMcWhannell(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.3571, delivers 0.8070
    """

    def damping_factor(self) -> Scalar:
        """Return chi = 6 (1 - c)/((2 c - 1)^2 + 3)."""
        return 6.0 * (1.0 - self.restitution) / ((2.0 * self.restitution - 1.0) ** 2 + 3.0)


class LeeWang(AbstractDampedLaw):
    r"""Law with the damping factor chi = 3 (1 - c)/4.

    Source: T. W. Lee, A. C. Wang 1983.

    $$\chi = \frac{3 (1 - c)}{4}$$

    Near c = 1 it dissipates half the energy that c requires. For c = 0 the rebound speed is still
    0.66 times the entry speed.

    >>> law = cj.laws.LeeWang(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.1500, delivers 0.9090
    """

    def damping_factor(self) -> Scalar:
        """Return chi = 3 (1 - c)/4."""
        return 0.75 * (1.0 - self.restitution)


class LankaraniNikravesh(AbstractDampedLaw):
    r"""Law with the damping factor chi = 3 (1 - c^2)/4.

    Source: H. M. Lankarani, P. E. Nikravesh 1990; P. Flores et al. 2006, eq. 24.

    $$\chi = \frac{3 (1 - c^2)}{4}$$

    >>> law = cj.laws.LankaraniNikravesh(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.2700, delivers 0.8471
    """

    def damping_factor(self) -> Scalar:
        """Return chi = 3 (1 - c^2)/4."""
        return 0.75 * (1.0 - self.restitution**2)


class ZhiyingQishao(AbstractDampedLaw):
    r"""Law with the damping factor chi = 3/4 (1 - c^2) exp(2 (1 - c)).

    Source: Q. Zhiying, L. Qishao 2006.

    $$\chi = \frac{3}{4} (1 - c^2) e^{2 (1 - c)}$$

    >>> law = cj.laws.ZhiyingQishao(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.4028, delivers 0.7874
    """

    def damping_factor(self) -> Scalar:
        """Return chi = 3/4 (1 - c^2) exp(2 (1 - c))."""
        return 0.75 * (1.0 - self.restitution**2) * jnp.exp(2.0 * (1.0 - self.restitution))


class CarvalhoMartins(AbstractDampedLaw):
    r"""Law with the damping factor chi = 3 (1 - c)(11 - c)/(2 (1 + 9 c)).

    Source: A. S. Carvalho, J. M. Martins 2019.

    $$\chi = \frac{3 (1 - c) (11 - c)}{2 (1 + 9 c)}$$

    The delivered restitution differs from c by at most 2e-4 for c >= 0.5.

    >>> law = cj.laws.CarvalhoMartins(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.3732, delivers 0.8000
    """

    def damping_factor(self) -> Scalar:
        """Return chi = 3 (1 - c)(11 - c)/(2 (1 + 9 c))."""
        c = self.restitution
        return 1.5 * (1.0 - c) * (11.0 - c) / (1.0 + 9.0 * c)


class AbstractReboundingLaw(AbstractDampedLaw):
    """Base class of laws whose damping factor is infinite for a restitution of zero.

    **Raises:** `ValueError` for this restitution too.
    """

    def __check_init__(self):
        require_rebound(self.restitution)


class Flores2011(AbstractReboundingLaw):
    r"""Law with the damping factor chi = 8 (1 - c)/(5 c), for restitutions from nearly 0 to 1.

    Source: P. Flores et al. 2011.

    $$\chi = \frac{8 (1 - c)}{5 c}$$

    K. Ye et al. 2009 derived the same factor for the exponent 1.5.

    >>> law = cj.laws.Flores2011(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.4000, delivers 0.7885
    """

    def damping_factor(self) -> Scalar:
        """Return chi = 8 (1 - c)/(5 c)."""
        return 1.6 * (1.0 - self.restitution) / self.restitution


class Gonthier(AbstractReboundingLaw):
    r"""Law with the damping factor chi = (1 - c^2)/c.

    Source: Y. Gonthier et al. 2004, as an approximation of the equation that `ExactRestitution`
    solves.

    $$\chi = \frac{1 - c^2}{c}$$

    >>> law = cj.laws.Gonthier(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.4500, delivers 0.7680
    """

    def damping_factor(self) -> Scalar:
        """Return chi = (1 - c^2)/c."""
        return (1.0 - self.restitution**2) / self.restitution


class GharibHurmuzlu(AbstractReboundingLaw):
    r"""Law with the damping factor chi = 1/c, for nearly plastic impacts.

    Source: M. Gharib, Y. Hurmuzlu 2012.

    $$\chi = \frac{1}{c}$$

    The delivered restitution never exceeds 0.594, its value for c = 1.

    >>> law = cj.laws.GharibHurmuzlu(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    1.2500, delivers 0.5362
    """

    def damping_factor(self) -> Scalar:
        """Return chi = 1/c."""
        return 1.0 / self.restitution


class HuGuo(AbstractReboundingLaw):
    r"""Law with the damping factor chi = 3 (1 - c)/(2 c).

    Source: S. Hu, X. Guo 2015.

    $$\chi = \frac{3 (1 - c)}{2 c}$$

    >>> law = cj.laws.HuGuo(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.3750, delivers 0.7992
    """

    def damping_factor(self) -> Scalar:
        """Return chi = 3 (1 - c)/(2 c)."""
        return 1.5 * (1.0 - self.restitution) / self.restitution


class SafaeifarFarshidianfar(AbstractReboundingLaw):
    r"""Law with the damping factor chi = 5 (1 - c)/(4 c).

    Source: H. Safaeifar, A. Farshidianfar 2020.

    $$\chi = \frac{5 (1 - c)}{4 c}$$

    >>> law = cj.laws.SafaeifarFarshidianfar(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.3125, delivers 0.8271
    """

    def damping_factor(self) -> Scalar:
        """Return chi = 5 (1 - c)/(4 c)."""
        return 1.25 * (1.0 - self.restitution) / self.restitution


class YePounding(AbstractReboundingLaw):
    r"""Law with the damping factor chi = 3 (1 - c)/(2 c) and, by default, a linear spring (n = 1).

    Source: K. Ye et al. 2009, for colliding buildings.

    $$\chi = \frac{3 (1 - c)}{2 c}$$

    >>> law = cj.laws.YePounding(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.3750, delivers 0.7992
    """

    exponent: float = eqx.field(default=1.0, static=True)

    def damping_factor(self) -> Scalar:
        """Return chi = 3 (1 - c)/(2 c)."""
        return 1.5 * (1.0 - self.restitution) / self.restitution


class PantWijeyewickrema(AbstractReboundingLaw):
    r"""Law with the damping factor chi = 3 (1 - c^2)/(2 c^2).

    Source: D. R. Pant, A. C. Wijeyewickrema 2012.

    $$\chi = \frac{3 (1 - c^2)}{2 c^2}$$

    By default the spring is linear: n = 1.

    The delivered restitution is far too small: 0.22 for c = 0.5, and 0.81 for c = 0.9. Use this law
    only to reproduce published results.

    **Warns:** `LawRangeWarning` for any restitution below 1.

    >>> import warnings
    >>> warnings.filterwarnings("ignore", category=cj.LawRangeWarning)
    >>> law = cj.laws.PantWijeyewickrema(restitution=0.9, stiffness=1e6)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.3519, delivers 0.8093
    """

    exponent: float = eqx.field(default=1.0, static=True)

    def _caution_together(self) -> None:
        requested = concrete(self.restitution)
        if requested is not None and requested < 1.0:
            caution(
                f"`PantWijeyewickrema` delivers far less than the requested restitution of "
                f"{float(requested):g}, for example 0.22 for 0.5: use `ExactRestitution`.",
                LawRangeWarning,
            )

    def damping_factor(self) -> Scalar:
        """Return chi = 3 (1 - c^2)/(2 c^2)."""
        return 1.5 * (1.0 - self.restitution**2) / self.restitution**2


class ExactRestitution(AbstractReboundingLaw):
    r"""Law whose damping factor chi delivers exactly the requested restitution c in a free impact.

    $$\chi (1 + c) = \ln \frac{1 + \chi}{1 - \chi c}$$

    The equation holds for any elastic force and is solved numerically for chi.

    Source: Y. Gonthier et al. 2004; J. Zhang, I. Sharf 2009.

    >>> law = cj.laws.ExactRestitution(restitution=0.8, stiffness=1e9)
    >>> print(f"{law.damping_factor():.4f}, delivers {law.delivered_restitution():.4f}")
    0.3731, delivers 0.8000
    """

    def damping_factor(self) -> Scalar:
        """Return the solution chi of chi (1 + c) = ln[(1 + chi)/(1 - chi c)]."""
        return exact_damping_factor(self.restitution)
