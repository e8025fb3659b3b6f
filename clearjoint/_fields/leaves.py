"""Order of names where JAX flattens dictionaries.

JAX sorts the keys of a dictionary when it flattens a PyTree. So whatever has passed through a
function of JAX is in the order of names, while a scene has its author's order. Columns, rows and
lists that are paired by position must not mix these two orders: they carry their names, or take
them from one object.
"""

from collections.abc import Mapping, Sequence
from typing import TypeVar

import equinox as eqx
import jax
from jaxtyping import PyTree

Tree = TypeVar("Tree")
Module = TypeVar("Module", bound=eqx.Module)


def with_leaves(
    tree: Tree,
    leaves: Sequence[PyTree],
    structure: jax.tree_util.PyTreeDef | None = None,  # pyright: ignore
) -> Tree:
    """Return a scene, a state or a pair of both with other leaves, and its names in the same order;
    `jax.tree.unflatten` and `equinox.tree_at` would sort them. `structure`: of `tree`, if known."""
    structure = jax.tree.structure(tree) if structure is None else structure
    return ordered_like(tree, jax.tree.unflatten(structure, leaves))


def ordered_like(tree: PyTree, other: PyTree) -> PyTree:
    """Put the dictionaries by name, such as `bodies`, of `other` into the order that they have in
    `tree`, and return `other`. Both are scenes, states or tuples of these. Dictionaries inside of
    joints, forces and other elements keep their order, which can't matter."""
    if type(other) is tuple:
        return tuple(ordered_like(*pair) for pair in zip(tree, other, strict=True))
    for name, part in vars(other).items() if isinstance(other, eqx.Module) else ():
        if isinstance(part, dict):
            # Modules are frozen: their own `__setattr__` would raise an error.
            object.__setattr__(other, name, _ordered(getattr(tree, name), part))
    return other


def with_fields(module: Module, values: Mapping[str, object]) -> Module:
    """Return a copy of a module with other values of some fields, neither converted nor checked."""
    copy = object.__new__(type(module))
    for name, value in {**vars(module), **values}.items():
        # Modules are frozen: their own `__setattr__` would raise an error.
        object.__setattr__(copy, name, value)
    return copy


def _ordered(names: dict[str, PyTree], part: dict[str, PyTree]) -> dict[str, PyTree]:
    """Return `part`, and its inner dictionaries, in the order of `names` unless the keys differ."""
    if names.keys() != part.keys():
        return part
    entries = ((name, inner, part[name]) for name, inner in names.items())
    return {n: _ordered(inner, e) if isinstance(e, dict) else e for n, inner, e in entries}
