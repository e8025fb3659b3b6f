"""The Hunt-Crossley contact laws: base classes, damping factors, delivered restitution."""

import abc
from dataclasses import fields, replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jaxtyping import ArrayLike, Float
from typing_extensions import override

from ..._fields.cautions import LawRangeWarning, caution
from ..._fields.checks import concrete, require, require_positive
from ..._fields.objects import optional_quantity, quantity
from ..._fields.types import Single
from ..._math.smoothing import positive_power, ramp, value_and_slope
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

_SERIES_BELOW = 1e-5
"""Damping factor chi below which the series 1 - 2 chi/3 of the delivered restitution is more
accurate than the numerical solution, which is rounded."""
_NEWTON = optimistix.Newton(rtol=1e-14, atol=1e-14)


def delivered_restitution(damping_factor: Float[ArrayLike, "..."]) -> Float[jax.Array, "..."]:
    r"""Return rebound speed over entry speed of a free impact with a Hunt-Crossley law.

    This ratio e is 1 for chi = 0. For chi > 0 it is the positive solution of

    $$\chi (1 + e) = \ln \frac{1 + \chi}{1 - \chi e}$$

    **Arguments:** `damping_factor`: chi, not negative; a number or an array of any shape.

    **Returns:** e in (0, 1], of the same shape; differentiable.

    >>> print(f"{cj.laws.delivered_restitution(0.3):.4f}")
    0.8329
    """
    return _solve_restitution(jnp.asarray(damping_factor, dtype=float))


@jnp.vectorize
def _solve_restitution(damping_factor: jax.Array) -> jax.Array:
    # The unknown is y = -ln(1 - chi e), which stays exact where chi e rounds to one. In terms
    # of y the equation is y - 1 + exp(-y) = loss, with loss = chi - ln(1 + chi). The left side is
    # about y^2/2 for small y and y - 1 for large y. It is convex and increases, so that Newton's
    # method converges from `start`, an upper bound of the solution. For small chi the series is
    # returned. `jnp.where` evaluates the numerical solution there too: it is then found for
    # `_SERIES_BELOW`, where the solution and its derivative are finite.
    small = damping_factor < _SERIES_BELOW
    chi = jnp.where(small, _SERIES_BELOW, damping_factor)
    loss = chi - jnp.log1p(chi)
    start = loss + jnp.sqrt(2.0 * loss)
    # Newton's method converges in a few steps for every damping factor: no check is needed.
    solution = optimistix.root_find(_residual, _NEWTON, start, args=loss, max_steps=32, throw=False)
    series = 1.0 - 2.0 * damping_factor / 3.0
    return jnp.where(small, series, -jnp.expm1(-solution.value) / chi)


def _residual(y: Scalar, loss: Scalar) -> Scalar:
    return y + jnp.expm1(-y) - loss


def exact_damping_factor(restitution: Float[ArrayLike, ""]) -> Scalar:
    """Return the damping factor chi with which a free impact delivers a given restitution.

    It inverts `delivered_restitution`, is zero for e = 1 and approximately 1/e for small e.

    **Arguments:** `restitution`: e in (0, 1].

    >>> chi = cj.laws.exact_damping_factor(0.8)
    >>> print(f"{cj.laws.delivered_restitution(chi):.6f}")
    0.800000
    """
    e = jnp.asarray(restitution, dtype=float)
    return -jnp.expm1(-_logarithm(e)) / e


@jax.custom_jvp
def _logarithm(e: Scalar) -> Scalar:
    """Return y = -ln(1 - chi e) for the damping factor chi that delivers the restitution e. Where
    chi e rounds to one, y keeps the digits that chi loses."""

    def step(_: int, y: Scalar) -> Scalar:
        value, slope = value_and_slope(lambda y: _relation(y, e), y)
        return y - value / slope

    # The start has the limits of y: 3 (1 - e)/2 near e = 1, and 1/e for small e. Three steps reach
    # rounding accuracy of chi for restitutions between 1e-8 and 1.
    return jax.lax.fori_loop(0, 3, step, 0.5 * (1.0 - e) * (2.0 + e) / e)


@_logarithm.defjvp
def _logarithm_along(primals: tuple[Scalar], tangents: tuple[Scalar]) -> tuple[Scalar, Scalar]:
    # `_relation` is zero for every e and its y, from which dy/de = -(dr/de)/(dr/dy) follows.
    (e,), (along,) = primals, tangents
    y = _logarithm(e)
    by_y = jax.grad(_relation)(y, e)
    by_e = jax.grad(_relation, argnums=1)(y, e)
    return y, -by_e / by_y * along


def _relation(y: Scalar, e: Scalar) -> Scalar:
    """Return a residual that increases with y and is zero for y = -ln(1 - chi e). The damping
    factor chi delivers the restitution e if chi (1 + e) = ln[(1 + chi)/(1 - chi e)], that is, if
    x - ln(1 + x) is the same for x = chi and x = -chi e. The residual is the difference of the
    square roots of twice these two values, divided by chi to remove the trivial root chi = 0."""
    chi_e = -jnp.expm1(-y)
    # The logarithm for x = -chi e is -y itself: computed from chi e, it would lose digits.
    return e * _chord(-chi_e, -y) - _chord(chi_e / e, jnp.log1p(chi_e / e))


def _chord(x: Scalar, logarithm: Scalar) -> Scalar:
    """Return sqrt(2 (x - ln(1 + x)))/|x|, from x > -1 and ln(1 + x); accurate near zero too."""
    near = jnp.abs(x) < 0.1
    # Both expressions are always evaluated: where one is not used, other numbers take the place of
    # x and its logarithm, so that value and derivative are finite.
    small = jnp.where(near, x, 0.0)
    large, logarithm = jnp.where(near, 1.0, x), jnp.where(near, 0.0, logarithm)
    series = jnp.polyval(_COEFFICIENTS, small)
    return jnp.sqrt(jnp.where(near, series, 2.0 * (large - logarithm) / large**2))


_COEFFICIENTS = np.array([2.0 * (-1.0) ** k / (k + 2) for k in range(18)][::-1])
"""Power series of 2 (x - ln(1 + x))/x^2, highest power first; its error within |x| < 0.1 is as
small as rounding."""


class AbstractHertzianLaw(AbstractPowerLaw):
    """Base class of laws F = K delta^n (1 + chi v/v0), or zero where this is negative.

    delta is the penetration, v its rate and v0 the entry speed. A subclass declares the fields
    below, sets the class attribute `uses_entry_speed` and defines the damping factor chi.

    - `stiffness`: K, a number in N/m^n, an `AbstractStiffness`, or an `AbstractCylinder`, whose
      force replaces K delta^n.
    - `exponent`: n, at least 1; a cylinder ignores it. Declare it as a static field, so that the
      compiled program can do without a general power for the values 1 and 1.5.
    - `smoothing`: width w in m over which the force begins smoothly; ``None`` for no smoothing, the
      only choice for cylinders. With a width, a ramp replaces the penetration: zero below delta =
      -w, the parabola (delta + w)^2/(4 w) up to delta = w, and delta above. A ramp of the same
      form, of width w/(w + max(delta, 0)), replaces the factor 1 + chi v/v0.

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

    smoothing: eqx.AbstractVar[Single | None]
    force_jumps = False

    @abc.abstractmethod
    def damping_factor(self) -> Scalar:
        """Return chi, dimensionless; the hysteresis damping factor of publications is chi K/v0."""

    @override
    def __check_init__(self):
        require_exponent(self.exponent)
        if self.smoothing is not None:
            require_positive("smoothing", self.smoothing, "give a width in m, or None")
            is_power = isinstance(self.stiffness, AbstractStiffness)
            expected = f"None with {type(self.stiffness).__name__}"
            remedy = "it smooths a power of the penetration"
            require(is_power, "smoothing", self.smoothing, expected, remedy)

    @override
    def onset_offset(self) -> Scalar:
        return 0.0 if self.smoothing is None else self.smoothing

    @override
    def slope_jumps(self) -> bool:
        return self.smoothing is None and super().slope_jumps()

    @override
    def elastic_force(self, gap: Gap) -> Scalar:
        if self.smoothing is not None:
            gap = replace(gap, depth=ramp(gap.depth, self.smoothing))
        return super().elastic_force(gap)

    @override
    def stored_energy(self, gap: Gap) -> Scalar:
        n, w = self.exponent, self.smoothing
        if w is None:
            return super().stored_energy(gap)
        assert isinstance(self.stiffness, AbstractStiffness)
        # The ramp is (delta + w)^2/(4 w) for |delta| < w, and delta above: one integral for each.
        inside = jnp.clip(gap.depth, -w, w) + w
        below = positive_power(inside, 2 * n + 1) / ((4 * w) ** n * (2 * n + 1))
        above = (positive_power(jnp.maximum(gap.depth, w), n + 1) - w ** (n + 1)) / (n + 1)
        return self.stiffness.value(gap) * (below + above)

    @override
    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        # A law without damping, such as `Hertz`.
        if entry_speed is None:
            return self.elastic_force(gap)
        # The quotient doesn't change during a step: in this order a step computes it only once.
        factor = 1.0 + (self.damping_factor() / entry_speed) * gap.rate
        width = self.smoothing
        if width is not None:
            # The width of the factor's ramp tends to zero at penetrations well above the smoothing
            # width. There the ramp is nearly max(factor, 0), as it is exactly without smoothing.
            width = width / (width + jnp.maximum(gap.depth, 0.0))
        return self.elastic_force(gap) * ramp(factor, width)

    def delivered_restitution(self) -> Scalar:
        """Return rebound speed over entry speed of a free impact, for a law without `smoothing`."""
        return delivered_restitution(self.damping_factor())


class Hertz(AbstractHertzianLaw):
    """Purely elastic contact, F = K delta^n (H. Hertz 1881).

    The arguments are those of `AbstractHertzianLaw`; n is 1.5 by default, without smoothing.

    >>> law = cj.laws.Hertz(stiffness=1e9)
    >>> print(f"{law.force(extend.Gap(depth=1e-4, rate=0.0), None):.1f}")  # N: 1e9 (1e-4)^1.5
    1000.0
    """

    stiffness: AbstractElasticity = eqx.field(converter=as_stiffness)
    exponent: float = eqx.field(default=1.5, static=True)
    smoothing: Single | None = optional_quantity("m")
    uses_entry_speed = False

    @override
    def damping_factor(self) -> Scalar:
        return 0.0


class MemorylessHuntCrossley(AbstractHertzianLaw):
    r"""Hunt-Crossley law with constant damping (K. H. Hunt, F. R. E. Crossley 1975).

    $$F = K \delta^n (1 + a \dot\delta), \quad a = \frac{3 (1 - c)}{2 v}$$

    The damping a equals that of `HuntCrossley` at the entry speed v, the `design_speed`, m/s,
    positive. The requested `restitution` c and the method `delivered_restitution` apply to impacts
    at this speed. Slower impacts lose a smaller part of their energy and faster impacts a larger
    one, as with metals. Choose this law where contacts begin slowly: the other damped laws then
    have a large damping, and the differential equations are stiff. Other arguments are those of
    `AbstractHertzianLaw`.

    >>> law = cj.laws.MemorylessHuntCrossley(restitution=0.8, stiffness=1e9, design_speed=0.1)
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

    @override
    def damping_factor(self) -> Scalar:
        return 1.5 * (1.0 - self.restitution)

    @override
    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        return super().force(gap, self.design_speed)


class AbstractDampedLaw(AbstractHertzianLaw):
    """Base class of Hunt-Crossley laws whose damping factor follows from a requested restitution c.

    c is the ratio of rebound speed to entry speed in a free impact. Most of the published damping
    factors deliver it only approximately: `delivered_restitution` computes the actual ratio, which
    the laws' examples print. Choose `ExactRestitution` except to reproduce published results.

    **Arguments:**

    - `restitution`: c, 0 to 1.
    - `stiffness`, `exponent`, `smoothing`: K, n and the width w in the formulas of
      `AbstractHertzianLaw`; n is 1.5 by default, and there is no smoothing.
    - `entry_speed_floor`: m/s, positive, 1e-6 by default, takes the place of slower entry speeds,
      because the damping diverges at zero entry speed.

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

    @override
    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        assert entry_speed is not None
        return super().force(gap, jnp.maximum(entry_speed, self.entry_speed_floor))


class HuntCrossley(AbstractDampedLaw):
    r"""Law of K. H. Hunt, F. R. E. Crossley 1975; D. W. Marhefka, D. E. Orin 1999.

    $$\chi = \frac{3 (1 - c)}{2}$$

    c is the requested restitution. The law delivers nearly c for c near 1, and 0.66 for c = 0.5.

    >>> print(f"{cj.laws.HuntCrossley(restitution=0.8, stiffness=1e9).delivered_restitution():.4f}")
    0.8329
    """

    @override
    def damping_factor(self) -> Scalar:
        return 1.5 * (1.0 - self.restitution)


class HerbertMcWhannell(AbstractDampedLaw):
    r"""Hunt-Crossley law with the damping factor of R. G. Herbert, D. C. McWhannell 1977.

    $$\chi = \frac{6 (1 - c)}{(2 c - 1)^2 + 3}$$

    c is the requested restitution. The law delivers nearly c for c near 1, and 0.59 for c = 0.5.

    >>> print(f"{cj.laws.HerbertMcWhannell(0.8, stiffness=1e9).delivered_restitution():.4f}")
    0.8070
    """

    @override
    def damping_factor(self) -> Scalar:
        return 6.0 * (1.0 - self.restitution) / ((2.0 * self.restitution - 1.0) ** 2 + 3.0)


class LeeWang(AbstractDampedLaw):
    r"""Hunt-Crossley law with the damping factor of T. W. Lee, A. C. Wang 1983.

    $$\chi = \frac{3 (1 - c)}{4}$$

    Near c = 1 the law dissipates half the energy that the requested restitution c requires. For c =
    0 the rebound speed is still 0.66 times the entry speed.

    >>> print(f"{cj.laws.LeeWang(restitution=0.8, stiffness=1e9).delivered_restitution():.4f}")
    0.9090
    """

    @override
    def damping_factor(self) -> Scalar:
        return 0.75 * (1.0 - self.restitution)


class LankaraniNikravesh(AbstractDampedLaw):
    r"""Law of H. M. Lankarani, P. E. Nikravesh 1990 (P. Flores et al. 2006, eq. 24).

    $$\chi = \frac{3 (1 - c^2)}{4}$$

    c is the requested restitution. The law delivers nearly c for c near 1, and 0.73 for c = 0.5.

    >>> print(f"{cj.laws.LankaraniNikravesh(0.8, stiffness=1e9).delivered_restitution():.4f}")
    0.8471
    """

    @override
    def damping_factor(self) -> Scalar:
        return 0.75 * (1.0 - self.restitution**2)


class ZhiyingQishao(AbstractDampedLaw):
    r"""Hunt-Crossley law with the damping factor of Q. Zhiying, L. Qishao 2006.

    $$\chi = \frac{3}{4} (1 - c^2) e^{2 (1 - c)}$$

    c is the requested restitution.

    >>> print(f"{cj.laws.ZhiyingQishao(0.8, stiffness=1e9).delivered_restitution():.4f}")
    0.7874
    """

    @override
    def damping_factor(self) -> Scalar:
        return 0.75 * (1.0 - self.restitution**2) * jnp.exp(2.0 * (1.0 - self.restitution))


class CarvalhoMartins(AbstractDampedLaw):
    r"""Hunt-Crossley law with the damping factor of A. S. Carvalho, J. M. Martins 2019.

    $$\chi = \frac{3 (1 - c) (11 - c)}{2 (1 + 9 c)}$$

    The delivered restitution differs from the requested one, c, by at most 2e-4 for c >= 0.5.

    >>> print(f"{cj.laws.CarvalhoMartins(0.8, stiffness=1e9).delivered_restitution():.4f}")
    0.8000
    """

    @override
    def damping_factor(self) -> Scalar:
        c = self.restitution
        return 1.5 * (1.0 - c) * (11.0 - c) / (1.0 + 9.0 * c)


class AbstractReboundingLaw(AbstractDampedLaw):
    """Base class of laws that refuse zero restitution, where their damping factor is infinite."""

    @override
    def __check_init__(self):
        require_rebound(self.restitution)


class Flores2011(AbstractReboundingLaw):
    r"""Hunt-Crossley law with the damping factor of P. Flores et al. 2011, for any c above 0.

    $$\chi = \frac{8 (1 - c)}{5 c}$$

    c is the requested restitution. K. Ye et al. 2009 derived the same factor for the exponent 1.5.

    >>> print(f"{cj.laws.Flores2011(restitution=0.8, stiffness=1e9).delivered_restitution():.4f}")
    0.7885
    """

    @override
    def damping_factor(self) -> Scalar:
        return 1.6 * (1.0 - self.restitution) / self.restitution


class Gonthier(AbstractReboundingLaw):
    r"""Hunt-Crossley law with the damping factor of Y. Gonthier et al. 2004.

    $$\chi = \frac{1 - c^2}{c}$$

    c is the requested restitution. The factor approximates that of `ExactRestitution`.

    >>> print(f"{cj.laws.Gonthier(restitution=0.8, stiffness=1e9).delivered_restitution():.4f}")
    0.7680
    """

    @override
    def damping_factor(self) -> Scalar:
        return (1.0 - self.restitution**2) / self.restitution


class GharibHurmuzlu(AbstractReboundingLaw):
    r"""Hunt-Crossley law with the damping factor of M. Gharib, Y. Hurmuzlu 2012, for c near 0.

    $$\chi = \frac{1}{c}$$

    c is the requested restitution. The delivered one never exceeds 0.594, its value for c = 1.

    >>> print(f"{cj.laws.GharibHurmuzlu(0.2, stiffness=1e9).delivered_restitution():.4f}")
    0.1970
    """

    @override
    def damping_factor(self) -> Scalar:
        return 1.0 / self.restitution


class HuGuo(AbstractReboundingLaw):
    r"""Hunt-Crossley law with the damping factor of S. Hu, X. Guo 2015.

    $$\chi = \frac{3 (1 - c)}{2 c}$$

    c is the requested restitution.

    >>> print(f"{cj.laws.HuGuo(restitution=0.8, stiffness=1e9).delivered_restitution():.4f}")
    0.7992
    """

    @override
    def damping_factor(self) -> Scalar:
        return 1.5 * (1.0 - self.restitution) / self.restitution


class SafaeifarFarshidianfar(AbstractReboundingLaw):
    r"""Hunt-Crossley law with the damping factor of H. Safaeifar, A. Farshidianfar 2020.

    $$\chi = \frac{5 (1 - c)}{4 c}$$

    c is the requested restitution.

    >>> print(f"{cj.laws.SafaeifarFarshidianfar(0.8, stiffness=1e9).delivered_restitution():.4f}")
    0.8271
    """

    @override
    def damping_factor(self) -> Scalar:
        return 1.25 * (1.0 - self.restitution) / self.restitution


class YePounding(AbstractReboundingLaw):
    r"""Law of K. Ye et al. 2009 for colliding buildings; by default with a linear spring (n = 1).

    $$\chi = \frac{3 (1 - c)}{2 c}$$

    c is the requested restitution.

    >>> print(f"{cj.laws.YePounding(restitution=0.8, stiffness=1e9).delivered_restitution():.4f}")
    0.7992
    """

    exponent: float = eqx.field(default=1.0, static=True)

    @override
    def damping_factor(self) -> Scalar:
        return 1.5 * (1.0 - self.restitution) / self.restitution


class PantWijeyewickrema(AbstractReboundingLaw):
    r"""Law of D. R. Pant, A. C. Wijeyewickrema 2012; by default with a linear spring (n = 1).

    $$\chi = \frac{3 (1 - c^2)}{2 c^2}$$

    The delivered restitution is far below the requested one, c: 0.22 for c = 0.5, and 0.81 for c =
    0.9. Use this law only to reproduce published results; it warns of any c below 1 with a
    `LawRangeWarning`.

    >>> import warnings
    >>> warnings.filterwarnings("ignore", category=cj.LawRangeWarning)
    >>> law = cj.laws.PantWijeyewickrema(restitution=0.9, stiffness=1e6)
    >>> print(f"{law.delivered_restitution():.4f}")
    0.8093
    """

    exponent: float = eqx.field(default=1.0, static=True)

    @override
    def _caution_together(self) -> None:
        requested = concrete(self.restitution)
        if requested is not None and requested < 1.0:
            caution(
                f"`PantWijeyewickrema` delivers far less than the requested restitution of "
                f"{float(requested):g}, for example 0.22 for 0.5: use `ExactRestitution`.",
                LawRangeWarning,
            )

    @override
    def damping_factor(self) -> Scalar:
        return 1.5 * (1.0 - self.restitution**2) / self.restitution**2


class ExactRestitution(AbstractReboundingLaw):
    r"""Hunt-Crossley law that delivers exactly the requested restitution c (Gonthier et al. 2004).

    $$\chi (1 + c) = \ln \frac{1 + \chi}{1 - \chi c}$$

    The equation for the damping factor chi holds for any elastic force (J. Zhang, I. Sharf 2009).

    >>> print(f"{cj.laws.ExactRestitution(0.8, stiffness=1e9).delivered_restitution():.4f}")
    0.8000
    """

    @override
    def damping_factor(self) -> Scalar:
        return exact_damping_factor(self.restitution)

    @override
    def prepared(self) -> AbstractReboundingLaw:
        # Computed in every evaluation of the force, the factor took four fifths of a step's time.
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return _KnownFactor(**values, factor=self.damping_factor())


class _KnownFactor(AbstractReboundingLaw):
    """An `ExactRestitution` whose damping factor is known."""

    factor: Scalar = 0.0

    @override
    def damping_factor(self) -> Scalar:
        return self.factor
