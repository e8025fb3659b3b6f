"""Compare a contact law's derivatives by rate, entry speed and parameters with differences."""

from collections.abc import Callable, Iterator

import equinox as eqx
import jax
import jax.numpy as jnp

from ..math.vectors import Condition, Scalar
from ..model.contact.laws import AbstractContactLaw

POINTS = (
    (1.3e-6, 2e-3, 0.11),
    (1.3e-6, 0.07, 0.11),
    (1.3e-6, -3e-3, 0.11),
    (7e-6, 0.9, 10.0),
    (7e-6, -3e-3, 10.0),
)
"""Tested points at which usual laws are smooth: penetration, m, penetration rate, m/s, and entry
speed, m/s."""
STEP = 1e-6
"""Step of finite differences, relative to the number that is changed."""
TOLERANCE = 1e-5
"""Largest accepted error of a derivative, relative to its size plus a thousandth of the force."""
Force = Callable[[Scalar, Scalar, Scalar, AbstractContactLaw], jax.Array]
"""Function of penetration, m, penetration rate and entry speed, m/s, and law; it returns the normal
force, N."""


def complaints_of_sensitivities(force: Force, law: AbstractContactLaw) -> Iterator[str]:
    """Yield a message for each derivative of the force, by the rate, by the entry speed or by a
    parameter of the law, that does not agree with finite differences."""
    depth, rate, entry = jnp.asarray(POINTS).T
    law = jax.tree.map(jnp.asarray, law)
    forces = jax.vmap(force, in_axes=(0, 0, 0, None))

    slopes = jax.vmap(jax.grad(force, argnums=(1, 2)), in_axes=(0, 0, 0, None))
    by_rate, by_entry = slopes(depth, rate, entry, law)
    yield from _complaint(
        "the rate",
        by_rate * rate,
        lambda factor: forces(depth, rate * factor, entry, law),
    )
    yield from _complaint(
        "the entry speed",
        by_entry * entry,
        lambda factor: forces(depth, rate, entry * factor, law),
    )
    numbers, rest = eqx.partition(law, eqx.is_inexact_array)
    leaves, structure = jax.tree.flatten(numbers)

    def with_leaf(k: int, leaf: jax.Array) -> jax.Array:
        changed = jax.tree.unflatten(structure, [*leaves[:k], leaf, *leaves[k + 1 :]])
        return forces(depth, rate, entry, eqx.combine(changed, rest))

    for k, (path, leaf) in enumerate(jax.tree_util.tree_leaves_with_path(numbers)):
        scale = jnp.where(jnp.any(leaf != 0.0), leaf, 1.0)
        _, slope = jax.jvp(lambda leaf, k=k: with_leaf(k, leaf), (leaf,), (scale,))
        yield from _complaint(
            f"`{jax.tree_util.keystr(path).lstrip('.')}`",
            slope,
            lambda factor, k=k, leaf=leaf, scale=scale: with_leaf(k, leaf + (factor - 1.0) * scale),
        )


def _complaint(name: str, exact: jax.Array, forces: Callable[[float], jax.Array]) -> Iterator[str]:
    """Yield a message if `exact` (P,), the derivatives at `POINTS`, differ from finite differences.

    **Arguments:** `name`: of the number by which is differentiated, for the message; `forces`:
    returns the forces (P,), N, if this number is multiplied by a factor. `exact` are the
    derivatives by this factor at one.
    """
    numeric = (forces(1.0 + STEP) - forces(1.0 - STEP)) / (2.0 * STEP)
    allowed = TOLERANCE * (jnp.abs(exact) + 1e-3 * jnp.abs(forces(1.0)))
    wrong: Condition = jnp.abs(exact - numeric) > allowed
    if bool(jnp.any(wrong)):
        depth, rate, entry = POINTS[int(jnp.argmax(wrong))]
        yield (
            f"The derivative by {name} does not agree with finite differences of the force, at a "
            f"depth of {depth} m, a rate of {rate} m/s and an entry speed of {entry} m/s."
        )
