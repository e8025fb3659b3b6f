"""Several alike elements in the place of one, and the names that stand for them.

All kernels are arithmetic on scalars (`clearjoint.math.vectors`), so an element whose numbers are
arrays of shape (n,) stands for n elements of the same structure. Its name is a `GroupName`.
Dictionaries by name, such as the motions of bodies, are turned by `by_group` into dictionaries by
such names, and back by `by_name`.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from .vectors import Condition, Scalar


class GroupName(str):
    """The name of several elements, each of which has a name of its own in `members`.

    It is a string, the same for the same members, so that it serves wherever names do.
    """

    members: tuple[str, ...]

    def __new__(cls, members: Iterable[str]) -> "GroupName":
        """The name of the elements with the given names, in this order."""
        members = tuple(members)
        name = super().__new__(cls, str(members))
        name.members = members
        return name

    def __getnewargs__(self) -> tuple[tuple[str, ...]]:
        # A copy is made of the members, as the name is: `str` would give its text to `__new__`.
        return (self.members,)


def is_structural(leaf: object) -> bool:
    """Whether a leaf is a Python number, which the alike elements share. numpy's floats are not."""
    return type(leaf) in (int, float, bool)


def stack(trees: Sequence[PyTree]) -> PyTree:
    """Trees of scalars as one whose leaves have the trees along their axis.

    The structure, and the Python numbers, are those of the first tree.
    """
    first, structure = jax.tree.flatten(trees[0])
    columns = zip(*(jax.tree.leaves(tree) for tree in trees), strict=True)
    leaves = [
        one if is_structural(one) else _row(column)
        for one, column in zip(first, columns, strict=True)
    ]
    return jax.tree.unflatten(structure, leaves)


def _row(scalars: Sequence[Scalar]) -> jax.Array | np.ndarray:
    numpy = jnp if any(isinstance(scalar, jax.Array) for scalar in scalars) else np
    return numpy.stack(scalars)


def element(tree: PyTree, index: int) -> PyTree:
    """One of several elements, by its place in the group."""
    return jax.tree.map(lambda leaf: leaf if is_structural(leaf) else leaf[..., index], tree)


def by_group(by_member: Mapping[str, PyTree], names: Iterable[str]) -> dict[str, PyTree]:
    """Values of elements, given by each element's own name, by names that may stand for several.

    Names for which there is no value are left out.
    """
    groups = {}
    for name in names:
        if not isinstance(name, GroupName):
            groups |= {name: by_member[name]} if name in by_member else {}
        elif name.members[0] in by_member:
            arrays = [jax.tree.map(jnp.asarray, by_member[member]) for member in name.members]
            groups[name] = stack(arrays)
    return groups


def by_name(groups: Mapping[str, PyTree]) -> dict[str, PyTree]:
    """The inverse of `by_group`: values by each element's own name."""
    by_member = {}
    for name, tree in groups.items():
        if isinstance(name, GroupName):
            by_member |= {member: element(tree, k) for k, member in enumerate(name.members)}
        else:
            by_member[name] = tree
    return by_member


def each(function: Callable[..., PyTree], *arguments: PyTree) -> PyTree:
    """Call any function once for all elements of a group, by `jax.vmap`.

    An argument's array of shape (n,) has one entry an element; scalars and Python numbers are
    shared by all. Python numbers in the result stay Python numbers.
    """
    leaves, structure = jax.tree.flatten(arguments)
    along = [not is_structural(leaf) and jnp.ndim(leaf) == 1 for leaf in leaves]
    shape: PyTree = None
    shared: list[Scalar | None] = []

    def one(own: list[Scalar]) -> list[Scalar]:
        nonlocal shape, shared
        remaining = iter(own)
        filled = [
            next(remaining) if mine else leaf for leaf, mine in zip(leaves, along, strict=True)
        ]
        values, shape = jax.tree.flatten(function(*jax.tree.unflatten(structure, filled)))
        shared = [leaf if is_structural(leaf) else None for leaf in values]
        return [leaf for leaf in values if not is_structural(leaf)]

    rows = iter(jax.vmap(one)([leaf for leaf, mine in zip(leaves, along, strict=True) if mine]))
    return jax.tree.unflatten(shape, [next(rows) if leaf is None else leaf for leaf in shared])


def sum_(value: Scalar) -> Scalar:
    """The sum over several elements; of one, the value itself."""
    return value if np.ndim(value) == 0 else jnp.sum(value)


def min_(value: Scalar) -> Scalar:
    """The smallest of several elements' values; of one, the value itself."""
    return value if np.ndim(value) == 0 else jnp.min(value)


def any_(value: Condition) -> Condition:
    """Whether a condition holds for any of several elements; of one, the value itself."""
    return value if np.ndim(value) == 0 else jnp.any(value)
