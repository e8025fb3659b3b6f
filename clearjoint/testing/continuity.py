"""Motions of bodies for checks, and jumps of scalar functions in intervals."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Float

from .._fields.checks import as_number, require, require_shape
from .._math.rotations import normalised, rotation_matrix, turned
from .._math.vectors import EulerParameters, Vector
from .._model.bodies import Motion

PIECES = 64
"""Number of pieces into which each interval is divided."""
HALVINGS = 100
"""Number of bisections of each piece. The last ends are adjacent floats or, near zero, closer than
1e-30 of the piece's width."""
ROUNDING = 1e-9
"""A change of the function below this fraction of its values counts as rounding error."""
STAYS = 0.5
"""A change that remains after all bisections is a jump if it exceeds this fraction of the change
after half of them. The change of a continuous function, even a square root, decreases further."""


class Jumps(NamedTuple):
    """The largest jump of a function in each of N intervals: `sizes`, the value on the right minus
    the value on the left, zero without a jump; and `positions`, the function's arguments there."""

    sizes: Float[jax.Array, " N"]
    positions: Float[jax.Array, " N"]


def jumps(
    function: Callable[[jax.Array], jax.Array],
    left: Float[jax.Array, " N"],
    right: Float[jax.Array, " N"],
) -> Jumps:
    """Return the largest jump of a function in each of N intervals, from `left` to `right`. The
    function takes an array (N,), with a point in each interval, and returns its values there, (N,).

    Each interval is divided into pieces. Each piece is bisected until its ends are practically
    adjacent floats; the half with the larger change of the function is kept. A jump that is smaller
    than the continuous change of the function within a piece may be missed.
    """
    # The ends of all pieces, and the values there, are arrays (2, pieces, N): left, right.
    edges, values_at = jnp.linspace(left, right, PIECES + 1), jax.vmap(function)
    ends, heights = (jnp.stack([rows[:-1], rows[1:]]) for rows in (edges, values_at(edges)))

    # The bisection `k` of all pieces: `low` and `high` are the values at the left and right ends.
    def bisect(k: jax.Array, state: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
        (left, right), (low, high), halfway = state
        # The change that is left after half of all bisections.
        halfway = jnp.where(k == HALVINGS // 2, jnp.abs(high - low), halfway)
        middle = 0.5 * (left + right)
        value = values_at(middle)
        is_left = jnp.abs(value - low) >= jnp.abs(high - value)
        ends = jnp.where(is_left, jnp.stack([left, middle]), jnp.stack([middle, right]))
        heights = jnp.where(is_left, jnp.stack([low, value]), jnp.stack([value, high]))
        return ends, heights, halfway

    state = ends, heights, jnp.zeros_like(heights[0])
    (_, positions), (low, high), halfway = jax.lax.fori_loop(0, HALVINGS, bisect, state)
    # Without a jump, the change has become smaller than rounding errors, or still decreases.
    scale = jnp.abs(heights).max(axis=0)
    change = jnp.abs(high - low)
    is_jump = (change > ROUNDING * scale) & (change > STAYS * halfway)
    sizes = jnp.where(is_jump, high - low, 0.0)
    # Of the pieces of each interval, the one with the largest jump.
    largest = jnp.argmax(jnp.abs(sizes), axis=0)[None]
    return Jumps(*(jnp.take_along_axis(rows, largest, axis=0)[0] for rows in (sizes, positions)))


def moving(
    position: Sequence[float],
    orientation: Sequence[float],
    velocity: Sequence[float],
    spin: Sequence[float],
) -> Motion:
    """Return the motion of a body, for `check_constraint`, `check_force` and `check_contact_joint`.

    **Arguments:**

    - `position`, `velocity`: of the centre of mass, m and m/s, in global axes.
    - `orientation`: Euler parameters, scalar first, of any length except zero.
    - `spin`: angular velocity in body axes, rad/s.

    >>> arm = testing.moving((0.5, 0, 0), (1, 0, 0, 0), velocity=(0, 1, 0), spin=(0, 0, 2))
    >>> arm.spin.z
    2
    """
    counts = (position, 3), (orientation, 4), (velocity, 3), (spin, 3)
    names = ("position", "orientation", "velocity", "spin")
    for name, (value, count) in zip(names, counts, strict=True):
        require_shape(name, as_number(value, name), (count,), f"pass {count} numbers")
    has_length, remedy = any(part != 0.0 for part in orientation), "pass (1, 0, 0, 0) for none"
    require(has_length, "orientation", orientation, "other than zero", remedy)
    parameters = normalised(EulerParameters(*orientation))
    return Motion(Vector(*position), rotation_matrix(parameters), Vector(*velocity), Vector(*spin))


def moved(motions: Mapping[str, Motion], time: float) -> dict[str, Motion]:
    """Return motions after a short `time`, s, at constant global velocities and spins in body axes;
    the error of the rotation grows with the third power of the time."""
    after = {}
    for name, motion in motions.items():
        position = motion.position + motion.velocity * time
        further = rotation_matrix(turned(EulerParameters(1.0, 0.0, 0.0, 0.0), motion.spin * time))
        rotation = motion.rotation @ further
        after[name] = replace(motion, position=position, rotation=rotation)
    return after


def at_rest(motions: Mapping[str, Motion]) -> dict[str, Motion]:
    """Return motions with zero velocities and spins."""
    return {n: replace(m, velocity=m.velocity * 0.0, spin=m.spin * 0.0) for n, m in motions.items()}
