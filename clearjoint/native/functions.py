"""Functions of PyTrees that are compiled to machine code."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.interpreters import partial_eval

from .llvm_text import llvm_text
from .lowering import Lowering, Memory, kind_of, tangents_of
from .machine_code import NativeCall, code_folder, compiled
from .operations import Operations


@dataclass(frozen=True)
class Region:
    """Where an array lies in memory: its first cell, and its shape and dtype."""

    start: int
    shape: tuple[int, ...]
    dtype: np.dtype

    @property
    def size(self) -> int:
        """The number of cells."""
        return int(np.prod(self.shape, dtype=int))


class NativeProgram:
    """A closed jaxpr as machine code.

    `seconds`: what lowering and compiling took, by step.
    """

    def __init__(self, closed: Any):
        began = time.perf_counter()
        outs = closed.jaxpr.outvars
        jaxpr, used = partial_eval.dce_jaxpr(closed.jaxpr, [True] * len(outs), instantiate=False)
        do = Operations(tangents=tangents_of(jaxpr))
        lowering = Lowering(do)
        avals = [v.aval for v in jaxpr.invars]
        self._used = [k for k, is_used in enumerate(used) if is_used]
        self._inputs = [_region(do, aval) for aval in avals]
        given = [lowering.given(a, r.start) for a, r in zip(avals, self._inputs, strict=True)]
        consts = [lowering.constant(const) for const in closed.consts]
        found = lowering.run(jaxpr, consts, given)
        self._outputs = []
        for array, out in zip(found, outs, strict=True):
            region = Region(
                array.start if isinstance(array, Memory) else do.allocate(_size(out.aval)),
                tuple(out.aval.shape),
                np.dtype(out.aval.dtype),
            )
            self._outputs.append(region)
            if not isinstance(array, Memory):
                for k, value in enumerate(lowering.values(array)):
                    do.store(value, region.start + k)
        self._constants = lowering.constants
        self._cells = do.cells
        straightened = time.perf_counter()
        text = llvm_text(do, "program")
        written = time.perf_counter()
        self._call: NativeCall = compiled(text, "program", code_folder())
        self.text = text
        self.seconds = {
            "lowering": straightened - began,
            "writing": written - straightened,
            "compiling": time.perf_counter() - written,
        }

    def __call__(self, leaves: Sequence[Any]) -> list[np.ndarray]:
        """The results for arguments of the jaxpr."""
        floats = np.empty(self._cells + 8)
        offset = -(floats.ctypes.data // 8) % 8
        floats = floats[offset : offset + self._cells]
        whole = floats.view(np.int64)
        for start, array in self._constants.items():
            _write(floats, whole, start, array)
        for k, region in zip(self._used, self._inputs, strict=True):
            _write(floats, whole, region.start, np.asarray(leaves[k]))
        self._call(floats.ctypes.data)
        return [read_region(floats, whole, region) for region in self._outputs]


def _size(aval: Any) -> int:
    return int(np.prod(aval.shape, dtype=int))


def _region(do: Operations, aval: Any) -> Region:
    kind_of(aval)
    return Region(do.allocate(_size(aval)), tuple(aval.shape), np.dtype(aval.dtype))


def _write(floats: np.ndarray, whole: np.ndarray, start: int, array: np.ndarray) -> None:
    target = floats if array.dtype.kind == "f" else whole
    target[start : start + array.size] = array.ravel()


def read_region(floats: np.ndarray, whole: np.ndarray, region: Region) -> np.ndarray:
    """A copy of the array in a region of memory, seen as floats and as integers."""
    source = floats if region.dtype.kind == "f" else whole
    content = source[region.start : region.start + region.size].reshape(region.shape)
    return content.astype(region.dtype)


class NativeFunction:
    """A function of PyTrees, compiled to machine code at its first call for each structure.

    Arrays may change from call to call; whatever else changes compiles anew, as with
    `equinox.filter_jit`. Results have NumPy's arrays in the place of JAX's.
    """

    def __init__(self, function: Callable[..., Any]):
        self._function = function
        self._programs: dict[Any, tuple[NativeProgram, Any]] = {}

    def key(self, arguments: Any) -> Any:
        """What programs are compiled anew for, of arguments."""
        leaves, structure = jax.tree.flatten(arguments)
        return structure, _described(leaves)

    def __call__(self, *arguments: Any) -> Any:
        """The function's result."""
        leaves, structure = jax.tree.flatten(arguments)
        program, result = self._program(leaves, structure)
        arrays = [leaf for leaf in leaves if eqx.is_array(leaf)]
        numbers = iter(program(arrays))
        leaves, outer = result
        return jax.tree.unflatten(
            outer, [next(numbers) if leaf is _ARRAY else leaf for leaf in leaves]
        )

    def _program(self, leaves: list[Any], structure: Any) -> tuple[NativeProgram, Any]:
        key = structure, _described(leaves)
        if key not in self._programs:
            self._programs[key] = self._compiled(leaves, structure)
        return self._programs[key]

    def _compiled(self, leaves: list[Any], structure: Any) -> tuple[NativeProgram, Any]:
        is_array = [eqx.is_array(leaf) for leaf in leaves]
        result: list[Any] = []

        def flat(arrays: list[Any]) -> list[Any]:
            rest = iter(arrays)
            mixed = [
                next(rest) if dynamic else leaf
                for leaf, dynamic in zip(leaves, is_array, strict=True)
            ]
            outs, outer = jax.tree.flatten(self._function(*jax.tree.unflatten(structure, mixed)))
            result[:] = [_ARRAY if eqx.is_array(leaf) else leaf for leaf in outs], outer
            return [leaf for leaf in outs if eqx.is_array(leaf)]

        arrays = [leaf for leaf, dynamic in zip(leaves, is_array, strict=True) if dynamic]
        began = time.perf_counter()
        closed = jax.make_jaxpr(flat)(arrays)
        traced = time.perf_counter() - began
        program = NativeProgram(closed)
        program.seconds["tracing"] = traced
        return program, tuple(result)


def _described(leaves: list[Any]) -> tuple[Any, ...]:
    return tuple(
        (leaf.shape, leaf.dtype) if eqx.is_array(leaf) else (type(leaf), leaf) for leaf in leaves
    )


_ARRAY = object()
"""Stands for an array in a result."""
