"""Rules of the primitives that rearrange or combine elements, such as slices and sums.

A rule that rearranges elements applies the corresponding NumPy operation to an array with the
row-major index of each element: the result has in each position the index of the element that is
moved there.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial, reduce

import numpy as np
from jax.core import ShapedArray

from .elementwise import apply, convert
from .indexing import flat_index
from .linear_algebra import large_product
from .lowering import (
    LARGEST_UNROLLED,
    Array,
    Equation,
    EquationRule,
    InMemory,
    Lowering,
    Packed,
    UnsupportedPrimitiveError,
    aval_of,
    element_indices,
    is_contiguous,
    kind_of,
)
from .operations import Symbol, Value

Rearrange = Callable[[np.ndarray, dict], Sequence[np.ndarray]]
"""Function of the row-major indices of an array's elements, in the array's shape, and an equation's
parameters. It returns the indices in the shapes and places of the equation's results."""
Join = Callable[[list[np.ndarray], dict], np.ndarray]
"""Function of the indices of several arrays, in the arrays' shapes and numbered one array after the
other, and an equation's parameters. It returns the indices in the shape of the single result."""
Combine = Callable[[Value, Value], Value]


def _rearranged(
    lower: Lowering, equation: Equation, array: Array, rearrange: Rearrange
) -> list[Array]:
    indices = element_indices(aval_of(equation.invars[0]))
    return [lower.take(array, part) for part in rearrange(indices, equation.params)]


def _reshape(lower: Lowering, equation: Equation, array: Array) -> list[Array]:
    shape = tuple(aval_of(equation.outvars[0]).shape)
    order = equation.params["dimensions"] if equation.primitive.name == "reshape" else None
    if order is not None:
        # The axes are permuted first, as by `order="F"` of `jnp.reshape`.
        return _rearranged(lower, equation, array, lambda k, _: [k.transpose(order).reshape(shape)])
    if isinstance(array, InMemory):
        return [replace(array, shape=shape)]
    return [lower.array(lower.values(array), shape)]


def _slice(lower: Lowering, equation: Equation, array: Array) -> list[Array]:
    parameters = equation.params
    steps = parameters["strides"] or (1,) * len(parameters["start_indices"])
    rows = zip(parameters["start_indices"], parameters["limit_indices"], steps, strict=True)
    part = tuple(slice(*row) for row in rows)
    if isinstance(array, Packed) and aval_of(equation.outvars[0]).shape == (1,):
        # A single element. `take` would also extract the elements of all other tangents.
        return [lower.array([lower.ops.element(array.value, part[0].start)], (1,))]
    return _rearranged(lower, equation, array, lambda indices, _: [indices[part]])


def _unstack(lower: Lowering, equation: Equation, array: Array) -> list[Array]:
    if aval_of(equation.outvars[0]).shape == ():
        return list(lower.values(array))
    axis = equation.params["axis"]
    return _rearranged(lower, equation, array, lambda k, _: [*np.moveaxis(k, axis, 0)])


def _broadcast_in_dim(lower: Lowering, equation: Equation, array: Array) -> list[Array]:
    shape, dimensions = equation.params["shape"], equation.params["broadcast_dimensions"]
    # A scalar repeated for all tangents is one vector.
    if isinstance(array, int) and lower.is_packed(tuple(shape)):
        return [Packed(lower.vector(array))]

    # Axis k of the array becomes axis dimensions[k] of the result. Along all other axes of the
    # result, its elements are repeated.
    def rearrange(indices: np.ndarray, _: dict) -> list[np.ndarray]:
        expanded = [1] * len(shape)
        for axis, size in zip(dimensions, indices.shape, strict=True):
            expanded[axis] = size
        return [np.broadcast_to(indices.reshape(expanded), shape)]

    return _rearranged(lower, equation, array, rearrange)


def _joined(lower: Lowering, equation: Equation, *arrays: Array, join: Join) -> list[Array]:
    avals = [aval_of(v) for v in equation.invars]
    starts = np.cumsum([0, *(aval.size for aval in avals)]).tolist()
    # Elements are numbered one array after the other; `starts` has one more number at its end.
    rows = zip(avals, starts, strict=False)
    indices = join([element_indices(aval) + start for aval, start in rows], equation.params)
    out = aval_of(equation.outvars[0])
    if indices.size <= LARGEST_UNROLLED:
        values = [value for array in arrays for value in lower.values(array)]
        return [lower.array([values[k] for k in indices.ravel()], indices.shape)]
    memory = lower.new_array(tuple(out.shape), kind_of(out))
    # For each element, its place in the result: the permutation inverse to `indices`.
    places = np.argsort(indices, axis=None)
    for start, aval, array in zip(starts, avals, arrays, strict=False):
        places_of_array = places[start : start + aval.size]
        # An array whose elements stay next to each other is copied as it is. Otherwise each element
        # gets its own place, from a table for an array that is copied by a loop.
        if is_contiguous(places_of_array):
            lower.write(array, memory.start + int(places_of_array[0]))
        elif isinstance(array, InMemory):
            _copied_to(lower, array, memory, places_of_array)
        else:
            for place, value in zip(places_of_array.tolist(), lower.values(array), strict=True):
                lower.ops.store(value, memory.start + place)
    return [memory]


def _copied_to(lower: Lowering, array: InMemory, target: InMemory, places: np.ndarray) -> None:
    table = lower.table(places)

    def visit(k: Value) -> None:
        # A known place is the same in all lanes, which then write at once.
        lower.ops.store(lower.load(array, k), target.start, lower.load(table, k))

    lower.ops.repeat(array.size, visit)


def _pad(lower: Lowering, equation: Equation, array: Array, padding: Array) -> list[Array]:
    """Return the array with copies of the scalar `padding` before, after and between its elements
    (see `jax.lax.pad`). A negative number of copies before or after removes elements."""
    aval, out = aval_of(equation.invars[0]), aval_of(equation.outvars[0])
    # For each place of the result, whether it has an element of the array, and the row-major index
    # of this element.
    inside, indices = np.ones(out.shape, bool), np.zeros(out.shape, int)
    rows = zip(equation.params["padding_config"], np.indices(out.shape), aval.shape, strict=True)
    # Along an axis, an element of the array has every (between + 1)-th place from `low` on.
    for (low, _, between), place, length in rows:
        index, past_element = np.divmod(place - low, between + 1)
        inside &= (past_element == 0) & (index >= 0) & (index < length)
        indices = indices * length + index
    # The padding is numbered as the element after the last one of the array.
    indices = np.where(inside, indices, aval.size)
    if out.size > LARGEST_UNROLLED:
        source = lower.new_array((aval.size + 1,), kind_of(out))
        lower.write(array, source.start)
        lower.write(padding, source.start + aval.size)
        return [lower.take(source, indices)]
    values = [*lower.values(array), *lower.values(padding)]
    return [lower.array([values[k] for k in indices.ravel()], tuple(out.shape))]


def _iota(lower: Lowering, equation: Equation) -> list[Array]:
    aval = aval_of(equation.outvars[0])
    numbers = np.indices(aval.shape)[equation.params["dimension"]]
    return [lower.constant(numbers.astype(aval.dtype))]


def _empty(lower: Lowering, equation: Equation) -> list[Array]:
    """Return zeros for an array whose content does not matter, since it is written before it is
    read, as in the transpose of a loop."""
    aval = aval_of(equation.outvars[0])
    return [lower.constant(np.zeros(aval.shape, aval.dtype))]


def _nonempty(equation: Equation) -> ShapedArray:
    aval = aval_of(equation.invars[0])
    if not aval.size:
        raise UnsupportedPrimitiveError(f"{equation.primitive.name} of no elements")
    return aval


def _reduce(lower: Lowering, equation: Equation, array: Array, name: str) -> list[Array]:
    """Return an array whose elements are combined along some axes by the primitive `name`."""
    aval, axes = _nonempty(equation), tuple(equation.params["axes"])
    out = aval_of(equation.outvars[0])
    combine = lower.operation(name, out)
    # Large arrays are combined by loops.
    if isinstance(array, InMemory):
        if out.shape == ():
            return [_cumulate_memory(lower, array, combine)]
        # The loops need the elements that are combined at equal distances: along adjacent axes.
        if axes != tuple(range(axes[0], axes[-1] + 1)):
            raise UnsupportedPrimitiveError(f"{equation.primitive.name} along axes {axes}")
        return [_reduce_memory(lower, array, axes, combine)]
    values = np.array(lower.values(array)).reshape(aval.shape)
    # One row for each element of the result, with the elements that are combined to it.
    others = [k for k in range(values.ndim) if k not in axes]
    rows = values.transpose([*others, *axes]).reshape(out.size, -1)
    # Sums and products are computed from the first to the last element, one after the other. Each
    # addition of a product can then be a fused multiply-add. For all other operations, a tree has
    # the shorter chain of dependent instructions.
    fold = partial(reduce, combine) if name in ("add", "mul") else partial(_by_halves, combine)
    return [lower.array([fold(row) for row in rows.tolist()], tuple(out.shape))]


def _reduce_memory(
    lower: Lowering, array: InMemory, axes: tuple[int, ...], combine: Combine
) -> InMemory:
    """Return an array in memory with the elements of `array` combined along adjacent axes."""
    # The array counts as one of shape (before, along, after), the result as one of (before, after).
    first_axis, end = axes[0], axes[-1] + 1
    shape_before, shape_after = array.shape[:first_axis], array.shape[end:]
    before, along, after = map(math.prod, (shape_before, array.shape[first_axis:end], shape_after))
    ops, out = lower.ops, lower.new_array((*shape_before, *shape_after), array.kind)

    # Each term is an index along an axis and the stride of the axis.
    def index(*terms: tuple[Value, int], offset: int = 0) -> Value:
        numbers, strides = zip(*terms, strict=True)
        return flat_index(lower, [Symbol(ops, k) for k in numbers], strides, offset).value

    def element(i: Value, k: Value) -> None:
        target = index((i, after), (k, 1))

        # In the order of the elements, with the result so far in memory. It begins as the first
        # element, so that j = 0 stands for the second one, which is `after` places further on.
        def add(j: Value) -> None:
            place = index((i, along * after), (j, after), (k, 1), offset=after)
            combined = combine(lower.load(out, target), lower.load(array, place))
            ops.store(combined, out.start, target)

        begin = lower.load(array, index((i, along * after), (k, 1)))
        ops.store(begin, out.start, target)
        ops.repeat(along - 1, add)

    ops.repeat(before, lambda i: ops.repeat(after, lambda k: element(i, k)))
    return out


def _by_halves(combine: Combine, row: list[Value]) -> Value:
    if len(row) == 1:
        return row[0]
    middle = len(row) // 2
    return combine(_by_halves(combine, row[:middle]), _by_halves(combine, row[middle:]))


def _cumulate_memory(
    lower: Lowering, array: InMemory, combine: Combine, out: InMemory | None = None
) -> Value:
    """Add a loop that combines all elements of an array in memory, in their order, and return the
    total. The result after each element is written to `out`, if given."""
    ops = lower.ops
    first_element = lower.load(array)
    if out is not None:
        ops.store(first_element, out.start)

    def add(k: Value, totals: list[Value]) -> list[Value]:
        total = combine(totals[0], lower.load(array, k))
        if out is not None:
            ops.store(total, out.start, k)
        return [total]

    # The loop begins with the second element.
    second, end = ops.constant("i", 1), ops.constant("i", array.size)
    return ops.counted(second, end, [first_element], add)[0]


def _cumulate(lower: Lowering, equation: Equation, array: Array, name: str) -> list[Array]:
    aval = aval_of(equation.invars[0])
    combine = lower.operation(name, aval)
    axis, reverse = equation.params["axis"], equation.params["reverse"]
    if isinstance(array, InMemory):
        if len(aval.shape) != 1 or reverse:
            use = "in reverse order" if reverse else "of several axes"
            raise UnsupportedPrimitiveError(f"{equation.primitive.name} of large arrays {use}")
        out = lower.new_array(array.shape, array.kind)
        _cumulate_memory(lower, array, combine, out)
        return [out]
    # An integer here is the name of a value of the program.
    values = np.array(lower.values(array), dtype=np.int64).reshape(aval.shape)
    # A view of `values`, in which the rows are replaced one after the other.
    rows = np.moveaxis(values, axis, 0)
    rows = rows[::-1] if reverse else rows
    for k in range(1, len(rows)):
        for index in np.ndindex(*rows.shape[1:]):
            total_before, value = rows[(k - 1, *index)], rows[(k, *index)]
            rows[(k, *index)] = combine(int(total_before), int(value))
    return [lower.array(values.ravel().tolist(), tuple(aval.shape))]


def _arg_extreme(lower: Lowering, equation: Equation, array: Array, compare: str) -> list[Array]:
    """Return the indices of the largest ("gt") or smallest ("lt") elements along an axis: the first
    of equal ones, or the first NaN if there is any."""
    aval, (axis,) = _nonempty(equation), equation.params["axes"]
    out, ops = aval_of(equation.outvars[0]), lower.ops
    if isinstance(array, InMemory):
        raise UnsupportedPrimitiveError(f"{equation.primitive.name} of large arrays")
    # One row along the axis for each element of the result.
    values = np.moveaxis(np.array(lower.values(array)).reshape(aval.shape), axis, -1)
    indices = []
    for row in values.reshape(-1, aval.shape[axis]).tolist():
        best, *others = (Symbol(ops, value) for value in row)
        index = Symbol(ops, ops.constant(kind_of(out), 0))
        for k, value in enumerate(others, 1):
            better = Symbol(ops, apply(ops, compare, value.value, best.value))
            if best.letter == "f":
                # The first NaN counts as the extreme.
                better = (better | value.is_nan()) & ~best.is_nan()
            best, index = better.select(value, best), better.select(index.like(k), index)
        indices.append(index.value)
    return [lower.array(indices, tuple(out.shape))]


def _dot_general(lower: Lowering, equation: Equation, first: Array, second: Array) -> list[Array]:
    # The axes along which products are summed, and those that number independent products.
    (left_axes, right_axes), (left_batch, right_batch) = equation.params["dimension_numbers"]
    if not all(aval_of(atom).size for atom in equation.invars):
        raise UnsupportedPrimitiveError("dot_general of no elements")
    if isinstance(first, InMemory) or isinstance(second, InMemory):
        return large_product(lower, equation, first, second)
    out = aval_of(equation.outvars[0])

    def rows(array: Array, number: int, batch: Sequence[int], along: Sequence[int]) -> list:
        """Return the elements of `array`, the operand with the index `number`, as nested lists with
        three axes: one for all axes `batch`, one for the other axes, and one for all `along`."""
        shape = aval_of(equation.invars[number]).shape
        # `preferred_element_type` may be wider than the arguments, which are converted first.
        elements = (Symbol(lower.ops, value) for value in lower.values(array))
        values = np.array([convert(x, kind_of(out)).value for x in elements]).reshape(shape)
        others = [k for k in range(len(shape)) if k not in (*batch, *along)]
        batch_size, length = (math.prod(shape[k] for k in axes) for axes in (batch, along))
        return values.transpose([*batch, *others, *along]).reshape(batch_size, -1, length).tolist()

    # Each element of the result is the inner product of a row of one array and a row of the other.
    add, multiply = (lower.operation(name, out) for name in ("add", "mul"))
    left_rows = rows(first, 0, left_batch, left_axes)
    right_rows = rows(second, 1, right_batch, right_axes)
    totals = [
        reduce(add, [multiply(x, y) for x, y in zip(a, b, strict=True)])
        for lefts, rights in zip(left_rows, right_rows, strict=True)
        for a in lefts
        for b in rights
    ]
    result = lower.array(totals, tuple(out.shape))
    # A large array is in memory, also if its factors are small.
    large = out.size > LARGEST_UNROLLED
    return [lower.in_memory(result, tuple(out.shape)) if large else result]


_REARRANGED: dict[str, Rearrange] = {
    "transpose": lambda indices, parameters: [indices.transpose(parameters["permutation"])],
    "rev": lambda indices, parameters: [np.flip(indices, parameters["dimensions"])],
    "tile": lambda indices, parameters: [np.tile(indices, parameters["reps"])],
    "split": lambda indices, parameters: np.split(
        indices, np.cumsum(parameters["sizes"])[:-1], parameters["axis"]
    ),
}
_JOINED: dict[str, Join] = {
    "concatenate": lambda indices, parameters: np.concatenate(indices, parameters["dimension"]),
    "stack": lambda indices, parameters: np.stack(indices, parameters["axis"]),
}
RULES: dict[str, EquationRule] = {
    "squeeze": _reshape,
    "reshape": _reshape,
    "expand_dims": _reshape,
    "slice": _slice,
    "unstack": _unstack,
    "broadcast_in_dim": _broadcast_in_dim,
    **{name: partial(_rearranged, rearrange=f) for name, f in _REARRANGED.items()},
    **{name: partial(_joined, join=join) for name, join in _JOINED.items()},
    "pad": _pad,
    "empty": _empty,
    "empty2": _empty,
    "iota": _iota,
    "reduce_sum": partial(_reduce, name="add"),
    "reduce_prod": partial(_reduce, name="mul"),
    **{f"reduce_{name}": partial(_reduce, name=name) for name in ("max", "min", "or", "and")},
    "cumsum": partial(_cumulate, name="add"),
    "cumprod": partial(_cumulate, name="mul"),
    **{f"cum{name}": partial(_cumulate, name=name) for name in ("max", "min")},
    "argmax": partial(_arg_extreme, compare="gt"),
    "argmin": partial(_arg_extreme, compare="lt"),
    "dot_general": _dot_general,
}
"""Rules by the names of primitives."""
