"""The restitution that a Hunt-Crossley-like law delivers.

From v dv = -(K/m) delta^n (1 + chi v/v0) d(delta) over both phases of a free impact follows, for
any K, m, n and entry speed, chi (1 + e) = ln[(1 + chi)/(1 - chi e)].
"""

from typing import Any

import jax
import jax.numpy as jnp

_SERIES_BELOW = 1e-5
_BISECTIONS = 60


def _residual(e: Any, chi: Any) -> Any:
    return chi * (1.0 + e) - jnp.log1p(chi) + jnp.log1p(-chi * e)


@jax.custom_jvp
def delivered_restitution(damping_factor: Any) -> Any:
    """Rebound speed over entry speed of a free impact.

    **Arguments:** `damping_factor`: chi of F = K delta^n (1 + chi rate/entry speed), not negative.

    **Returns:** the e of chi (1 + e) = ln[(1 + chi)/(1 - chi e)], in (0, 1]; differentiable.
    """
    chi = jnp.asarray(damping_factor, dtype=float)
    safe = jnp.maximum(chi, _SERIES_BELOW)

    def halve(_: Any, bracket: tuple[Any, Any]) -> tuple[Any, Any]:
        lower, upper = bracket
        middle = 0.5 * (lower + upper)
        below = _residual(middle, safe) > 0.0
        return jnp.where(below, middle, lower), jnp.where(below, upper, middle)

    start = (jnp.zeros_like(safe), jnp.minimum(1.0, (1.0 - 1e-16) / safe))
    lower, upper = jax.lax.fori_loop(0, _BISECTIONS, halve, start)
    return jnp.where(chi < _SERIES_BELOW, 1.0 - 2.0 * chi / 3.0, 0.5 * (lower + upper))


@delivered_restitution.defjvp
def _delivered_restitution_jvp(primals: tuple[Any], tangents: tuple[Any]) -> tuple[Any, Any]:
    (chi,), (dchi,) = primals, tangents
    e = delivered_restitution(chi)
    safe = jnp.maximum(chi, _SERIES_BELOW)
    # Both slopes times 1 - chi e, which rounds to zero for strong damping.
    left = 1.0 - safe * e
    by_chi = left * (1.0 + e - 1.0 / (1.0 + safe)) - e
    by_e = safe * (left - 1.0)
    slope = jnp.where(chi < _SERIES_BELOW, -2.0 / 3.0, -by_chi / by_e)
    return e, slope * dchi
