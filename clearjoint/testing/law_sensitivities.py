"""The derivatives of a law's force against differences: by the rate, the entry speed, and each of
the law's numbers."""

from collections.abc import Callable, Iterator

import equinox as eqx
import jax
import jax.numpy as jnp

from ..math.vectors import Condition, Scalar
from ..model.contact.laws import AbstractContactLaw

PLACES = (
    (1.3e-6, 2e-3, 0.11),
    (1.3e-6, 0.07, 0.11),
    (1.3e-6, -3e-3, 0.11),
    (7e-6, 0.9, 10.0),
    (7e-6, -3e-3, 10.0),
)
"""Depths in m, rates and entry speeds in m/s at which laws are smooth: neither at a clamp nor at a
floor."""
STEP = 1e-6
"""Of a difference, as a part of the number."""
TOLERANCE = 1e-5
"""Of a derivative, as a part of it and of a thousandth of the force."""
Force = Callable[[Scalar, Scalar, Scalar, AbstractContactLaw], jax.Array]


def complaints_of_sensitivities(force: Force, law: AbstractContactLaw) -> Iterator[str]:
    """What is wrong with the derivatives of a force of depth, rate, entry speed and law."""
    depth, rate, entry = jnp.asarray(PLACES).T
    law = jax.tree.map(jnp.asarray, law)
    forces = jax.vmap(force, in_axes=(0, 0, 0, None))

    by_place = jax.vmap(jax.grad(force, argnums=(1, 2)), in_axes=(0, 0, 0, None))
    by_rate, by_entry = by_place(depth, rate, entry, law)
    yield from _complaint(
        "the rate",
        by_rate * rate,
        lambda part: forces(depth, rate * part, entry, law),
    )
    yield from _complaint(
        "the entry speed",
        by_entry * entry,
        lambda part: forces(depth, rate, entry * part, law),
    )
    numbers, rest = eqx.partition(law, eqx.is_inexact_array)
    leaves, structure = jax.tree.flatten(numbers)

    def of_leaf(k: int, leaf: jax.Array) -> jax.Array:
        changed = jax.tree.unflatten(structure, [*leaves[:k], leaf, *leaves[k + 1 :]])
        return forces(depth, rate, entry, eqx.combine(changed, rest))

    for k, (path, leaf) in enumerate(jax.tree_util.tree_leaves_with_path(numbers)):
        along = jnp.where(jnp.any(leaf != 0.0), leaf, 1.0)
        _, slope = jax.jvp(lambda leaf, k=k: of_leaf(k, leaf), (leaf,), (along,))
        yield from _complaint(
            f"`{jax.tree_util.keystr(path).lstrip('.')}`",
            slope,
            lambda part, k=k, leaf=leaf, along=along: of_leaf(k, leaf + (part - 1.0) * along),
        )


def _complaint(name: str, exact: jax.Array, forces: Callable[[float], jax.Array]) -> Iterator[str]:
    """What to say if a derivative (P,) is not that of the forces (P,) of a number times a part."""
    numeric = (forces(1.0 + STEP) - forces(1.0 - STEP)) / (2.0 * STEP)
    allowed = TOLERANCE * (jnp.abs(exact) + 1e-3 * jnp.abs(forces(1.0)))
    wrong: Condition = jnp.abs(exact - numeric) > allowed
    if bool(jnp.any(wrong)):
        depth, rate, entry = PLACES[int(jnp.argmax(wrong))]
        yield (
            f"The derivative by {name} is not that of the force, at a depth of {depth} m, a rate "
            f"of {rate} m/s and an entry speed of {entry} m/s."
        )
