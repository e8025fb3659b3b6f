"""Several alike elements in the place of one, and the names that stand for them.

All kernels are arithmetic on scalars (`clearjoint.math.vectors`), so an element whose numbers are
arrays of shape (n,) stands for n elements of the same structure. It is named by a `Several`; what
is kept by names, the motions of bodies, say, goes from the elements' own names to such names by
`gathered`, and back by `by_name`.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from .vectors import Scalar


class Several(str):
    """The name of several elements, each of which has a name of its own in `members`.

    It is a string, the same for the same members, so that it serves wherever names do.
    """

    members: tuple[str, ...]

    def __new__(cls, members: Iterable[str]) -> "Several":
        """The name of the elements with the given names, in this order."""
        members = tuple(members)
        name = super().__new__(cls, str(members))
        name.members = members
        return name


def is_structural(leaf: object) -> bool:
    """Whether a leaf is a Python number, which the alike elements share. numpy's floats are not."""
    return type(leaf) in (int, float, bool)


def stacked(trees: Sequence[PyTree]) -> PyTree:
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


def _row(scalars: Sequence[Scalar]) -> Scalar:
    numpy = jnp if any(isinstance(scalar, jax.Array) for scalar in scalars) else np
    return numpy.stack(scalars)


def element(tree: PyTree, index: int) -> PyTree:
    """One of several elements."""
    return jax.tree.map(lambda leaf: leaf if is_structural(leaf) else leaf[..., index], tree)


def gathered(family: Mapping[str, PyTree], names: Iterable[str]) -> dict[str, PyTree]:
    """What is kept of elements by their own names, under names that may stand for several.

    Names that the family lacks are left out.
    """
    found = {}
    for name in names:
        if not isinstance(name, Several):
            found |= {name: family[name]} if name in family else {}
        elif name.members[0] in family:
            arrays = [jax.tree.map(jnp.asarray, family[member]) for member in name.members]
            found[name] = stacked(arrays)
    return found


def by_name(family: Mapping[str, PyTree]) -> dict[str, PyTree]:
    """What is kept under names that may stand for several, by the elements' own names."""
    found = {}
    for name, tree in family.items():
        if isinstance(name, Several):
            found |= {member: element(tree, k) for k, member in enumerate(name.members)}
        else:
            found[name] = tree
    return found


def each(function: Callable[..., PyTree], *arguments: PyTree) -> PyTree:
    """The function of each of several elements: by `jax.vmap`, so that it may be any function.

    Along arrays of shape (n,) go the elements; scalars and Python numbers are what they share, and
    Python numbers in the result remain such.
    """
    leaves, structure = jax.tree.flatten(arguments)
    along = [not is_structural(leaf) and jnp.ndim(leaf) == 1 for leaf in leaves]
    shape: PyTree = None
    shared: list[Scalar] = []

    def one(own: list[Scalar]) -> list[Scalar]:
        nonlocal shape, shared
        remaining = iter(own)
        filled = [
            next(remaining) if mine else leaf for leaf, mine in zip(leaves, along, strict=True)
        ]
        found, shape = jax.tree.flatten(function(*jax.tree.unflatten(structure, filled)))
        shared = [leaf if is_structural(leaf) else None for leaf in found]
        return [leaf for leaf in found if not is_structural(leaf)]

    rows = iter(jax.vmap(one)([leaf for leaf, mine in zip(leaves, along, strict=True) if mine]))
    return jax.tree.unflatten(shape, [next(rows) if leaf is None else leaf for leaf in shared])


def total(value: Scalar) -> Scalar:
    """The sum over several elements; of one, the value itself."""
    return value if np.ndim(value) == 0 else jnp.sum(value)


def least(value: Scalar) -> Scalar:
    """The smallest of several elements' values; of one, the value itself."""
    return value if np.ndim(value) == 0 else jnp.min(value)


def some(value: Scalar) -> Scalar:
    """Whether it holds for any of several elements; of one, the value itself."""
    return value if np.ndim(value) == 0 else jnp.any(value)
