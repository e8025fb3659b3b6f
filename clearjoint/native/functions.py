"""Compile functions of PyTrees to machine code, and call them."""

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
from . import control, indexing, reductions, structure
from .cells import Cells
from .disk_cache import load_or_make
from .llvm_text import llvm_text
from .lowering import Lowering, Region, UnsupportedPrimitiveError, aval_of, tangents_of
from .machine_code import compiled
from .operations import Number, Operations

RULES = structure.RULES | indexing.RULES | reductions.RULES | control.RULES
"""Rules by the names of the primitives that do not work element by element."""
LARGE = 256
"""Number of cells from which on an array is written to memory separately."""


class _Placeholder(enum.Enum):
    """Stands for an array in the structure of a result; an enum survives pickling."""

    ARRAY = "array"


class Memory:
    """Memory of a program in cells of 8 bytes.

    - `floats`, `whole`: the same cells as an array of floats and as an array of integers.
    - `address`: address of the first cell.
    """

    def __init__(self, cells: int):
        content = np.zeros(cells + 8)
        offset = -(content.ctypes.data // 8) % 8  # Vectors are aligned to 64 bytes.
        self.floats = content[offset : offset + cells]
        self.whole = self.floats.view(np.int64)
        self.address = self.floats.ctypes.data

    def write(self, region: Region, array: np.ndarray) -> None:
        """Write an array to the cells of `region`, which has the array's shape and dtype."""
        target = self.floats if array.dtype.kind == "f" else self.whole
        target[region.start : region.end] = array.ravel()

    def read(self, region: Region) -> np.ndarray:
        """Return the array in a region: a view of this memory, or a copy for 32-bit types."""
        source = self.floats if region.dtype.kind == "f" else self.whole
        part = source[region.start : region.end].reshape(region.shape)
        return part if region.dtype == source.dtype else part.astype(region.dtype)

    def write_all(self, leaves: Sequence[ArrayLike], inputs: "_Inputs") -> None:
        """Write the arrays `leaves` to the regions in `inputs`; all small arrays are written at
        once, which takes a tenth of the time."""
        for target, (indices, cells) in zip((self.floats, self.whole), inputs.small, strict=True):
            if indices:
                target[cells] = np.concatenate([leaves[k] for k in indices], axis=None)
        for k, region in inputs.large:
            self.write(region, np.asarray(leaves[k]))


class _Inputs:
    """Regions of a list of arrays, prepared to write them fast.

    - `small`: two pairs, for floats and for integers: indices of the small arrays in the list, and
      the cells of all these arrays, one array after the other.
    - `large`: index in the list and region of each large array.
    """

    def __init__(self, regions: Sequence[Region | None]):
        used = [(k, region) for k, region in enumerate(regions) if region is not None]
        self.large = [(k, region) for k, region in used if region.size >= LARGE]
        few = [(k, region) for k, region in used if region.size < LARGE]
        parts = ([r for r in few if (r[1].dtype.kind == "f") is kind] for kind in (True, False))
        self.small = [([k for k, _ in part], _cells([r for _, r in part])) for part in parts]


def _cells(regions: Sequence[Region]) -> np.ndarray:
    """Return the indices of the cells of all regions, one region after the other."""
    parts = [np.arange(region.start, region.end) for region in regions]
    return np.concatenate(parts) if parts else np.zeros(0, int)


class NativeProgram:
    """A closed jaxpr as machine code.

    - `inputs`: region of each argument, or ``None`` for an argument that the program does not use.
    - `outputs`: region of each result.
    - `seconds`: processor time, s, of "tracing", "lowering", "writing" and "compiling".
    - `text`: the program in LLVM's language; empty after the program was loaded from disk.

    **Arguments:** `closed`: the jaxpr; `tangents`: length of the arrays that are kept as vectors,
    by default found from the jaxpr.
    """

    def __init__(self, closed: core.ClosedJaxpr, tangents: int | None = None):
        began = time.thread_time()
        outs = closed.jaxpr.outvars
        jaxpr, used = partial_eval.dce_jaxpr(closed.jaxpr, [True] * len(outs), instantiate=False)
        ops = Operations(tangents=tangents_of(jaxpr) if tangents is None else tangents)
        lowering = Lowering(ops, RULES)
        avals = iter(map(aval_of, jaxpr.invars))
        self.inputs = [_new_region(ops, next(avals)) if is_used else None for is_used in used]
        arguments = [
            lowering.argument(aval_of(v), region.start)
            for v, region in zip(jaxpr.invars, filter(None, self.inputs), strict=True)
        ]
        results = lowering.inline_with(jaxpr, closed.consts, arguments)
        self.outputs = [
            lowering.stored(array, aval_of(out)) for array, out in zip(results, outs, strict=True)
        ]
        lowered = time.thread_time()
        self.text = llvm_text(ops)
        written = time.thread_time()
        self._code = compiled(self.text)
        self._constants, self._size = lowering.constants, ops.cells
        self.seconds = {
            "lowering": lowered - began,
            "writing": written - lowered,
            "compiling": time.thread_time() - written,
        }

    def __getstate__(self) -> dict[str, object]:
        return {**vars(self), "text": ""}

    def memory(self) -> Memory:
        """Return new memory for the program, with its constants."""
        memory = Memory(self._size)
        for start, array in self._constants.items():
            memory.write(Region(start, array.shape, array.dtype, array.size), array)
        return memory

    def run(self, memory: Memory) -> None:
        """Execute the program on memory."""
        self._code(memory.address)

    @cached_property
    def _input_cells(self) -> _Inputs:
        return _Inputs(self.inputs)

    def __call__(self, leaves: Sequence[ArrayLike]) -> list[np.ndarray]:
        """Return the results of the jaxpr for the arguments `leaves`."""
        # Results are views of the memory, so that each call needs its own.
        memory = self.memory()
        memory.write_all(leaves, self._input_cells)
        self.run(memory)
        return [memory.read(region) for region in self.outputs]

    def rows(
        self, leaves: Sequence[ArrayLike], columns: Mapping[int, np.ndarray]
    ) -> list[np.ndarray]:
        """Return the results of n calls, with a leading axis of n.

        `leaves`: arguments of the jaxpr; `columns`: for those that vary, by their index, the n
        values (n, ...).
        """
        memory, count = self.memory(), len(next(iter(columns.values())))
        memory.write_all(leaves, self._input_cells)
        regions = ((self.inputs[k], column) for k, column in columns.items())
        used = [(region, column) for region, column in regions if region is not None]
        results = [np.empty((count, *region.shape), region.dtype) for region in self.outputs]
        for row in range(count):
            for region, column in used:
                memory.write(region, column[row])
            self.run(memory)
            for region, result in zip(self.outputs, results, strict=True):
                result[row] = memory.read(region)
        return results


class BoundFunction:
    """A native function whose first argument is fixed. Only one thread may call it at a time.

    - `results`: conversion between results and rows of cells.

    **Arguments:** `function`: the native function; `shared`: its first argument; `examples`:
    PyTrees that have the structure, shapes and dtypes of all further arguments.
    """

    def __init__(self, function: "NativeFunction", shared: PyTree, *examples: PyTree):
        self._program, result = function.program((shared, *examples))
        arrays = [np.zeros(region.shape, region.dtype) for region in self._program.outputs]
        self.results = Cells(result(arrays))
        self._memory = self._program.memory()
        leaves = jax.tree.leaves(eqx.filter(shared, eqx.is_array))
        for leaf, region in zip(leaves, self._program.inputs, strict=False):
            if region is not None:
                self._memory.write(region, np.asarray(leaf))
        # Cells of the other arguments, if the program uses them: in a row of a call, and in memory.
        sizes = [np.size(leaf) for leaf in jax.tree.leaves(eqx.filter(examples, eqx.is_array))]
        starts = np.cumsum([0, *sizes])
        others = list(zip(starts, self._program.inputs[len(leaves) :], strict=False))
        in_row = [np.arange(start, start + r.size) for start, r in others if r is not None]
        self._source = np.concatenate(in_row) if in_row else np.zeros(0, int)
        self._target = _cells([r for _, r in others if r is not None])
        self._out = _cells(self._program.outputs)

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        """Call the function n times; each row of `rows` (n, cells) has the further arguments of a
        call, one array after the other. Return the cells of the results, (n, results.size)."""
        results = np.empty((len(rows), self.results.size))
        for row, result in zip(rows[:, self._source], results, strict=True):
            self._memory.floats[self._target] = row
            self._program.run(self._memory)
            result[:] = self._memory.floats[self._out]
        return results


def cells_of(arrays: Sequence[np.ndarray]) -> np.ndarray:
    """Return the content of the cells of arrays, (cells,) floats, one array after the other;
    integers and bools as the bits of 64-bit integers."""
    parts = [
        np.ravel(array).astype(np.float64)
        if np.asarray(array).dtype.kind == "f"
        else np.ravel(array).astype(np.int64).view(np.float64)
        for array in arrays
    ]
    return np.concatenate(parts) if parts else np.zeros(0)


def _new_region(ops: Operations, aval: ShapedArray) -> Region:
    return Region.of(aval, ops.allocate(aval.size))


def evaluated(
    function: Callable[..., ArrayLike], calls: Sequence[tuple[ArrayLike, ...]]
) -> list[Number] | None:
    """Evaluate a scalar function of small arrays in Python, without compiling it.

    Operations on known numbers are computed while lowering, so nothing is compiled; JAX would
    compile a program for each kind of operation, which takes 20 ms.

    **Arguments:** `calls`: arguments of each call, of equal shapes and dtypes.

    **Returns:** the result of each call; ``None`` if the function has a loop or a primitive without
    a rule.
    """
    # Shapes and dtypes are those of all calls, so one jaxpr serves them all.
    closed = jax.make_jaxpr(function)(*calls[0])
    lowering, results = Lowering(Operations(), RULES), []
    for arguments in calls:
        try:
            [out] = lowering.inline(closed, [*map(lowering.constant, arguments)])
        except UnsupportedPrimitiveError:
            return None
        # A scalar result is the number of a value; it is unknown if a loop computes the value.
        number = lowering.ops.number(out) if isinstance(out, int) else None
        if number is None:
            return None
        results.append(number)
    return results


class FlatArguments(NamedTuple):
    """Arguments of a function, flattened.

    - `arguments`: the arguments as given.
    - `leaves`, `structure`: their leaves and structure, as `jax.tree.flatten` returns them.
    - `arrays`: the arrays among the leaves.
    - `key`: equal for arguments that need the same program: structure, shapes and dtypes of the
      arrays, and all other leaves.
    """

    arguments: tuple[PyTree, ...]
    leaves: list[PyTree]
    structure: PyTree
    arrays: list[ArrayLike]
    key: Hashable

    @staticmethod
    def of(arguments: tuple[PyTree, ...]) -> "FlatArguments":
        """Flatten arguments."""
        leaves, structure = jax.tree.flatten(arguments)
        arrays, key = [], []
        for leaf in leaves:
            if type(leaf) is np.ndarray or eqx.is_array(leaf):
                arrays.append(leaf)
                key.append((leaf.shape, leaf.dtype))
            else:
                key.append((type(leaf), leaf))
        return FlatArguments(arguments, leaves, structure, arrays, (structure, tuple(key)))


class NativeFunction:
    """A function of PyTrees, compiled to machine code at its first call for each structure.

    As with `equinox.filter_jit`, only changes of arrays' values do not compile again. Arrays in
    results are NumPy's.
    """

    def __init__(self, function: Callable[..., PyTree]):
        self._function, self._traced = function, begins_a_program(function)
        self._programs: dict[Hashable, tuple[NativeProgram, Result]] = {}

    def count(self) -> int:
        """Return the number of compiled programs."""
        return len(self._programs)

    def __call__(self, *arguments: PyTree) -> PyTree:
        """Return the function's result."""
        return self.run(FlatArguments.of(arguments))

    def run(self, flat: FlatArguments) -> PyTree:
        """Return the function's result for flattened arguments."""
        program, result = self._program(flat)
        return result(program(flat.arrays))

    def rows(self, arguments: tuple[PyTree, ...], columns: Sequence[np.ndarray | None]) -> PyTree:
        """Return the results of n calls, with a leading axis of n in each array.

        `columns`: for each leaf of the arguments its n values (n, ...), or ``None`` if it is the
        same in all calls.
        """
        flat = FlatArguments.of(arguments)
        program, result = self._program(flat)
        pairs = [pair for pair in zip(flat.leaves, columns, strict=True) if eqx.is_array(pair[0])]
        varied = {k: column for k, (_, column) in enumerate(pairs) if column is not None}
        return result(program.rows(flat.arrays, varied))

    def program(self, arguments: tuple[PyTree, ...]) -> tuple[NativeProgram, "Result"]:
        """Return the program for arguments of this structure, and the structure of its result; make
        it if it is missing."""
        return self._program(FlatArguments.of(arguments))

    def _program(self, flat: FlatArguments) -> tuple[NativeProgram, "Result"]:
        program = self._programs.get(flat.key)
        if program is None:
            # Calls may come from several threads, but each program is compiled once.
            with collector_at_rest(), program_is_made_inside(), _COMPILES:
                program = self._programs.get(flat.key) or load_or_make(
                    self._function, flat.arguments, lambda: self._compiled(flat)
                )
                self._programs[flat.key] = program
        return program

    def _compiled(self, flat: FlatArguments) -> tuple[NativeProgram, "Result"]:
        result: list[PyTree] = []

        def of_arrays(arrays: list[PyTree]) -> list[PyTree]:
            """The function of arrays alone, with arrays alone as results, for JAX to trace."""
            remaining = iter(arrays)
            leaves = [next(remaining) if eqx.is_array(leaf) else leaf for leaf in flat.leaves]
            outs = self._traced(*jax.tree.unflatten(flat.structure, leaves))
            outs, structure = jax.tree.flatten(outs)
            marked = [_Placeholder.ARRAY if eqx.is_array(out) else out for out in outs]
            result[:] = [jax.tree.unflatten(structure, marked)]
            return [out for out in outs if eqx.is_array(out)]

        began = time.thread_time()
        closed, _ = program_of(of_arrays, flat.arrays)
        traced = time.thread_time() - began
        program = NativeProgram(closed)
        program.seconds["tracing"] = traced
        return program, Result(result[0])


@dataclass(frozen=True)
class Result:
    """The structure of a function's result, with placeholders for arrays."""

    tree: PyTree

    @cached_property
    def _flat(self) -> tuple[list[PyTree], PyTree]:
        return jax.tree.flatten(self.tree)

    def __getstate__(self) -> dict[str, PyTree]:
        return {"tree": self.tree}

    def __call__(self, arrays: Sequence[np.ndarray]) -> PyTree:
        """Return the result with the given arrays."""
        remaining, (leaves, structure) = iter(arrays), self._flat
        return jax.tree.unflatten(
            structure,
            [next(remaining) if leaf is _Placeholder.ARRAY else leaf for leaf in leaves],
        )


_COMPILES = threading.RLock()
