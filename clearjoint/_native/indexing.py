"""Rules of the primitives that read or write elements at computed indices.

A block is a rectangular part of an array, given by the row-major index of its first element, which
the program computes, and the offsets of its elements from there, which are known before.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from jax.extend import core

from .elementwise import clamp, convert
from .lowering import (
    LARGEST_UNROLLED,
    Array,
    Equation,
    EquationRule,
    InMemory,
    Lowering,
    UnsupportedPrimitiveError,
    aval_of,
    is_contiguous,
    scalar,
)
from .operations import Symbol, Value


def _strides(shape: Sequence[int]) -> list[int]:
    return [math.prod(shape[k + 1 :]) for k in range(len(shape))]


def _offsets(sizes: Sequence[int], strides: Sequence[int]) -> np.ndarray:
    """Return the offsets of a block's elements from its first element, in row-major order. `sizes`
    are those of the block, and `strides` those of the array along the same axes."""
    indices = np.indices(tuple(sizes)).reshape(len(sizes), math.prod(sizes))
    return np.array(strides, int) @ indices


def _moved_inside(
    lower: Lowering, starts: Sequence[Value], lengths: Sequence[int], sizes: Sequence[int]
) -> tuple[list[Symbol], Symbol]:
    """Return the starts of a block along some axes, moved so that the block lies inside of the
    array, and whether it lay there already. `lengths` are the array's, and `sizes` the block's."""
    inside: list[Symbol] = []
    fits = Symbol(lower.ops, lower.ops.constant("b", True))
    for start, length, size in zip(starts, lengths, sizes, strict=True):
        index_of_start = convert(Symbol(lower.ops, start), "i")
        low, high = map(index_of_start.like, (0, length - size))
        inside.append(clamp(low, index_of_start, high))
        fits &= inside[-1].compare("eq", index_of_start)
    return inside, fits


def flat_index(
    lower: Lowering, indices: Sequence[Symbol], strides: Sequence[int], first: int = 0
) -> Symbol:
    """Return `first` plus the sum of the indices times their strides."""
    total = Symbol(lower.ops, lower.ops.constant("i", first))
    for index, stride in zip(indices, strides, strict=True):
        total += index * stride
    return total


def read_block(
    lower: Lowering, memory: InMemory, first: Value, offsets: np.ndarray, shape: tuple[int, ...]
) -> Array:
    """Return a block that lies wholly inside of the array `memory`, in the given shape. `first` is
    the index of the block's first element, and `offsets` has the offset of each element from it."""
    ops = lower.ops
    if offsets.size <= LARGEST_UNROLLED:
        return lower.array(_elements(lower, memory, first, offsets), shape)
    # A large block is copied by a loop over consecutive elements.
    if not is_contiguous(offsets):
        raise UnsupportedPrimitiveError("dynamic_slice of many rows")
    out = lower.new_array(shape, memory.kind)

    def visit(k: Value) -> None:
        source = ops.emit("add", "i", first, k)
        ops.store(lower.load(memory, source), out.start, k)

    ops.repeat(offsets.size, visit)
    return out


def _elements(lower: Lowering, memory: InMemory, first: Value, offsets: np.ndarray) -> list[Value]:
    return [lower.load(memory, first, int(k)) for k in offsets]


def _block_of_slice(
    lower: Lowering, shape: tuple[int, ...], sizes: tuple[int, ...], starts: Sequence[Array]
) -> tuple[Value, np.ndarray]:
    """Return a slice of the given sizes, moved inside of the array of the given shape, as a block:
    the index of its first element, and the offsets of its elements from there."""
    values = [lower.values(start)[0] for start in starts]
    inside, _ = _moved_inside(lower, values, shape, sizes)
    strides = _strides(shape)
    return flat_index(lower, inside, strides).value, _offsets(sizes, strides)


def _dynamic_slice(
    lower: Lowering, equation: Equation, array: Array, *starts: Array
) -> list[Array]:
    shape = tuple(aval_of(equation.invars[0]).shape)
    sizes = tuple(equation.params["slice_sizes"])
    first, offsets = _block_of_slice(lower, shape, sizes, starts)
    # At an index that is known while the program is built, the elements are known values.
    number = lower.ops.number(first)
    if number is not None:
        return [lower.take(array, (offsets + int(number)).reshape(sizes))]
    return [read_block(lower, lower.in_memory(array, shape), first, offsets, sizes)]


def _dynamic_update_slice(
    lower: Lowering, equation: Equation, array: Array, update: Array, *starts: Array
) -> list[Array]:
    shape, sizes = (tuple(aval_of(equation.invars[k]).shape) for k in (0, 1))
    first, offsets = _block_of_slice(lower, shape, sizes, starts)
    # `number` is None if only the run determines the index.
    number = lower.ops.number(first)
    small = not isinstance(array, InMemory)
    if small and number is not None:
        # At a known index, the values of a small array are replaced while the program is built.
        values = lower.values(array)
        for k, value in zip(offsets, lower.values(update), strict=True):
            values[int(k) + int(number)] = value
        return [lower.array(values, shape)]
    memory = lower.in_memory(array, shape)
    # Only cells that nothing else reads may be overwritten.
    if not memory.owned:
        memory = lower.copied(memory)
    # Only a block of consecutive elements can be copied from memory to memory by one loop.
    if isinstance(update, InMemory):
        if not is_contiguous(offsets):
            raise UnsupportedPrimitiveError("dynamic_update_slice of many rows")
        lower.write(update, memory.start, first)
    else:
        for k, value in zip(offsets, lower.values(update), strict=True):
            lower.ops.store(value, memory.start + int(k), first)
    return [lower.read(memory) if small else replace(memory, owned=True)]


def _gather(lower: Lowering, equation: Equation, array: Array, indices: Array) -> list[Array]:
    """Return one block of the array for each row of indices (see `jax.lax.gather`). A block that
    lies partly outside of the array is moved inside; in the mode "fill", all of its elements are
    the fill value instead."""
    ops, parameters = lower.ops, equation.params
    numbers, sizes = parameters["dimension_numbers"], parameters["slice_sizes"]
    if numbers.operand_batching_dims:
        raise UnsupportedPrimitiveError("gather of batches")
    shape, index_shape = (tuple(aval_of(v).shape) for v in equation.invars)
    out, strides = aval_of(equation.outvars[0]), _strides(shape)
    # A row, which is the last axis of the indices, has the start of a block along the axes `axes`
    # of the array. The other axes of the indices, `batch`, number the blocks.
    *batch, depth = index_shape
    axes = numbers.start_index_map
    # A block has the axes of the array that are not collapsed.
    block_axes = [k for k in range(len(shape)) if k not in numbers.collapsed_slice_dims]
    block = [sizes[axis] for axis in block_axes]
    offsets = _offsets(block, [strides[axis] for axis in block_axes])
    fills = "FILL" in str(parameters["mode"])

    def block_at(starts: list[Value], read: Callable[[Value], list[Value]]) -> list[Value]:
        lengths, extents = ([all_axes[axis] for axis in axes] for all_axes in (shape, sizes))
        inside, fits = _moved_inside(lower, starts, lengths, extents)
        values = read(flat_index(lower, inside, [strides[axis] for axis in axes]).value)
        if not fills or not values:
            return values
        # The block has been read after it was moved inside. If it had to be moved, its elements are
        # replaced by the fill value.
        kind = ops.kinds[values[0]]
        missing = ops.constant(kind, _fill_value(parameters["fill_value"], out.dtype))
        return [ops.emit("select", kind, fits.value, value, missing) for value in values]

    # The elements are numbered block after block. `elements` has the number of the element at each
    # place of the result, in which the axes of a block are `offset_dims`.
    elements = np.arange(out.size).reshape([*batch, *block])
    elements = np.moveaxis(elements, range(len(batch), elements.ndim), numbers.offset_dims).ravel()
    if out.size <= LARGEST_UNROLLED:
        read = _block_reader(lower, array, shape, offsets)
        starts = lower.values(indices)
        rows = [starts[k * depth : (k + 1) * depth] for k in range(math.prod(batch))]
        values = [value for row in rows for value in block_at(row, read)]
        return [lower.array([values[k] for k in elements], tuple(out.shape))]
    # A large result is written by a loop over the blocks. Unless their axes come last, a table has
    # the place of each element in the result, the inverse of `elements`.
    places = None if is_contiguous(elements) else lower.table(np.argsort(elements))
    table, memory = lower.in_memory(indices, index_shape), lower.in_memory(array, shape)
    result = lower.new_array(tuple(out.shape), memory.kind)
    read = _block_reader(lower, memory, shape, offsets)

    def visit(k: Value) -> None:
        # Where the k-th row of indices begins, and the number of the k-th block's first element.
        row, first_element = (Symbol(ops, k) * size for size in (depth, offsets.size))
        starts = [lower.load(table, row.value, j) for j in range(depth)]
        for j, value in enumerate(block_at(starts, read)):
            if places is None:
                ops.store(value, result.start + j, first_element.value)
            else:
                place = lower.load(places, first_element.value, j)
                ops.store(value, result.start, place)

    ops.repeat(math.prod(batch), visit)
    return [result]


def _block_reader(
    lower: Lowering, array: Array, shape: tuple[int, ...], offsets: np.ndarray
) -> Callable[[Value], list[Value]]:
    memory = array if isinstance(array, InMemory) else None
    small_values = None if memory is not None else lower.values(array)

    # The elements of the block whose first element has the index `first`.
    def read(first: Value) -> list[Value]:
        nonlocal memory
        number = lower.ops.number(first)
        # At a known index, a small array is not read from memory.
        if small_values is not None and number is not None:
            return [small_values[int(number) + int(k)] for k in offsets]
        # A small array is written to memory once, for all blocks at computed indices.
        if memory is None:
            memory = lower.in_memory(array, shape)
        return _elements(lower, memory, first, offsets)

    return read


def _fill_value(fill_value: object, dtype: np.dtype) -> float | int | bool:
    """Return the value for elements outside of an array, by default that of `jax.lax.gather`."""
    if fill_value is not None:
        return np.asarray(fill_value, dtype).item()
    if dtype.kind == "f":
        return math.nan
    if dtype.kind == "b":
        return True
    return int(np.iinfo(dtype).max if dtype.kind == "u" else np.iinfo(dtype).min)


def _scatter(
    lower: Lowering, equation: Equation, array: Array, indices: Array, updates: Array, name: str
) -> list[Array]:
    """Return an array in which updates replace elements, or are combined with them by the primitive
    `name` unless it is "" (see `jax.lax.scatter`).

    A window is the block of the array that the updates for one row of indices change. If it lies
    partly outside of the array, its updates are dropped; in the mode "clip" it is moved inside.
    """
    shape, index_shape, update_shape = (aval_of(v).shape for v in equation.invars)
    numbers, depth = equation.params["dimension_numbers"], index_shape[-1]
    if numbers.operand_batching_dims:
        raise UnsupportedPrimitiveError(f"{equation.primitive.name} of batches")
    # An array without elements has no index at which something could be replaced.
    if not math.prod(shape):
        return [array]
    combine = _combination(lower, equation, name)
    memory = array if isinstance(array, InMemory) else None
    if memory is not None and not memory.owned:
        memory = lower.copied(memory)
    values = lower.values(array) if memory is None else []
    ops, strides = lower.ops, _strides(shape)
    starts = lower.values(indices)
    clips = "CLIP" in str(equation.params["mode"])
    # A row, which is the last axis of the indices, has `depth` numbers: the start of a window along
    # each of these axes.
    axes = numbers.scatter_dims_to_operand_dims
    # Axes of the updates are those of a window in the array, and those of the batch of windows.
    windows = list(numbers.update_window_dims)
    window_axes = [k for k in range(len(shape)) if k not in numbers.inserted_window_dims]
    sizes = {axis: update_shape[k] for k, axis in zip(windows, window_axes, strict=True)}
    batches = [k for k in range(len(update_shape)) if k not in windows]
    batch_shape = [update_shape[k] for k in batches]
    for new, position in zip(lower.values(updates), np.ndindex(*update_shape), strict=True):
        # The window that contains this update, and where the update is in it.
        batch = [position[k] for k in batches]
        row = int(np.ravel_multi_index(batch, batch_shape)) if batch else 0
        offsets = dict.fromkeys(range(len(shape)), 0)
        offsets |= {axis: position[k] for k, axis in zip(windows, window_axes, strict=True)}
        # A window that lies partly outside is dropped as a whole, or with "CLIP" moved inside.
        lengths, extents = [shape[k] for k in axes], [sizes.get(k, 1) for k in axes]
        window_starts = starts[row * depth : (row + 1) * depth]
        inside, fits = _moved_inside(lower, window_starts, lengths, extents)
        along = [start + offsets.pop(axis) for start, axis in zip(inside, axes, strict=True)]
        # Along the other axes, whose offsets remain, each window starts at 0.
        known_offset = sum(strides[axis] * offset for axis, offset in offsets.items())
        target = flat_index(lower, along, [strides[axis] for axis in axes]) + known_offset
        if memory is not None:
            # Moved inside, the target is an element of the array even if nothing is to change.
            old = Symbol(ops, lower.load(memory, target.value))
            combined = Symbol(ops, combine(old.value, new))
            changed = combined if clips else fits.select(combined, old)
            ops.store(changed.value, memory.start, target.value)
            continue
        # The element with the index `target` changes; unless that is known, it may be any element.
        number = ops.number(target.value)
        for k in range(len(values)) if number is None else [int(number)]:
            is_target = target.compare("eq", k)
            replaced = is_target if clips else fits & is_target
            combined = Symbol(ops, combine(values[k], new))
            values[k] = replaced.select(combined, Symbol(ops, values[k])).value
    if memory is not None:
        return [replace(memory, owned=True)]
    return [lower.array(values, tuple(shape))]


def _combination(lower: Lowering, equation: Equation, name: str) -> Callable[[Value, Value], Value]:
    """Return the function (old element, update) -> new element: the operation `name`, say "add".
    For "", it returns the update or, for `x.at[k].apply`, a function of the old element."""
    if name:
        return lower.operation(name, aval_of(equation.invars[0]))
    # "scatter" has a jaxpr that returns the update or, for `x.at[k].apply`, a function of the
    # element. Without a jaxpr, the update replaces the element.
    jaxpr, consts = (equation.params[key] for key in ("update_jaxpr", "update_consts"))
    if jaxpr is None or jaxpr.outvars[0] is jaxpr.invars[1]:
        return lambda old, new: new
    closed = core.ClosedJaxpr(jaxpr, consts)

    def combine(old: Value, new: Value) -> Value:
        (result,) = lower.inline(closed, [old, new])
        return scalar(result)

    return combine


RULES: dict[str, EquationRule] = {
    "dynamic_slice": _dynamic_slice,
    "dynamic_update_slice": _dynamic_update_slice,
    "gather": _gather,
    "scatter": partial(_scatter, name=""),
    **{f"scatter-{name}": partial(_scatter, name=name) for name in ("add", "mul", "min", "max")},
}
"""Rules by the names of primitives."""
