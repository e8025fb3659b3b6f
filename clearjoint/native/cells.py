"""PyTrees of arrays in cells of 8 bytes, one array behind the other."""

from collections.abc import Sequence

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float, PyTree


class Cells:
    """Where the arrays of PyTrees like an example lie in a row of cells; `size` is their number.

    Floats are kept as they are, integers and truth values as the bits of 64-bit integers.
    """

    def __init__(self, example: PyTree):
        arrays, self._rest = eqx.partition(example, eqx.is_array)
        leaves, self._structure = jax.tree.flatten(arrays)
        self._forms = [(np.shape(leaf), np.dtype(leaf.dtype)) for leaf in leaves]
        self._ends = np.cumsum([0, *(np.size(leaf) for leaf in leaves)])
        self.size = int(self._ends[-1])

    def columns(self) -> PyTree:
        """The example with the numbers of their cells in its arrays."""
        numbers = zip(self._forms, self._ends, strict=False)
        return self._tree(
            [a + np.arange(np.prod(s, dtype=int)).reshape(s) for (s, _), a in numbers]
        )

    def rows(self, trees: PyTree) -> Float[np.ndarray, "n {self.size}"]:
        """The cells of n PyTrees, whose arrays have n in front."""
        leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(eqx.filter(trees, eqx.is_array))]
        count = len(leaves[0]) if leaves else 0
        rows = np.zeros((count, self.size))
        whole = rows.view(np.int64)
        for leaf, (_, dtype), start in zip(leaves, self._forms, self._ends, strict=False):
            flat = leaf.reshape(count, -1)
            target = rows if dtype.kind == "f" else whole
            target[:, start : start + flat.shape[1]] = flat
        return rows

    def trees(self, rows: Float[np.ndarray, "n {self.size}"]) -> PyTree:
        """PyTrees from their cells, n in front of the arrays."""
        rows, leaves = np.ascontiguousarray(rows), []
        whole, ends = rows.view(np.int64), zip(self._ends, self._ends[1:], strict=False)
        for (shape, dtype), (start, end) in zip(self._forms, ends, strict=True):
            source = rows if dtype.kind == "f" else whole
            leaves.append(source[:, start:end].reshape(len(rows), *shape).astype(dtype))
        return self._tree(leaves)

    def _tree(self, leaves: Sequence[np.ndarray]) -> PyTree:
        return eqx.combine(jax.tree.unflatten(self._structure, leaves), self._rest)
