"""Functions of PyTrees that are compiled to machine code."""

import threading
import time
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property

import equinox as eqx
import jax
import numpy as np
from jax.core import ShapedArray
from jax.extend import core
from jax.interpreters import partial_eval
from jaxtyping import PyTree
from numpy.typing import ArrayLike

from ..compilation.clock import begins_a_program, program_is_made_inside
from ..compilation.program import PLACE
from ..compilation.tracing import collector_at_rest
from .cells import Cells
from .kept import kept
from .llvm_text import llvm_text
from .lowering import Lowering, Region, aval_of, tangents_of
from .machine_code import compiled
from .operations import Operations
from .primitives import RULES


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
        """A copy of the array in a region."""
        source = self.floats if region.dtype.kind == "f" else self.whole
        return source[region.start : region.end].reshape(region.shape).astype(region.dtype)


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

    def __call__(self, leaves: Sequence[ArrayLike]) -> list[np.ndarray]:
        """The results for arguments of the jaxpr."""
        image = self.image()
        for leaf, region in zip(leaves, self.inputs, strict=True):
            if region is not None:
                image.write(region, np.asarray(leaf))
        self.run(image)
        return [image.read(region) for region in self.outputs]


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

    def key(self, arguments: tuple[PyTree, ...]) -> PyTree:
        """What programs are compiled anew for, of arguments."""
        leaves, structure = jax.tree.flatten(arguments)
        return structure, _described(leaves)

    def __call__(self, *arguments: PyTree) -> PyTree:
        """The function's result."""
        program, result = self.program(arguments)
        arrays = [leaf for leaf in jax.tree.leaves(arguments) if eqx.is_array(leaf)]
        return result(program(arrays))

    def program(self, arguments: tuple[PyTree, ...]) -> tuple[NativeProgram, "Result"]:
        """The program for such arguments, compiled if it isn't yet, and how its results are put
        together."""
        key = self.key(arguments)
        found = self._programs.get(key)
        if found is None:
            leaves, structure = jax.tree.flatten(arguments)
            # JAX may trace in threads, but each program is made once.
            with collector_at_rest(), program_is_made_inside(), _compiles:
                found = self._programs.get(key) or kept(
                    self._function, arguments, lambda: self._compiled(leaves, structure)
                )
                self._programs[key] = found
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
        closed = jax.make_jaxpr(flat)(arrays)
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


def _described(leaves: list[PyTree]) -> tuple[PyTree, ...]:
    return tuple(
        (leaf.shape, leaf.dtype) if eqx.is_array(leaf) else (type(leaf), leaf) for leaf in leaves
    )


_compiles = threading.RLock()
