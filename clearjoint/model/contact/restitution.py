"""Delivered restitution of Hunt-Crossley laws, and the damping factor that delivers a given one.

The delivered restitution e is the ratio of rebound speed to entry speed in a free impact of a mass
m. With the penetration delta, its rate v, the entry speed v0 and the damping factor chi, the motion
follows v dv = -(f(delta)/m) (1 + chi v/v0) d(delta). The integral over compression and rebound is
chi (1 + e) = ln[(1 + chi)/(1 - chi e)], for any elastic force f, mass and entry speed.
"""

import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jaxtyping import ArrayLike, Float

from ...math.vectors import Scalar

_SERIES_BELOW = 1e-5
"""Damping factor below which e = 1 - 2 chi/3 is more accurate than the numerical solution, which is
rounded."""
_NEWTON = optimistix.Newton(rtol=1e-14, atol=1e-14)
_MOST_STEPS = 32
"""Step limit of Newton's method, which needs five steps for every damping factor."""


def delivered_restitution(damping_factor: Float[ArrayLike, "..."]) -> Float[jax.Array, "..."]:
    r"""Return rebound speed over entry speed of a free impact with a Hunt-Crossley law.

    $$\chi (1 + e) = \ln \frac{1 + \chi}{1 - \chi e}$$

    **Arguments:** `damping_factor`: chi of F = K delta^n (1 + chi rate/entry speed), not negative;
    a number or an array of any shape.

    **Returns:** the solution e in (0, 1], of the same shape; differentiable.

    >>> print(f"{cj.laws.delivered_restitution(0.3):.4f}")
    0.8329
    """
    return _solve_restitution(jnp.asarray(damping_factor, dtype=float))


@jnp.vectorize
def _solve_restitution(damping_factor: jax.Array) -> jax.Array:
    """Return the restitution e for one damping factor chi, a scalar."""
    # The unknown is y = -ln(1 - chi e), which stays exact where chi e rounds to one. In it the
    # equation is y - 1 + exp(-y) = chi - ln(1 + chi). The left side is about y^2/2 for small y.
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
    """Return the residual y - 1 + exp(-y) - loss of the unknown y.

    It increases with y > 0 and is convex, so that Newton's method converges.
    """
    return y + jnp.expm1(-y) - loss


_SERIES_TERMS = 18
"""Number of terms of the power series of `_chord`, with which it is exact to rounding."""
_SERIES_WITHIN = 0.1
"""Largest absolute value of x for which `_chord` is computed by its power series."""
_EXACT_STEPS = 5
"""Steps of Newton's method; four reach rounding accuracy for restitutions between 1e-6 and 1."""


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
    """Return y = -ln(1 - chi e) for a restitution e.

    Unlike chi e, y doesn't lose digits where chi e rounds to one.
    """
    # Start from the factor of Carvalho and Martins, which is accurate to four digits above 0.5, or
    # for e up to 0.4 from one above the asymptote y = 1 + 1/e - ln(1 + 1/e). The minimum keeps the
    # logarithm finite where the other start is used.
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
    """Return y and its tangent, -(dr/de)/(dr/dy) times that of e, for the residual r = 0 of
    `_relation`."""
    (e,), (along,) = primals, tangents
    y = _logarithm(e)
    by_y = jax.grad(_relation)(y, e)
    by_e = jax.grad(_relation, argnums=1)(y, e)
    return y, -by_e / by_y * along


def _relation(y: Scalar, e: Scalar) -> Scalar:
    """Return a residual that increases with y and is zero for the unknown y = -ln(1 - chi e).

    The equation chi (1 + e) = ln[(1 + chi)/(1 - chi e)] states that x - ln(1 + x) is the same for
    x = chi and x = -chi e. The residual is the difference of the square roots, divided by chi and
    thus without the trivial root chi = 0.
    """
    loss = -jnp.expm1(-y)
    return e * _chord(-loss, -y) - _chord(loss / e, jnp.log1p(loss / e))


def _chord(x: Scalar, logarithm: Scalar) -> Scalar:
    """Return sqrt(2 (x - ln(1 + x)))/|x|, accurate near zero too.

    **Arguments:** `x`: above -1; `logarithm`: ln(1 + x), which the caller knows more accurately.
    """
    near = jnp.abs(x) < _SERIES_WITHIN
    small = jnp.where(near, x, 0.0)
    large, logarithm = jnp.where(near, 1.0, x), jnp.where(near, 0.0, logarithm)
    series = jnp.polyval(_COEFFICIENTS, small)
    return jnp.sqrt(jnp.where(near, series, 2.0 * (large - logarithm) / large**2))


_COEFFICIENTS = np.array([2.0 * (-1.0) ** k / (k + 2) for k in range(_SERIES_TERMS)][::-1])
"""Power series of 2 (x - ln(1 + x))/x^2, highest power first."""
