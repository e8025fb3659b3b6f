"""Lower the JAX primitives that combine elements to operations on scalars: sums, products and
extremes (over axes or cumulative), positions of extremes, and `dot_general`.

Each rule takes the lowering, the equation and its arguments, and returns the equation's results.
"""

import math
from collections.abc import Callable, Sequence
from functools import partial, reduce

import numpy as np
from jax.core import ShapedArray
from jax.extend import core

from .elementwise import RULES as ELEMENTWISE
from .lowering import (
    Array,
    EquationRule,
    InMemory,
    Lowering,
    UnsupportedPrimitiveError,
    aval_of,
    kind_of,
)
from .operations import Value

Combine = Callable[[Value, Value], Value]


def _combine(lower: Lowering, kind: str, name: str) -> Combine:
    """Return a function that adds the elementwise operation `name` on two values of a kind."""
    return lambda a, b: ELEMENTWISE[name](lower.ops, kind, {}, a, b)


def _nonempty(equation: core.JaxprEqn) -> ShapedArray:
    aval = aval_of(equation.invars[0])
    if not aval.size:
        raise UnsupportedPrimitiveError(f"{equation.primitive.name} of no elements")
    return aval


def _reduce(lower: Lowering, equation: core.JaxprEqn, array: Array, name: str) -> list[Array]:
    aval, axes = _nonempty(equation), tuple(equation.params["axes"])
    out, combine = aval_of(equation.outvars[0]), _combine(lower, kind_of(aval), name)
    if isinstance(array, InMemory):
        if out.shape != ():
            raise UnsupportedPrimitiveError(f"{equation.primitive.name} along some axes")
        return [_cumulate_memory(lower, array, combine)[-1]]
    values = np.array(lower.values(array)).reshape(aval.shape)
    others = [k for k in range(values.ndim) if k not in axes]
    rows = values.transpose([*others, *axes]).reshape(out.size, -1)
    # A sum one by one can absorb a product at each addition (a fused multiply-add); for all other
    # operations a tree has the shorter chain of dependent instructions.
    fold = partial(reduce, combine) if name in ("add", "mul") else partial(_by_halves, combine)
    return [lower.array([fold(row) for row in rows.tolist()], tuple(out.shape))]


def _by_halves(combine: Combine, row: list[Value]) -> Value:
    if len(row) == 1:
        return row[0]
    middle = len(row) // 2
    return combine(_by_halves(combine, row[:middle]), _by_halves(combine, row[middle:]))


def _cumulate_memory(
    lower: Lowering, array: InMemory, combine: Combine, out: InMemory | None = None
) -> list[Value]:
    """Add a loop that combines all elements of an array in memory, and writes each intermediate
    result to `out` if given; return the carries after the loop: an index, and the total."""
    ops = lower.ops
    first = ops.load(array.kind, array.start)
    if out is not None:
        ops.store(first, out.start)
    end = ops.constant("i", array.size)

    def body(carries: list[Value]) -> list[Value]:
        k, total = carries
        total = combine(total, ops.load(array.kind, array.start, k))
        if out is not None:
            ops.store(total, out.start, k)
        return [ops.emit("add", "i", k, ops.constant("i", 1)), total]

    start = [ops.constant("i", 1), first]
    return ops.loop(start, lambda carries: ops.emit("ilt", "b", carries[0], end), body)


def _cumulate(lower: Lowering, equation: core.JaxprEqn, array: Array, name: str) -> list[Array]:
    aval = aval_of(equation.invars[0])
    combine = _combine(lower, kind_of(aval), name)
    axis, reverse = equation.params["axis"], equation.params["reverse"]
    if isinstance(array, InMemory):
        if len(aval.shape) != 1 or reverse:
            raise UnsupportedPrimitiveError(f"{equation.primitive.name} of several axes")
        out = lower.new_array(array.shape, array.kind)
        _cumulate_memory(lower, array, combine, out)
        return [out]
    values = np.array(lower.values(array), dtype=np.int64).reshape(aval.shape)
    # A view of `values`, in which the rows are replaced one after the other.
    rows = np.moveaxis(values, axis, 0)
    rows = rows[::-1] if reverse else rows
    for k in range(1, len(rows)):
        for position in np.ndindex(*rows.shape[1:]):
            before, value = rows[(k - 1, *position)], rows[(k, *position)]
            rows[(k, *position)] = combine(int(before), int(value))
    return [lower.array(values.ravel().tolist(), tuple(aval.shape))]


def _arg_extreme(
    lower: Lowering, equation: core.JaxprEqn, array: Array, compare: str
) -> list[Array]:
    aval, (axis,) = _nonempty(equation), equation.params["axes"]
    out, ops = aval_of(equation.outvars[0]), lower.ops
    kind, index_kind = kind_of(aval), kind_of(out)
    if isinstance(array, InMemory):
        raise UnsupportedPrimitiveError(f"{equation.primitive.name} of large arrays")
    values = np.moveaxis(np.array(lower.values(array)).reshape(aval.shape), axis, -1)
    indices = []
    for row in values.reshape(-1, aval.shape[axis]).tolist():
        best, index = row[0], ops.constant(index_kind, 0)
        for k, value in enumerate(row[1:], 1):
            better = ELEMENTWISE[compare](ops, "b", {}, value, best)
            if kind == "f":
                # The first NaN counts as the extreme.
                is_nan = ops.emit("is_nan_either", "b", value, value)
                better = ops.emit("or", "b", better, is_nan)
                best_is_nan = ops.emit("is_nan_either", "b", best, best)
                better = ops.emit("and", "b", better, ops.emit("not", "b", best_is_nan))
            best = ops.emit("select", kind, better, value, best)
            index = ops.emit("select", index_kind, better, ops.constant(index_kind, k), index)
        indices.append(index)
    return [lower.array(indices, tuple(out.shape))]


def _dot_general(
    lower: Lowering, equation: core.JaxprEqn, first: Array, second: Array
) -> list[Array]:
    (left, right), (left_batch, right_batch) = equation.params["dimension_numbers"]
    if isinstance(first, InMemory) or isinstance(second, InMemory):
        raise UnsupportedPrimitiveError("dot_general of large arrays")
    out = aval_of(equation.outvars[0])

    def rows(array: Array, number: int, batch: Sequence[int], along: Sequence[int]) -> list:
        """The elements in the shape (batch, rows, summed elements)."""
        shape = aval_of(equation.invars[number]).shape
        values = np.array(lower.values(array)).reshape(shape)
        others = [k for k in range(len(shape)) if k not in (*batch, *along)]
        count, length = (math.prod(shape[k] for k in axes) for axes in (batch, along))
        return values.transpose([*batch, *others, *along]).reshape(count, -1, length).tolist()

    add, multiply = (_combine(lower, kind_of(out), name) for name in ("add", "mul"))
    left_rows, right_rows = rows(first, 0, left_batch, left), rows(second, 1, right_batch, right)
    totals = [
        reduce(add, [multiply(x, y) for x, y in zip(a, b, strict=True)])
        for lefts, rights in zip(left_rows, right_rows, strict=True)
        for a in lefts
        for b in rights
    ]
    return [lower.array(totals, tuple(out.shape))]


RULES: dict[str, EquationRule] = {
    "reduce_sum": partial(_reduce, name="add"),
    "reduce_prod": partial(_reduce, name="mul"),
    "reduce_max": partial(_reduce, name="max"),
    "reduce_min": partial(_reduce, name="min"),
    "reduce_or": partial(_reduce, name="or"),
    "reduce_and": partial(_reduce, name="and"),
    "cumsum": partial(_cumulate, name="add"),
    "cumprod": partial(_cumulate, name="mul"),
    "cummax": partial(_cumulate, name="max"),
    "cummin": partial(_cumulate, name="min"),
    "argmax": partial(_arg_extreme, compare="gt"),
    "argmin": partial(_arg_extreme, compare="lt"),
    "dot_general": _dot_general,
}
"""Rules by the names of primitives."""
