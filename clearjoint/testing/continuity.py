"""Where a function of one number jumps."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Float

PIECES = 64
HALVINGS = 100
ROUNDING = 1e-9
"""Part of a function's values below which a change is none."""
STAYS = 0.5
"""Part of the change after half of the halvings that a jump keeps."""


class Jumps(NamedTuple):
    """The largest jump in each of N intervals: its signed size, zero where there is none, and the
    place behind it."""

    sizes: Float[jax.Array, " N"]
    places: Float[jax.Array, " N"]


class _Piece(NamedTuple):
    """Pieces of the intervals, and the function's values at their ends; (pieces, N) each."""

    left: jax.Array
    right: jax.Array
    value_left: jax.Array
    value_right: jax.Array


def jumps(
    function: Callable[[jax.Array], jax.Array],
    left: Float[jax.Array, " N"],
    right: Float[jax.Array, " N"],
) -> Jumps:
    """The largest jump of a function in each of N intervals, and where it is.

    Each interval is cut into pieces. A piece is halved, and the half over which the function
    changes more is kept, until its ends are neighbours: what is left of the change is a jump if it
    was as large halfway, which that of a root of the place is not. A jump that is smaller than what
    the slope changes within a piece may be missed.

    **Arguments:** `function`: of (N,) places, one in each interval; `left`, `right`: (N,).
    """
    marks = jnp.linspace(left, right, PIECES + 1)
    values = jax.vmap(function)
    start = _Piece(marks[:-1], marks[1:], values(marks[:-1]), values(marks[1:]))

    def half(turn: jax.Array, state: tuple[_Piece, jax.Array]) -> tuple[_Piece, jax.Array]:
        piece, halfway = state
        change = jnp.abs(piece.value_right - piece.value_left)
        halfway = jnp.where(turn == HALVINGS // 2, change, halfway)
        middle = 0.5 * (piece.left + piece.right)
        value = values(middle)
        first = jnp.abs(value - piece.value_left) >= jnp.abs(piece.value_right - value)
        halves = (
            _Piece(piece.left, middle, piece.value_left, value),
            _Piece(middle, piece.right, value, piece.value_right),
        )
        return jax.tree.map(lambda *pair: jnp.where(first, *pair), *halves), halfway

    none = jnp.zeros_like(start.value_left)
    (_, places, low, high), halfway = jax.lax.fori_loop(0, HALVINGS, half, (start, none))
    scale = jnp.maximum(jnp.abs(start.value_left), jnp.abs(start.value_right))
    change = jnp.abs(high - low)
    jumps_there = (change > ROUNDING * scale) & (change > STAYS * halfway)
    sizes = jnp.where(jumps_there, high - low, 0.0)
    largest = jnp.argmax(jnp.abs(sizes), axis=0)[None]
    return Jumps(*(jnp.take_along_axis(rows, largest, axis=0)[0] for rows in (sizes, places)))
