"""PyTrees of many scalars as one array: an operation on all scalars is one equation of the program.

Written out for each scalar, the sums of a Runge-Kutta step were a quarter of the program of a
mechanism with 30 joints, and took a quarter of the time of its compilation.
"""

from collections.abc import Hashable

import equinox as eqx
import jax
from jaxtyping import Float, PyTree
from typing_extensions import override

from .vectors import Scalar

FEWEST = 49
"""Smallest number of scalars that are stacked: native code has a loop over the elements of such an
array, but turns a shorter one into separate scalars again."""


class Stacked(eqx.Module):
    """The n leaves of a PyTree, along the last axis of `array`, and the PyTree's `structure`."""

    array: Float[jax.Array, "... n"]
    structure: Hashable = eqx.field(static=True)

    @override
    def __reduce__(self) -> tuple[object, ...]:
        # A structure of JAX with classes of Equinox does not equal its pickled copy, so that a
        # program from disk could not be used beside a new one.
        structure: PyTree = self.structure
        example = jax.tree.unflatten(structure, [...] * structure.num_leaves)
        return _with_structure_of, (self.array, example)


def _with_structure_of(array: jax.Array, example: PyTree) -> Stacked:
    return Stacked(array, jax.tree.structure(example))


def stacked(tree: PyTree[Scalar]) -> PyTree:
    """Return a PyTree as a `Stacked`, or unchanged if it has less than `FEWEST` leaves, or leaves
    other than JAX arrays of one shape and dtype."""
    leaves, structure = jax.tree.flatten(tree)
    if len(leaves) < FEWEST or not all(isinstance(leaf, jax.Array) for leaf in leaves):
        return tree
    shape, dtype = leaves[0].shape, leaves[0].dtype
    if any(leaf.shape != shape or leaf.dtype != dtype for leaf in leaves):
        return tree
    return Stacked(jax.lax.stack(leaves, axis=len(shape)), structure)


def unstacked(tree: PyTree) -> PyTree[Scalar]:
    """Return the PyTree that was `stacked`; any PyTree other than a `Stacked` is unchanged."""
    if not isinstance(tree, Stacked):
        return tree
    scalars = jax.lax.unstack(tree.array, axis=tree.array.ndim - 1)
    return jax.tree.unflatten(tree.structure, scalars)
