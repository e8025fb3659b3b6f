"""The restitution that a Hunt-Crossley-like law delivers.

From v dv = -(K/m) delta^n (1 + chi v/v0) d(delta) over both phases of a free impact follows, for
any K, m, n and entry speed, chi (1 + e) = ln[(1 + chi)/(1 - chi e)].
"""

import jax
import jax.numpy as jnp
import optimistix
from jaxtyping import ArrayLike, Float

from ...math.vectors import Scalar

_SERIES_BELOW = 1e-5
"""Damping factor below which e = 1 - 2 chi/3 is closer than the rounded root."""
_NEWTON = optimistix.Newton(rtol=1e-14, atol=1e-14)
_MOST_STEPS = 32
"""Newton's method takes five from its start, for every damping factor."""


def delivered_restitution(damping_factor: Float[ArrayLike, "..."]) -> Float[jax.Array, "..."]:
    """Rebound speed over entry speed of a free impact.

    **Arguments:** `damping_factor`: chi of F = K delta^n (1 + chi rate/entry speed), not negative;
    a number or an array of any shape.

    **Returns:** the e of chi (1 + e) = ln[(1 + chi)/(1 - chi e)], in (0, 1], of the same shape;
    differentiable.
    """
    return _of_each(jnp.asarray(damping_factor, dtype=float))


@jnp.vectorize
def _of_each(damping_factor: jax.Array) -> jax.Array:
    """The relation solved for y = -ln(1 - chi e), which stays exact where chi e rounds to one."""
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
    """y - 1 + exp(-y) = chi - ln(1 + chi): rising and convex, so that Newton's method converges."""
    return y + jnp.expm1(-y) - loss
