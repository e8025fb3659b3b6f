"""Convert between PyTrees of arrays and rows of cells of 8 bytes, one array after the other."""

from collections.abc import Sequence

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float, PyTree


class Cells:
    """Conversion between PyTrees and rows of cells; `size` is the number of cells in a row.

    Floats are stored as they are, integers and bools as the bits of 64-bit integers. All PyTrees
    have the structure, shapes and dtypes of the example.
    """

    def __init__(self, example: PyTree):
        arrays, self._static = eqx.partition(example, eqx.is_array)
        leaves, self._structure = jax.tree.flatten(arrays)
        self._avals = [(np.shape(leaf), np.dtype(leaf.dtype)) for leaf in leaves]
        self._starts = np.cumsum([0, *(np.size(leaf) for leaf in leaves)])
        self.size = int(self._starts[-1])

    def columns(self) -> PyTree:
        """Return the example PyTree, in which each element of each array is replaced by the index
        of its cell in a row."""
        rows = zip(self._avals, self._starts, strict=False)
        return self._tree(
            [
                start + np.arange(np.prod(shape, dtype=int)).reshape(shape)
                for (shape, _), start in rows
            ]
        )

    def rows(self, trees: PyTree) -> Float[np.ndarray, "n {self.size}"]:
        """Return the cells (n, size) of n PyTrees, given as one PyTree whose arrays have a leading
        axis of length n."""
        leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(eqx.filter(trees, eqx.is_array))]
        count = len(leaves[0]) if leaves else 0
        floats = np.zeros((count, self.size))
        integers = floats.view(np.int64)
        for leaf, (_, dtype), start in zip(leaves, self._avals, self._starts, strict=False):
            flat = leaf.reshape(count, -1)
            target = floats if dtype.kind == "f" else integers
            target[:, start : start + flat.shape[1]] = flat
        return floats

    def trees(self, rows: Float[np.ndarray, "n {self.size}"]) -> PyTree:
        """Return the n PyTrees in rows of cells (n, size), as one PyTree whose arrays have a
        leading axis of length n."""
        floats, leaves = np.ascontiguousarray(rows), []
        integers = floats.view(np.int64)
        ends = zip(self._starts, self._starts[1:], strict=False)
        for (shape, dtype), (start, end) in zip(self._avals, ends, strict=True):
            source = floats if dtype.kind == "f" else integers
            leaves.append(source[:, start:end].reshape(len(floats), *shape).astype(dtype))
        return self._tree(leaves)

    def _tree(self, leaves: Sequence[np.ndarray]) -> PyTree:
        return eqx.combine(jax.tree.unflatten(self._structure, leaves), self._static)
