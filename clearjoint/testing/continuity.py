"""Where a function of one number jumps."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

PIECES = 64
HALVINGS = 100
ROUNDING = 1e-9
"""Part of a function's values below which a change is none."""


def jumps(function: Callable[[Any], Any], left: Any, right: Any) -> tuple[Any, Any]:
    """The largest jump of a function in each of N intervals, and where it is.

    Each interval is cut into pieces. A piece is halved, and the half over which the function
    changes more is kept, until its ends are neighbours: what is left of the change is a jump. One
    that is smaller than what the slope changes within a piece may be missed.

    **Arguments:** `function`: of (N,) places, one in each interval; `left`, `right`: (N,).

    **Returns:** (N,) signed jumps, zero where there is none, and (N,) places behind them.
    """
    marks = jnp.linspace(left, right, PIECES + 1)
    values = jax.vmap(function)
    start = marks[:-1], marks[1:], values(marks[:-1]), values(marks[1:])

    def halved(_: Any, piece: Any) -> Any:
        a, b, low, high = piece
        middle = 0.5 * (a + b)
        half = values(middle)
        first = jnp.abs(half - low) >= jnp.abs(high - half)
        left = a, middle, low, half
        right = middle, b, half, high
        return tuple(jnp.where(first, *pair) for pair in zip(left, right, strict=True))

    _, places, low, high = jax.lax.fori_loop(0, HALVINGS, halved, start)
    scale = jnp.maximum(jnp.abs(start[2]), jnp.abs(start[3]))
    sizes = jnp.where(jnp.abs(high - low) > ROUNDING * scale, high - low, 0.0)
    largest = jnp.argmax(jnp.abs(sizes), axis=0)[None]
    found = [jnp.take_along_axis(rows, largest, axis=0)[0] for rows in (sizes, places)]
    return found[0], found[1]
