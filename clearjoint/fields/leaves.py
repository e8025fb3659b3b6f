"""Order of names where JAX flattens dictionaries.

JAX sorts the keys of a dictionary when it flattens a PyTree, and leaves them sorted when it makes
the PyTree again. So whatever has passed through a function of JAX is in the order of names, while
a scene has the order in which its author wrote it down. Columns, rows and lists that are paired by
position must not mix the two: they carry their names, or take them from one object.
"""

from collections.abc import Iterable, Sequence
from dataclasses import fields
from typing import TypeVar

import equinox as eqx
import jax
from jaxtyping import PyTree

Tree = TypeVar("Tree")


def in_order_of_leaves(names: Iterable[str]) -> list[str]:
    """Return the keys of a dictionary in the order in which JAX flattens it."""
    return sorted(names)


def with_leaves(tree: Tree, leaves: Sequence[PyTree]) -> Tree:
    """Return a PyTree with other leaves, and with its dictionaries in their own order.

    `jax.tree.unflatten` and `equinox.tree_at` return sorted dictionaries instead. Use this function
    for scenes and states that are returned to a user, or whose names are paired with columns.

    **Arguments:** `leaves`: in the order of `jax.tree.leaves`.
    """
    return ordered_like(tree, jax.tree.unflatten(jax.tree.structure(tree), leaves))


def ordered_like(tree: PyTree, other: Tree) -> Tree:
    """Return `other` with the entries of its dictionaries in the order of those of `tree`.

    A part of `other` that has another class or other keys than that of `tree` is returned as it is.

    **Arguments:** `other`: a new PyTree, whose Equinox modules are changed in place.
    """
    if type(tree) is not type(other):
        return other
    if isinstance(other, eqx.Module):
        for field in fields(other):
            if not field.metadata.get("static", False):
                part = getattr(other, field.name)
                ordered = ordered_like(getattr(tree, field.name), part)
                if ordered is not part:
                    # Modules are frozen, so their fields are set by `object`.
                    object.__setattr__(other, field.name, ordered)
        return other
    if type(other) is dict and tree.keys() == other.keys():
        return {key: ordered_like(tree[key], other[key]) for key in tree}  # pyright: ignore
    if type(other) in (list, tuple) and len(tree) == len(other):
        return type(other)(ordered_like(*pair) for pair in zip(tree, other, strict=True))
    return other
