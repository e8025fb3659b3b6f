"""PyTrees of many scalars as one array, so that an operation on all of them is a single equation.

Written out for each scalar, the sums of a Runge-Kutta step were a quarter of the program of a
mechanism with 30 joints, and took as much of the time of its compilation.
"""

from collections.abc import Hashable

import equinox as eqx
import jax
from jaxtyping import Float, PyTree

from .vectors import Scalar

FEWEST = 49
"""Number of scalars from which on they are stacked: native code has a loop over so many elements.
For fewer, it computes the same as for a PyTree of scalars."""


class Stacked(eqx.Module):
    """Numbers of a PyTree as one array.

    - `array`: the numbers, in the order of the PyTree's leaves.
    - `structure`: structure of the PyTree.
    """

    array: Float[jax.Array, " n"]
    structure: Hashable = eqx.field(static=True)


def stacked(tree: PyTree[Scalar]) -> PyTree:
    """Return a PyTree of at least `FEWEST` floats of JAX as a `Stacked`, any other unchanged."""
    leaves, structure = jax.tree.flatten(tree)
    if len(leaves) < FEWEST or not all(isinstance(leaf, jax.Array) for leaf in leaves):
        return tree
    first = leaves[0].aval
    if any(leaf.shape or leaf.dtype != first.dtype for leaf in leaves):
        return tree
    rows = [jax.lax.reshape(leaf, (1,)) for leaf in leaves]
    return Stacked(jax.lax.concatenate(rows, 0), structure)


def unstacked(tree: PyTree) -> PyTree[Scalar]:
    """Return the PyTree whose numbers a `Stacked` has, and any other PyTree unchanged."""
    if not isinstance(tree, Stacked):
        return tree
    rows = jax.lax.split(tree.array, (1,) * tree.array.size)
    return jax.tree.unflatten(tree.structure, [jax.lax.reshape(row, ()) for row in rows])
