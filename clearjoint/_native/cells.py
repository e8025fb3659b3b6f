"""Memory of native programs, and the arrays and PyTrees that it holds.

A cell holds a number of 8 bytes for each lane: a float64, or an integer or bool as an int64. An
array occupies consecutive cells, one for each element in row-major order, and a PyTree the cells of
its arrays, one array after the other.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
from jax.core import ShapedArray
from jaxtyping import Float, PyTree
from numpy.typing import ArrayLike


class Region(NamedTuple):
    """Cells that an array occupies in a program's memory."""

    cells: slice
    shape: tuple[int, ...]
    dtype: np.dtype

    @staticmethod
    def of(array: "ShapedArray | jax.ShapeDtypeStruct | np.ndarray", start: int) -> "Region":
        """Return the region of an array like `array` from the cell `start` on."""
        end = start + math.prod(array.shape)
        return Region(slice(start, end), tuple(array.shape), np.dtype(array.dtype))

    @property
    def start(self) -> int:
        return self.cells.start

    @property
    def size(self) -> int:
        return self.cells.stop - self.cells.start


def numbers_of(floats: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Return the memory `floats` itself for a `dtype` of floats, else a view of it as int64."""
    return floats if dtype.kind == "f" else floats.view(np.int64)


class Memory:
    """Memory of a program, in which each cell has one number for each of n lanes.

    - `floats`, `integers`: the same memory as float64 and as int64, (cells, n).
    - `address`: address of the first cell, a multiple of 64.
    """

    def __init__(self, cells: int, lanes: int = 1):
        # Vectors of the processor are aligned to 64 bytes, which is 8 numbers. NumPy aligns arrays
        # to less, so up to 7 numbers are left out at the start.
        numbers = np.zeros(cells * lanes + 8)
        offset = -(numbers.ctypes.data // 8) % 8
        self.floats = numbers[offset : offset + cells * lanes].reshape(cells, lanes)
        self.integers = self.floats.view(np.int64)
        self.address = self.floats.ctypes.data

    def write(self, region: Region, array: ArrayLike) -> None:
        numbers_of(self.floats, region.dtype)[region.cells] = np.asarray(array).reshape(-1, 1)

    def read(self, region: Region) -> np.ndarray:
        """Return the array in a region of a memory of one lane: a view for float64 and int64."""
        numbers = numbers_of(self.floats, region.dtype)[region.cells]
        return numbers.reshape(region.shape).astype(region.dtype, copy=False)


class Cells:
    """Conversion of PyTrees to rows of numbers, with the layout of a program's memory, and back.

    A row has the numbers of one PyTree as float64. Integers and bools are converted to int64, and
    the bits of these read as a float64. All PyTrees have the structure, shapes, dtypes and static
    leaves of `example`.

    - `size`: number of cells of a PyTree, and of numbers in a row.
    """

    def __init__(self, example: PyTree):
        arrays, self._static = eqx.partition(example, eqx.is_array)
        leaves, self._structure = jax.tree.flatten(arrays)
        self._regions: list[Region] = []
        self.size = 0
        for leaf in leaves:
            self._regions.append(Region.of(leaf, self.size))
            self.size += leaf.size

    def columns(self) -> PyTree:
        """Return the example with the elements of its arrays replaced by their indices in a row."""
        return self._tree([np.arange(self.size)[r.cells].reshape(r.shape) for r in self._regions])

    def rows(self, trees: PyTree) -> Float[np.ndarray, "n {self.size}"]:
        """Return the rows of n PyTrees, which `trees` has as one PyTree of arrays (n, ...). If it
        has no array, there is no row."""
        leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(eqx.filter(trees, eqx.is_array))]
        floats = np.zeros((len(leaves[0]) if leaves else 0, self.size))
        for leaf, region in zip(leaves, self._regions, strict=True):
            rows = numbers_of(floats, region.dtype)[:, region.cells]
            rows[:] = leaf.reshape(rows.shape)
        return floats

    def row(self, tree: PyTree) -> Float[np.ndarray, " {self.size}"]:
        return self.rows(jax.tree.map(lambda leaf: np.asarray(leaf)[None], tree))[0]

    def tree(self, row: Float[np.ndarray, " {self.size}"]) -> PyTree:
        return jax.tree.map(lambda leaf: leaf[0], self.trees(row[None]))

    def trees(self, rows: Float[np.ndarray, "n {self.size}"]) -> PyTree:
        """Return the PyTrees of n rows as one PyTree of arrays (n, ...)."""
        floats = np.ascontiguousarray(rows)
        return self._tree(
            [
                numbers_of(floats, region.dtype)[:, region.cells]
                .reshape(len(floats), *region.shape)
                .astype(region.dtype)
                for region in self._regions
            ]
        )

    def _tree(self, leaves: Sequence[np.ndarray]) -> PyTree:
        return eqx.combine(jax.tree.unflatten(self._structure, leaves), self._static)
