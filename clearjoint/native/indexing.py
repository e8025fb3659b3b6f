"""Primitives that read or write elements at computed places; rules as in `.structure`."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from jax.extend import core

from . import elementwise
from .elementwise import RULES as ELEMENTWISE
from .lowering import (
    LARGEST_TAKEN_APART,
    Array,
    EquationRule,
    InMemory,
    Lowering,
    UnsupportedPrimitiveError,
    aval_of,
    kind_of,
)
from .operations import Value


def _strides(shape: Sequence[int]) -> list[int]:
    return [int(np.prod(shape[k + 1 :], dtype=int)) for k in range(len(shape))]


def _whole(lower: Lowering, value: Value) -> Value:
    return elementwise.convert(lower.do, "i", value)


def _clamped(lower: Lowering, value: Value, high: int) -> Value:
    bounds = [lower.do.constant("i", number) for number in (0, high)]
    return ELEMENTWISE["clamp"](lower.do, "i", {}, bounds[0], _whole(lower, value), bounds[1])


def _first_place(
    lower: Lowering, starts: Sequence[Array], shape: Sequence[int], sizes: Sequence[int]
) -> Value:
    """The place among all elements of a block of some sizes in an array."""
    do, total = lower.do, lower.do.constant("i", 0)
    rows = zip(starts, shape, sizes, _strides(shape), strict=True)
    for start, length, size, stride in rows:
        own = _clamped(lower, lower.values(start)[0], length - size)
        total = do.do("add", "i", total, do.do("mul", "i", own, do.constant("i", stride)))
    return total


def _places_in(shape: Sequence[int], sizes: Sequence[int]) -> np.ndarray:
    every = np.arange(int(np.prod(shape, dtype=int))).reshape(shape)
    return every[tuple(slice(size) for size in sizes)].ravel()


def elements_at(
    lower: Lowering, memory: InMemory, first: Value, places: Iterable[int]
) -> list[Value]:
    """The elements of an array at places behind the `first` one."""
    return [lower.do.load(memory.kind, memory.start + int(k), first) for k in places]


def _dynamic_slice(
    lower: Lowering, equation: core.JaxprEqn, array: Array, *starts: Array
) -> list[Array]:
    shape, sizes = aval_of(equation.invars[0]).shape, equation.params["slice_sizes"]
    first = _first_place(lower, starts, shape, sizes)
    places = _places_in(shape, sizes)
    known = lower.do.number(first)
    if known is not None:
        return [lower.moved(equation, array, (places + int(known)).reshape(sizes))]
    memory = lower.in_memory(array, tuple(shape))
    if places.size <= LARGEST_TAKEN_APART:
        return [lower.array(elements_at(lower, memory, first, places), tuple(sizes))]
    if not np.array_equal(places, np.arange(places.size)):
        raise UnsupportedPrimitiveError("dynamic_slice of many rows")

    def visit(k: Value) -> None:
        place = lower.do.do("add", "i", first, k)
        lower.do.store(lower.do.load(memory.kind, memory.start, place), out.start, k)

    out = InMemory(lower.do.allocate(places.size), tuple(sizes), memory.kind, True)
    lower.do.repeat(places.size, visit)
    return [out]


def _dynamic_update_slice(
    lower: Lowering, equation: core.JaxprEqn, array: Array, update: Array, *starts: Array
) -> list[Array]:
    shape, sizes = (aval_of(equation.invars[k]).shape for k in (0, 1))
    first = _first_place(lower, starts, shape, sizes)
    places = _places_in(shape, sizes)
    known = lower.do.number(first)
    small = not isinstance(array, InMemory)
    if small and known is not None:
        values = lower.values(array)
        for k, value in zip(places, lower.values(update), strict=True):
            values[int(k) + int(known)] = value
        return [lower.array(values, tuple(shape))]
    memory = lower.in_memory(array, tuple(shape))
    if not memory.owned:
        memory = lower.copied(memory)
    if isinstance(update, InMemory):
        if not np.array_equal(places, np.arange(places.size)):
            raise UnsupportedPrimitiveError("dynamic_update_slice of many rows")
        source = update

        def visit(k: Value) -> None:
            place = lower.do.do("add", "i", first, k)
            lower.do.store(lower.do.load(source.kind, source.start, k), memory.start, place)

        lower.do.repeat(places.size, visit)
    else:
        for k, value in zip(places, lower.values(update), strict=True):
            lower.do.store(value, memory.start + int(k), first)
    return [lower.read(memory) if small else replace(memory, owned=True)]


def _gather(lower: Lowering, equation: core.JaxprEqn, array: Array, indices: Array) -> list[Array]:
    parameters, shape = equation.params, aval_of(equation.invars[0]).shape
    numbers = parameters["dimension_numbers"]
    sizes, out = parameters["slice_sizes"], aval_of(equation.outvars[0])
    fills = "FILL" in str(parameters["mode"])
    if numbers.operand_batching_dims:
        raise UnsupportedPrimitiveError("gather of batches")
    batch = aval_of(equation.invars[1]).shape[:-1]
    offsets = [k for k in range(len(shape)) if k not in numbers.collapsed_slice_dims]
    block = [sizes[k] for k in offsets]
    strides = _strides(shape)
    inside = _cells_of_block(block, [strides[axis] for axis in offsets])
    depth = aval_of(equation.invars[1]).shape[-1]
    memory: InMemory | None = array if isinstance(array, InMemory) else None
    small = None if memory is not None else lower.values(array)

    def rows_at(starts: list[Value]) -> list[Value]:
        nonlocal memory
        do, first, fits = lower.do, lower.do.constant("i", 0), lower.do.constant("b", True)
        for start, axis in zip(starts, numbers.start_index_map, strict=True):
            whole, high = _whole(lower, start), shape[axis] - sizes[axis]
            own = _clamped(lower, whole, high)
            fits = do.do("and", "b", fits, do.do("ieq", "b", own, whole))
            step = do.do("mul", "i", own, do.constant("i", strides[axis]))
            first = do.do("add", "i", first, step)
        known = do.number(first)
        if small is not None and known is not None:
            values = [small[int(known) + int(k)] for k in inside]
        else:
            if memory is None:
                memory = lower.in_memory(array, tuple(shape))
            values = elements_at(lower, memory, first, inside)
        if not fills:
            return values
        kind = do.kinds[values[0]]
        missing = do.constant(kind, _fill_value(parameters["fill_value"], out.dtype))
        return [do.do("select", kind, fits, value, missing) for value in values]

    count = int(np.prod(batch, dtype=int))
    if int(np.prod(out.shape, dtype=int)) <= LARGEST_TAKEN_APART:
        flat = lower.values(indices)
        rows = [rows_at(flat[k * depth : (k + 1) * depth]) for k in range(count)]
        values = np.array(rows, dtype=np.int64).reshape([*batch, *block])
        # The axes of a block stand at `offset_dims` of the result, those of the batch between.
        behind = range(len(batch), values.ndim)
        values = np.moveaxis(values, behind, numbers.offset_dims)
        return [lower.array(values.ravel().tolist(), tuple(out.shape))]
    if tuple(numbers.offset_dims) != tuple(range(len(batch), len(out.shape))):
        raise UnsupportedPrimitiveError("gather of large transposed arrays")
    table = lower.in_memory(indices, aval_of(equation.invars[1]).shape)
    if memory is None:
        memory = lower.in_memory(array, tuple(shape))
    result = InMemory(lower.do.allocate(count * inside.size), tuple(out.shape), memory.kind, True)

    def visit(k: Value) -> None:
        do = lower.do
        row = do.do("mul", "i", k, do.constant("i", depth))
        starts = [do.load(table.kind, table.start + j, row) for j in range(depth)]
        first = do.do("mul", "i", k, do.constant("i", inside.size))
        for j, value in enumerate(rows_at(starts)):
            do.store(value, result.start + j, first)

    lower.do.repeat(count, visit)
    return [result]


def _cells_of_block(sizes: list[int], strides: list[int]) -> np.ndarray:
    """The cells of a block of an array, from its first one on, in order."""
    cells = np.zeros(sizes, int)
    for axis, (size, stride) in enumerate(zip(sizes, strides, strict=True)):
        shape = [-1 if k == axis else 1 for k in range(len(sizes))]
        cells += stride * np.arange(size).reshape(shape)
    return cells.ravel()


def _fill_value(given: object, dtype: np.dtype) -> float | int | bool:
    """What JAX puts in the place of elements outside of an array (see `jax.lax.gather`)."""
    if given is not None:
        return np.asarray(given, dtype).item()
    if dtype.kind == "f":
        return math.nan
    if dtype.kind == "b":
        return True
    return int(np.iinfo(dtype).max if dtype.kind == "u" else np.iinfo(dtype).min)


def _scattered(
    lower: Lowering,
    equation: core.JaxprEqn,
    array: Array,
    indices: Array,
    updates: Array,
    name: str,
) -> list[Array]:
    """A small array with some elements replaced, or joined with updates by a rule."""
    shape, numbers = aval_of(equation.invars[0]).shape, equation.params["dimension_numbers"]
    update_shape, depth = aval_of(equation.invars[2]).shape, aval_of(equation.invars[1]).shape[-1]
    large = [a for a in (array, indices, updates) if isinstance(a, InMemory)]
    if large or numbers.operand_batching_dims:
        raise UnsupportedPrimitiveError(f"{equation.primitive.name} of large arrays")
    do, kind, values = lower.do, kind_of(aval_of(equation.outvars[0])), lower.values(array)
    strides, starts, news = _strides(shape), lower.values(indices), lower.values(updates)
    clips = "CLIP" in str(equation.params["mode"])
    windows = list(numbers.update_window_dims)
    kept = [k for k in range(len(shape)) if k not in numbers.inserted_window_dims]
    sizes = {axis: update_shape[k] for k, axis in zip(windows, kept, strict=True)}
    batches = [k for k in range(len(update_shape)) if k not in windows]
    batch_shape = [update_shape[k] for k in batches]
    for new, place in zip(news, np.ndindex(*update_shape), strict=True):
        row = int(np.ravel_multi_index([place[k] for k in batches], batch_shape))
        row = row if batch_shape else 0
        offsets = dict.fromkeys(range(len(shape)), 0)
        offsets |= {axis: place[k] for k, axis in zip(windows, kept, strict=True)}
        own, fits = do.constant("i", 0), do.constant("b", True)
        for j, axis in enumerate(numbers.scatter_dims_to_operand_dims):
            # As a whole, a window lies inside or is dropped, unless it is to be moved inside.
            given = _whole(lower, starts[row * depth + j])
            start = _clamped(lower, given, shape[axis] - sizes.get(axis, 1))
            if not clips:
                fits = do.do("and", "b", fits, do.do("ieq", "b", start, given))
            start = do.do("add", "i", start, do.constant("i", offsets.pop(axis)))
            step = do.do("mul", "i", start, do.constant("i", strides[axis]))
            own = do.do("add", "i", own, step)
        rest = sum(strides[axis] * offset for axis, offset in offsets.items())
        own = do.do("add", "i", own, do.constant("i", rest))
        known = do.number(own)
        targets = range(len(values)) if known is None else [int(known)]
        for k in targets:
            if not 0 <= k < len(values):
                continue
            here = do.do("and", "b", fits, do.do("ieq", "b", own, do.constant("i", k)))
            joined = new if not name else ELEMENTWISE[name](do, kind, {}, values[k], new)
            values[k] = do.do("select", kind, here, joined, values[k])
    return [lower.array(values, tuple(shape))]


RULES: dict[str, EquationRule] = {
    "dynamic_slice": _dynamic_slice,
    "dynamic_update_slice": _dynamic_update_slice,
    "gather": _gather,
    "scatter": partial(_scattered, name=""),
    "scatter-add": partial(_scattered, name="add"),
    "scatter-mul": partial(_scattered, name="mul"),
    "scatter-min": partial(_scattered, name="min"),
    "scatter-max": partial(_scattered, name="max"),
}
"""Rules by the names of primitives."""
