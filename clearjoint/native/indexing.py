"""Primitives that read or write elements at computed indices; rules as in `.structure`.

A block is a rectangular part of an array. It is described by the flat index of its first element,
which is computed, and by the known offsets of its elements from there.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from jax.extend import core

from . import elementwise
from .elementwise import RULES as ELEMENTWISE
from .lowering import (
    LARGEST_UNROLLED,
    Array,
    EquationRule,
    InMemory,
    Lowering,
    UnsupportedPrimitiveError,
    aval_of,
    is_contiguous,
    kind_of,
)
from .operations import Value


def _strides(shape: Sequence[int]) -> list[int]:
    return [math.prod(shape[k + 1 :]) for k in range(len(shape))]


def _offsets(sizes: Sequence[int], strides: Sequence[int]) -> np.ndarray:
    """Return the offsets of the elements of a block in row-major order."""
    indices = np.indices(tuple(sizes)).reshape(len(sizes), math.prod(sizes))
    return np.array(strides, int) @ indices


def _as_index(lower: Lowering, value: Value) -> Value:
    return elementwise.convert(lower.ops, "i", value)


def _clamped(lower: Lowering, index: Value, highest: int) -> Value:
    low, high = (lower.ops.constant("i", number) for number in (0, highest))
    return ELEMENTWISE["clamp"](lower.ops, "i", {}, low, _as_index(lower, index), high)


def _first_element(
    lower: Lowering, starts: Sequence[Array], shape: Sequence[int], sizes: Sequence[int]
) -> Value:
    """Return the flat index of a block's first element; JAX moves blocks inside of the array."""
    ops, total = lower.ops, lower.ops.constant("i", 0)
    rows = zip(starts, shape, sizes, _strides(shape), strict=True)
    for start, length, size, stride in rows:
        index = _clamped(lower, lower.values(start)[0], length - size)
        step = ops.emit("mul", "i", index, ops.constant("i", stride))
        total = ops.emit("add", "i", total, step)
    return total


def read_block(
    lower: Lowering, memory: InMemory, first: Value, offsets: np.ndarray, shape: tuple[int, ...]
) -> Array:
    """Return the elements at known offsets from an index that the program computes, as an array of
    the given shape."""
    ops = lower.ops
    if offsets.size <= LARGEST_UNROLLED:
        return lower.array(_elements(lower, memory, first, offsets), shape)
    if not is_contiguous(offsets):
        raise UnsupportedPrimitiveError("dynamic_slice of many rows")
    out = lower.new_array(shape, memory.kind)

    def visit(k: Value) -> None:
        source = ops.emit("add", "i", first, k)
        ops.store(ops.load(memory.kind, memory.start, source), out.start, k)

    ops.repeat(offsets.size, visit)
    return out


def _elements(lower: Lowering, memory: InMemory, first: Value, offsets: np.ndarray) -> list[Value]:
    return [lower.ops.load(memory.kind, memory.start + int(k), first) for k in offsets]


def _dynamic_slice(
    lower: Lowering, equation: core.JaxprEqn, array: Array, *starts: Array
) -> list[Array]:
    shape, sizes = aval_of(equation.invars[0]).shape, tuple(equation.params["slice_sizes"])
    first = _first_element(lower, starts, shape, sizes)
    offsets = _offsets(sizes, _strides(shape))
    known = lower.ops.number(first)
    if known is not None:
        return [lower.take(array, (offsets + int(known)).reshape(sizes))]
    return [read_block(lower, lower.in_memory(array, tuple(shape)), first, offsets, sizes)]


def _dynamic_update_slice(
    lower: Lowering, equation: core.JaxprEqn, array: Array, update: Array, *starts: Array
) -> list[Array]:
    shape, sizes = (tuple(aval_of(equation.invars[k]).shape) for k in (0, 1))
    first = _first_element(lower, starts, shape, sizes)
    offsets = _offsets(sizes, _strides(shape))
    known = lower.ops.number(first)
    small = not isinstance(array, InMemory)
    if small and known is not None:
        values = lower.values(array)
        for k, value in zip(offsets, lower.values(update), strict=True):
            values[int(k) + int(known)] = value
        return [lower.array(values, shape)]
    memory = lower.in_memory(array, shape)
    if not memory.owned:
        memory = lower.copied(memory)
    if isinstance(update, InMemory):
        if not is_contiguous(offsets):
            raise UnsupportedPrimitiveError("dynamic_update_slice of many rows")
        lower.write(update, memory.start, first)
    else:
        for k, value in zip(offsets, lower.values(update), strict=True):
            lower.ops.store(value, memory.start + int(k), first)
    return [lower.read(memory) if small else replace(memory, owned=True)]


def _gather(lower: Lowering, equation: core.JaxprEqn, array: Array, indices: Array) -> list[Array]:
    """Return one block of the array for each row of indices (see `jax.lax.gather`)."""
    parameters, shape = equation.params, aval_of(equation.invars[0]).shape
    numbers = parameters["dimension_numbers"]
    sizes, out = parameters["slice_sizes"], aval_of(equation.outvars[0])
    fills = "FILL" in str(parameters["mode"])
    if numbers.operand_batching_dims:
        raise UnsupportedPrimitiveError("gather of batches")
    *batch, depth = aval_of(equation.invars[1]).shape
    block_axes = [k for k in range(len(shape)) if k not in numbers.collapsed_slice_dims]
    block = [sizes[k] for k in block_axes]
    strides = _strides(shape)
    offsets = _offsets(block, [strides[axis] for axis in block_axes])
    memory: InMemory | None = array if isinstance(array, InMemory) else None
    small = None if memory is not None else lower.values(array)

    def block_at(starts: list[Value]) -> list[Value]:
        nonlocal memory
        ops = lower.ops
        first, fits = ops.constant("i", 0), ops.constant("b", True)
        for start, axis in zip(starts, numbers.start_index_map, strict=True):
            given = _as_index(lower, start)
            index = _clamped(lower, given, shape[axis] - sizes[axis])
            fits = ops.emit("and", "b", fits, ops.emit("ieq", "b", index, given))
            step = ops.emit("mul", "i", index, ops.constant("i", strides[axis]))
            first = ops.emit("add", "i", first, step)
        known = ops.number(first)
        if small is not None and known is not None:
            values = [small[int(known) + int(k)] for k in offsets]
        else:
            # A small array is written to memory once, for all blocks at computed indices.
            if memory is None:
                memory = lower.in_memory(array, tuple(shape))
            values = _elements(lower, memory, first, offsets)
        if not fills:
            return values
        # The block was read from inside of the array; it is replaced if it lies outside.
        kind = ops.kinds[values[0]]
        missing = ops.constant(kind, _fill_value(parameters["fill_value"], out.dtype))
        return [ops.emit("select", kind, fits, value, missing) for value in values]

    count = math.prod(batch)
    if out.size <= LARGEST_UNROLLED:
        flat = lower.values(indices)
        blocks = [block_at(flat[k * depth : (k + 1) * depth]) for k in range(count)]
        values = np.array(blocks, dtype=np.int64).reshape([*batch, *block])
        # The axes of a block go to `offset_dims` of the result, those of the batch between them.
        values = np.moveaxis(values, range(len(batch), values.ndim), numbers.offset_dims)
        return [lower.array(values.ravel().tolist(), tuple(out.shape))]
    if tuple(numbers.offset_dims) != tuple(range(len(batch), len(out.shape))):
        raise UnsupportedPrimitiveError("gather of large transposed arrays")
    table = lower.in_memory(indices, tuple(aval_of(equation.invars[1]).shape))
    if memory is None:
        memory = lower.in_memory(array, tuple(shape))
    result = lower.new_array(tuple(out.shape), memory.kind)

    def visit(k: Value) -> None:
        ops = lower.ops
        row = ops.emit("mul", "i", k, ops.constant("i", depth))
        starts = [ops.load(table.kind, table.start + j, row) for j in range(depth)]
        first = ops.emit("mul", "i", k, ops.constant("i", offsets.size))
        for j, value in enumerate(block_at(starts)):
            ops.store(value, result.start + j, first)

    lower.ops.repeat(count, visit)
    return [result]


def _fill_value(given: object, dtype: np.dtype) -> float | int | bool:
    """Return JAX's value for elements outside of an array (see `jax.lax.gather`)."""
    if given is not None:
        return np.asarray(given, dtype).item()
    if dtype.kind == "f":
        return math.nan
    if dtype.kind == "b":
        return True
    return int(np.iinfo(dtype).max if dtype.kind == "u" else np.iinfo(dtype).min)


def _scatter(
    lower: Lowering,
    equation: core.JaxprEqn,
    array: Array,
    indices: Array,
    updates: Array,
    name: str,
) -> list[Array]:
    """A small array with elements replaced by updates, or combined with them by the rule `name`.

    The index of an update may be computed, so every element is selected from its old value and the
    update.
    """
    shape, numbers = aval_of(equation.invars[0]).shape, equation.params["dimension_numbers"]
    update_shape, depth = aval_of(equation.invars[2]).shape, aval_of(equation.invars[1]).shape[-1]
    large = [a for a in (array, indices, updates) if isinstance(a, InMemory)]
    if large or numbers.operand_batching_dims:
        raise UnsupportedPrimitiveError(f"{equation.primitive.name} of large arrays")
    ops, kind, values = lower.ops, kind_of(aval_of(equation.outvars[0])), lower.values(array)
    strides, starts, news = _strides(shape), lower.values(indices), lower.values(updates)
    clips = "CLIP" in str(equation.params["mode"])
    # Axes of the updates are those of a window in the array, and those of the batch of windows.
    windows = list(numbers.update_window_dims)
    window_axes = [k for k in range(len(shape)) if k not in numbers.inserted_window_dims]
    sizes = {axis: update_shape[k] for k, axis in zip(windows, window_axes, strict=True)}
    batches = [k for k in range(len(update_shape)) if k not in windows]
    batch_shape = [update_shape[k] for k in batches]
    for new, position in zip(news, np.ndindex(*update_shape), strict=True):
        batch_position = [position[k] for k in batches]
        row = int(np.ravel_multi_index(batch_position, batch_shape)) if batch_shape else 0
        offsets = dict.fromkeys(range(len(shape)), 0)
        offsets |= {axis: position[k] for k, axis in zip(windows, window_axes, strict=True)}
        target, fits = ops.constant("i", 0), ops.constant("b", True)
        for j, axis in enumerate(numbers.scatter_dims_to_operand_dims):
            # A window that lies partly outside is dropped as a whole, or with "CLIP" moved inside.
            given = _as_index(lower, starts[row * depth + j])
            start = _clamped(lower, given, shape[axis] - sizes.get(axis, 1))
            if not clips:
                fits = ops.emit("and", "b", fits, ops.emit("ieq", "b", start, given))
            start = ops.emit("add", "i", start, ops.constant("i", offsets.pop(axis)))
            step = ops.emit("mul", "i", start, ops.constant("i", strides[axis]))
            target = ops.emit("add", "i", target, step)
        rest = sum(strides[axis] * offset for axis, offset in offsets.items())
        target = ops.emit("add", "i", target, ops.constant("i", rest))
        known = ops.number(target)
        for k in range(len(values)) if known is None else [int(known)]:
            if not 0 <= k < len(values):
                continue
            is_target = ops.emit("ieq", "b", target, ops.constant("i", k))
            replaced = ops.emit("and", "b", fits, is_target)
            combined = ELEMENTWISE[name](ops, kind, {}, values[k], new) if name else new
            values[k] = ops.emit("select", kind, replaced, combined, values[k])
    return [lower.array(values, tuple(shape))]


RULES: dict[str, EquationRule] = {
    "dynamic_slice": _dynamic_slice,
    "dynamic_update_slice": _dynamic_update_slice,
    "gather": _gather,
    "scatter": partial(_scatter, name=""),
    "scatter-add": partial(_scatter, name="add"),
    "scatter-mul": partial(_scatter, name="mul"),
    "scatter-min": partial(_scatter, name="min"),
    "scatter-max": partial(_scatter, name="max"),
}
"""Rules by the names of primitives."""
