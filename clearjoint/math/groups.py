"""Groups of elements with the same structure, which are computed at once.

All kernels are scalar arithmetic (`clearjoint.math.vectors`), so an element whose numbers are
arrays of shape (n,) represents n elements of the same structure. Its name is a `GroupName`.
`by_group` converts dictionaries by name, such as the motions of bodies, to dictionaries by group,
and `by_name` converts them back.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from .vectors import Condition, Scalar


class GroupName(str):
    """The name of a group, whose `members` are the names of its elements.

    It is a string that is equal for the same members, and can be used wherever names are.
    """

    members: tuple[str, ...]

    def __new__(cls, members: Iterable[str]) -> "GroupName":
        """Return the name of a group of elements, in this order."""
        members = tuple(members)
        name = super().__new__(cls, str(members))
        name.members = members
        return name

    def __getnewargs__(self) -> tuple[tuple[str, ...]]:
        # Copies and pickles call `__new__` with the members; `str` would pass its text.
        return (self.members,)


def is_structural(leaf: object) -> bool:
    """Return whether a leaf is a Python number, which all elements of a group share. NumPy's floats
    are not structural."""
    return type(leaf) in (int, float, bool)


def stack(trees: Sequence[PyTree]) -> PyTree:
    """Stack PyTrees of scalars to one PyTree of arrays of shape (n,).

    The structure and the Python numbers are those of the first tree.
    """
    first, structure = jax.tree.flatten(trees[0])
    columns = zip(*(jax.tree.leaves(tree) for tree in trees), strict=True)
    leaves = [
        leaf if is_structural(leaf) else _row(column)
        for leaf, column in zip(first, columns, strict=True)
    ]
    return jax.tree.unflatten(structure, leaves)


def _row(scalars: Sequence[Scalar]) -> jax.Array | np.ndarray:
    numpy = jnp if any(isinstance(scalar, jax.Array) for scalar in scalars) else np
    return numpy.stack(scalars)


def element(tree: PyTree, index: int) -> PyTree:
    """Return one element of a group, by its index."""
    return jax.tree.map(lambda leaf: leaf if is_structural(leaf) else leaf[..., index], tree)


def by_group(by_member: Mapping[str, PyTree], names: Iterable[str]) -> dict[str, PyTree]:
    """Convert values by the names of elements to values by `names`, which may be those of groups.

    Names without a value are omitted.
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
    """Convert values by the names of groups to values by the names of elements."""
    by_member = {}
    for name, tree in groups.items():
        if isinstance(name, GroupName):
            by_member |= {member: element(tree, k) for k, member in enumerate(name.members)}
        else:
            by_member[name] = tree
    return by_member


def each(function: Callable[..., PyTree], *arguments: PyTree) -> PyTree:
    """Call a function, which may use arrays, once for all elements of a group by `jax.vmap`.

    Arrays of shape (n,) in the arguments have one entry for each element; scalars and Python
    numbers are shared. Python numbers in the result stay Python numbers.
    """
    leaves, structure = jax.tree.flatten(arguments)
    mapped = [not is_structural(leaf) and jnp.ndim(leaf) == 1 for leaf in leaves]
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
    """Return the sum over the elements of a group; a scalar is not changed."""
    return value if np.ndim(value) == 0 else jnp.sum(value)


def min_(value: Scalar) -> Scalar:
    """Return the minimum over the elements of a group; a scalar is not changed."""
    return value if np.ndim(value) == 0 else jnp.min(value)


def any_(value: Condition) -> Condition:
    """Return whether a condition holds for any element of a group; a scalar is not changed."""
    return value if np.ndim(value) == 0 else jnp.any(value)
