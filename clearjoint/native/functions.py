"""Functions of PyTrees that are compiled to machine code."""

import enum
import threading
import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
from jax.core import ShapedArray
from jax.extend import core
from jax.interpreters import partial_eval
from jaxtyping import PyTree
from numpy.typing import ArrayLike

from ..compilation.clock import begins_a_program, program_is_made_inside
from ..compilation.tracing import collector_at_rest, program_of
from .cells import Cells
from .kept import kept
from .llvm_text import llvm_text
from .lowering import Lowering, Region, UnsupportedPrimitiveError, aval_of, tangents_of
from .machine_code import compiled
from .operations import Number, Operations
from .primitives import RULES


class Place(enum.Enum):
    """Where an array stands in a result."""

    ARRAY = "array"


PLACE = Place.ARRAY


class Image:
    """Memory of a program, in cells of 8 bytes that are seen as floats and as integers."""

    def __init__(self, cells: int):
        content = np.zeros(cells + 8)
        offset = -(content.ctypes.data // 8) % 8  # Vectors are aligned to 64 bytes.
        self.floats = content[offset : offset + cells]
        self.whole = self.floats.view(np.int64)
        self.address = self.floats.ctypes.data

    def write(self, region: Region, array: np.ndarray) -> None:
        """Write an array into its region."""
        target = self.floats if array.dtype.kind == "f" else self.whole
        target[region.start : region.end] = array.ravel()

    def read(self, region: Region) -> np.ndarray:
        """The array in a region: in this memory, or a copy where it has another type of number."""
        source = self.floats if region.dtype.kind == "f" else self.whole
        part = source[region.start : region.start + region.size].reshape(region.shape)
        return part if region.dtype == source.dtype else part.astype(region.dtype)

    def write_all(self, leaves: Sequence[ArrayLike], cells: "_Cells") -> None:
        """Write arrays into their regions: small ones together, which takes a tenth of the time."""
        for target, (numbers, where) in zip((self.floats, self.whole), cells.small, strict=True):
            if numbers:
                target[where] = np.concatenate([leaves[k] for k in numbers], axis=None)
        for k, region in cells.large:
            self.write(region, np.asarray(leaves[k]))


LARGE = 256
"""Cells of an array from which on it is written alone."""


class _Cells:
    """Where the arrays of a list go.

    - `small`: of floats, and of integers, the numbers of the arrays in the list, and their cells;
      `large`: the numbers of others, and their regions.
    """

    def __init__(self, regions: Sequence[Region | None]):
        used = [(k, region) for k, region in enumerate(regions) if region is not None]
        self.large = [(k, region) for k, region in used if region.size >= LARGE]
        few = [(k, region) for k, region in used if region.size < LARGE]
        parts = ([r for r in few if (r[1].dtype.kind == "f") is kind] for kind in (True, False))
        self.small = [
            ([k for k, _ in part], _joined([np.arange(r.start, r.end) for _, r in part]))
            for part in parts
        ]


class NativeProgram:
    """A closed jaxpr as machine code.

    - `inputs`: regions of its arguments, in order, and ``None`` for those that it does not use.
    - `outputs`: regions of its results.
    - `seconds`: processor time of tracing, lowering, writing and compiling.
    - `text`: the program in LLVM's language.
    """

    def __init__(self, closed: core.ClosedJaxpr, tangents: int | None = None):
        """`tangents`: of the arrays that are kept as vectors; found in the jaxpr unless given."""
        began = time.thread_time()
        outs = closed.jaxpr.outvars
        jaxpr, used = partial_eval.dce_jaxpr(closed.jaxpr, [True] * len(outs), instantiate=False)
        do = Operations(tangents=tangents_of(jaxpr) if tangents is None else tangents)
        lowering = Lowering(do, RULES)
        avals = iter(jaxpr.invars)
        self.inputs = [_region(do, aval_of(next(avals))) if is_used else None for is_used in used]
        given = [
            lowering.given(aval_of(v), region.start)
            for v, region in zip(jaxpr.invars, filter(None, self.inputs), strict=True)
        ]
        consts = [lowering.constant(const) for const in closed.consts]
        found = lowering.run(jaxpr, consts, given)
        self.outputs = [
            lowering.stored(array, aval_of(out)) for array, out in zip(found, outs, strict=True)
        ]
        straightened = time.thread_time()
        self.text = llvm_text(do, "program")
        written = time.thread_time()
        self._code = compiled(self.text, "program")
        self._constants, self._cells = lowering.constants, do.cells
        self.seconds = {
            "lowering": straightened - began,
            "writing": written - straightened,
            "compiling": time.thread_time() - written,
        }

    def __getstate__(self) -> dict[str, object]:
        return {**vars(self), "text": ""}

    def image(self) -> Image:
        """Memory for the program, with its constants."""
        image = Image(self._cells)
        for start, array in self._constants.items():
            image.write(Region(start, array.shape, array.dtype, array.size), array)
        return image

    def run(self, image: Image) -> None:
        """Carry the program out on memory."""
        self._code(image.address)

    @cached_property
    def _input_cells(self) -> _Cells:
        return _Cells(self.inputs)

    def __call__(self, leaves: Sequence[ArrayLike]) -> list[np.ndarray]:
        """The results for arguments of the jaxpr."""
        image = self.image()
        image.write_all(leaves, self._input_cells)
        self.run(image)
        return [image.read(region) for region in self.outputs]

    def rows(
        self, leaves: Sequence[ArrayLike], columns: Mapping[int, np.ndarray]
    ) -> list[np.ndarray]:
        """The results, n in front, for arguments of the jaxpr of which those with the numbers of
        `columns` have n values, (n, ...) each."""
        image, count = self.image(), len(next(iter(columns.values())))
        image.write_all(leaves, self._input_cells)
        regions = ((self.inputs[k], column) for k, column in columns.items())
        used = [(region, column) for region, column in regions if region is not None]
        found = [np.empty((count, *region.shape), region.dtype) for region in self.outputs]
        for row in range(count):
            for region, column in used:
                image.write(region, column[row])
            self.run(image)
            for region, results in zip(self.outputs, found, strict=True):
                results[row] = image.read(region)
        return found


class BoundFunction:
    """A function of PyTrees in native code whose first arguments stay the same.

    It has memory of its own: for one thread. `results`: the cells of a result.
    """

    def __init__(self, function: "NativeFunction", shared: PyTree, *examples: PyTree):
        """`shared`: the first argument; `examples`: the others are like these."""
        self._program, result = function.program((shared, *examples))
        arrays = [np.zeros(region.shape, region.dtype) for region in self._program.outputs]
        self.results = Cells(result(arrays))
        self._image = self._program.image()
        leaves = jax.tree.leaves(eqx.filter(shared, eqx.is_array))
        for leaf, region in zip(leaves, self._program.inputs, strict=False):
            if region is not None:
                self._image.write(region, np.asarray(leaf))
        sizes = [np.size(leaf) for leaf in jax.tree.leaves(eqx.filter(examples, eqx.is_array))]
        starts = np.cumsum([0, *sizes])
        others = list(zip(starts, self._program.inputs[len(leaves) :], strict=False))
        self._from = _joined([np.arange(a, a + r.size) for a, r in others if r is not None])
        self._to = _joined([np.arange(r.start, r.end) for _, r in others if r is not None])
        self._out = _joined([np.arange(r.start, r.end) for r in self._program.outputs])

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        """The cells of results (n, results.size), for those of the arguments, (n, cells)."""
        found = np.empty((len(rows), self.results.size))
        for row, result in zip(rows[:, self._from], found, strict=True):
            self._image.floats[self._to] = row
            self._program.run(self._image)
            result[:] = self._image.floats[self._out]
        return found


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    return np.concatenate(parts) if parts else np.zeros(0, int)


def cells_of(arrays: Sequence[np.ndarray]) -> np.ndarray:
    """Arrays in cells, one behind the other."""
    parts = [
        np.ravel(array).astype(np.float64)
        if np.asarray(array).dtype.kind == "f"
        else np.ravel(array).astype(np.int64).view(np.float64)
        for array in arrays
    ]
    return np.concatenate(parts) if parts else np.zeros(0)


def _region(do: Operations, aval: ShapedArray) -> Region:
    return Region.of(aval, do.allocate(int(np.prod(aval.shape, dtype=int))))


def evaluated(
    function: Callable[..., ArrayLike], calls: Sequence[tuple[ArrayLike, ...]]
) -> list[Number] | None:
    """The scalars that a function of small arrays gives for the arguments of several calls;
    ``None`` if it has a loop, say, or a primitive without a rule.

    Each operation is rounded by itself, in Python: JAX would compile a program for each kind of
    operation first, which takes 20 ms.
    """
    closed = jax.make_jaxpr(function)(*calls[0])
    lowering, found = Lowering(Operations(), RULES), []
    for arguments in calls:
        try:
            consts = [lowering.constant(const) for const in closed.consts]
            [out] = lowering.run(closed.jaxpr, consts, [*map(lowering.constant, arguments)])
        except UnsupportedPrimitiveError:
            return None
        number = lowering.do.number(out) if isinstance(out, int) else None
        if number is None:
            return None
        found.append(number)
    return found


class Given(NamedTuple):
    """Arguments of a function, their leaves and structure, the arrays among the leaves, and the key
    of the program for them."""

    arguments: tuple[PyTree, ...]
    leaves: list[PyTree]
    structure: PyTree
    arrays: list[ArrayLike]
    key: Hashable

    @staticmethod
    def of(arguments: tuple[PyTree, ...]) -> "Given":
        """The arguments, flattened once for all that asks for their leaves."""
        leaves, structure = jax.tree.flatten(arguments)
        arrays, described = [], []
        for leaf in leaves:
            if type(leaf) is np.ndarray or eqx.is_array(leaf):
                arrays.append(leaf)
                described.append((leaf.shape, leaf.dtype))
            else:
                described.append((type(leaf), leaf))
        return Given(arguments, leaves, structure, arrays, (structure, tuple(described)))


class NativeFunction:
    """A function of PyTrees, compiled to machine code at its first call for each structure.

    Arrays may change from call to call; whatever else changes compiles anew, as with
    `equinox.filter_jit`. Results have NumPy's arrays in the place of JAX's.
    """

    def __init__(self, function: Callable[..., PyTree]):
        self._function, self._traced = function, begins_a_program(function)
        self._programs: dict[Hashable, tuple[NativeProgram, Result]] = {}

    def count(self) -> int:
        """How many programs have been compiled."""
        return len(self._programs)

    def __call__(self, *arguments: PyTree) -> PyTree:
        """The function's result."""
        return self.run(Given.of(arguments))

    def run(self, given: Given) -> PyTree:
        """The function's result."""
        program, result = self._program(given)
        return result(program(given.arrays))

    def rows(self, arguments: tuple[PyTree, ...], columns: Sequence[np.ndarray | None]) -> PyTree:
        """The results, with n in front of each array, for arguments of which some vary.

        `columns`: for each leaf of the arguments its n values, (n, ...), or ``None``.
        """
        given = Given.of(arguments)
        program, result = self._program(given)
        pairs = [pair for pair in zip(given.leaves, columns, strict=True) if eqx.is_array(pair[0])]
        varied = {k: column for k, (_, column) in enumerate(pairs) if column is not None}
        return result(program.rows(given.arrays, varied))

    def program(self, arguments: tuple[PyTree, ...]) -> tuple[NativeProgram, "Result"]:
        """The program for such arguments, compiled if it isn't yet, and how its results are put
        together."""
        return self._program(Given.of(arguments))

    def _program(self, given: Given) -> tuple[NativeProgram, "Result"]:
        found = self._programs.get(given.key)
        if found is None:
            # JAX may trace in threads, but each program is made once.
            with collector_at_rest(), program_is_made_inside(), _compiles:
                found = self._programs.get(given.key) or kept(
                    self._function,
                    given.arguments,
                    lambda: self._compiled(given.leaves, given.structure),
                )
                self._programs[given.key] = found
        return found

    def _compiled(self, leaves: list[PyTree], structure: PyTree) -> tuple[NativeProgram, "Result"]:
        is_array = [eqx.is_array(leaf) for leaf in leaves]
        result: list[PyTree] = []

        def flat(arrays: list[PyTree]) -> list[PyTree]:
            rest = iter(arrays)
            mixed = [
                next(rest) if dynamic else leaf
                for leaf, dynamic in zip(leaves, is_array, strict=True)
            ]
            outs, outer = jax.tree.flatten(self._traced(*jax.tree.unflatten(structure, mixed)))
            result[:] = [PLACE if eqx.is_array(leaf) else leaf for leaf in outs], outer
            return [leaf for leaf in outs if eqx.is_array(leaf)]

        arrays = [leaf for leaf, dynamic in zip(leaves, is_array, strict=True) if dynamic]
        began = time.thread_time()
        closed, _ = program_of(flat, arrays)
        traced = time.thread_time() - began
        program = NativeProgram(closed)
        program.seconds["tracing"] = traced
        return program, Result(jax.tree.unflatten(result[1], result[0]))


@dataclass(frozen=True)
class Result:
    """A function's result with `PLACE` where an array stands."""

    tree: PyTree

    @cached_property
    def _flat(self) -> tuple[list[PyTree], PyTree]:
        return jax.tree.flatten(self.tree)

    def __getstate__(self) -> dict[str, PyTree]:
        return {"tree": self.tree}

    def __call__(self, arrays: Sequence[np.ndarray]) -> PyTree:
        """The result with such arrays."""
        numbers, (leaves, structure) = iter(arrays), self._flat
        return jax.tree.unflatten(
            structure, [next(numbers) if leaf is PLACE else leaf for leaf in leaves]
        )


_compiles = threading.RLock()
