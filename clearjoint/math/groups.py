"""Groups of elements of the same structure, which are computed at once.

Elements are bodies or clearance joints. All computations on them are scalar arithmetic
(`clearjoint.math.vectors`), which also works for arrays. So a group of n elements of the same
structure is an element whose numbers are arrays of shape (n,), and whose name is a `GroupName`.
`by_group` converts dictionaries by names of elements, such as motions of bodies, to dictionaries by
names of groups, and `by_name` converts these back.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from .vectors import Condition, Scalar, library


class GroupName(str):
    """Name of a group of elements.

    It is a string, and can be used wherever names are. Two names with the same members are equal.

    - `members`: names of the elements, in order.
    """

    members: tuple[str, ...]

    def __new__(cls, members: Iterable[str]) -> "GroupName":
        """Return the name of a group of elements with the given names, in this order."""
        members = tuple(members)
        name = super().__new__(cls, str(members))
        name.members = members
        return name

    def __getnewargs__(self) -> tuple[tuple[str, ...]]:
        # Copies and pickles call `__new__` with the members; `str` would pass its text.
        return (self.members,)


def is_structural(leaf: object) -> bool:
    """Return whether a leaf of a PyTree is structural: a Python number, but not one of NumPy.

    Structural numbers are known while JAX traces; most are exact zeros and ones, on which
    operations are omitted. All elements of a group have the same ones, so they need no array.
    """
    return type(leaf) in (int, float, bool)


def stack(trees: Sequence[PyTree]) -> PyTree:
    """Return n PyTrees of scalars, of the same structure, as one PyTree of arrays (n,).

    Leaves that are Python numbers stay Python numbers; they are those of the first PyTree.
    """
    first, structure = jax.tree.flatten(trees[0])
    columns = zip(*(jax.tree.leaves(tree) for tree in trees), strict=True)
    leaves = [
        leaf if is_structural(leaf) else library(column).stack(column)
        for leaf, column in zip(first, columns, strict=True)
    ]
    return jax.tree.unflatten(structure, leaves)


def element(tree: PyTree, index: int) -> PyTree:
    """Return one of the n elements of a group: a PyTree with arrays (...), from one with arrays
    (..., n)."""
    return jax.tree.map(lambda leaf: leaf if is_structural(leaf) else leaf[..., index], tree)


def by_group(by_member: Mapping[str, PyTree], names: Iterable[str]) -> dict[str, PyTree]:
    """Return values by names of elements and groups, from values by names of elements.

    The values of the elements of a group become arrays (n,). Names without a value are omitted, as
    are groups whose first element has none.

    **Arguments:** `by_member`: PyTrees of scalars by name of the element; `names`: the names of
    elements and groups.
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
    """Return values by names of elements, from values by names of elements and groups."""
    by_member = {}
    for name, tree in groups.items():
        if isinstance(name, GroupName):
            by_member |= {member: element(tree, k) for k, member in enumerate(name.members)}
        else:
            by_member[name] = tree
    return by_member


def each(function: Callable[..., PyTree], *arguments: PyTree) -> PyTree:
    """Call a function once for all n elements of a group, by `jax.vmap`.

    This is for functions that use arrays for one element, such as methods of user-defined classes.
    Functions that consist of scalar arithmetic take the arrays (n,) directly.

    **Arguments:** `arguments`: PyTrees. Their arrays of shape (n,), of which there must be at least
    one, have one entry for each element; all other leaves are the same for all elements.

    **Returns:** the function's result with arrays (n, ...) in place of arrays (...). Python numbers
    in the result stay Python numbers.
    """
    leaves, structure = jax.tree.flatten(arguments)
    mapped = [not is_structural(leaf) and jnp.ndim(leaf) == 1 for leaf in leaves]
    # The structure of the function's result, and the leaves that are Python numbers in it. They are
    # found while the function is traced, since `jax.vmap` returns arrays only.
    shape: PyTree = None
    shared: list[Scalar | None] = []

    def of_element(scalars: list[Scalar]) -> list[Scalar]:
        nonlocal shape, shared
        remaining = iter(scalars)
        filled = [
            next(remaining) if is_mapped else leaf
            for leaf, is_mapped in zip(leaves, mapped, strict=True)
        ]
        values, shape = jax.tree.flatten(function(*jax.tree.unflatten(structure, filled)))
        shared = [leaf if is_structural(leaf) else None for leaf in values]
        return [leaf for leaf in values if not is_structural(leaf)]

    arrays = [leaf for leaf, is_mapped in zip(leaves, mapped, strict=True) if is_mapped]
    rows = iter(jax.vmap(of_element)(arrays))
    return jax.tree.unflatten(shape, [next(rows) if leaf is None else leaf for leaf in shared])


def sum_(value: Scalar) -> Scalar:
    """Return the sum over the elements of a group, () from (n,), or a scalar unchanged."""
    return value if np.ndim(value) == 0 else jnp.sum(value)


def min_(value: Scalar) -> Scalar:
    """Return the minimum over the elements of a group, () from (n,), or a scalar unchanged."""
    return value if np.ndim(value) == 0 else jnp.min(value)


def any_(value: Condition) -> Condition:
    """Return whether a condition (n,) holds for any element of a group, or a scalar condition
    unchanged."""
    return value if np.ndim(value) == 0 else jnp.any(value)
