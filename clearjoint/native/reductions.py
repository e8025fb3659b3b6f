"""Primitives that join elements: sums, extremes and products; rules as in `.structure`."""

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


def _filled(equation: core.JaxprEqn) -> ShapedArray:
    """The shape and dtype of what is reduced, which must have elements."""
    aval = aval_of(equation.invars[0])
    if not aval.size:
        raise UnsupportedPrimitiveError(f"{equation.primitive.name} of no elements")
    return aval


def _reduced(lower: Lowering, equation: core.JaxprEqn, array: Array, name: str) -> list[Array]:
    aval, axes = _filled(equation), tuple(equation.params["axes"])
    kind, out = kind_of(aval), aval_of(equation.outvars[0])

    def join(a: Value, b: Value) -> Value:
        return ELEMENTWISE[name](lower.do, kind, {}, a, b)

    if isinstance(array, InMemory):
        if out.shape != ():
            raise UnsupportedPrimitiveError(f"{equation.primitive.name} along some axes")
        return [_scan_memory(lower, array, join)[-1]]
    values = np.array(lower.values(array)).reshape(aval.shape)
    rest = [k for k in range(values.ndim) if k not in axes]
    rows = values.transpose([*rest, *axes]).reshape(int(np.prod(out.shape, dtype=int)), -1)
    found = []
    for row in rows.tolist():
        # Sums take in products one by one; of all else the halves are joined side by side.
        found.append(reduce(join, row) if name in ("add", "mul") else _joined_by_halves(join, row))
    return [lower.array(found, tuple(out.shape))]


def _joined_by_halves(join: Callable[[Value, Value], Value], row: list[Value]) -> Value:
    if len(row) == 1:
        return row[0]
    middle = len(row) // 2
    return join(_joined_by_halves(join, row[:middle]), _joined_by_halves(join, row[middle:]))


def _scan_memory(
    lower: Lowering,
    array: InMemory,
    join: Callable[[Value, Value], Value],
    out: InMemory | None = None,
) -> list[Value]:
    """Elements joined one after the other, each total stored if there is an array for them;
    the last index and total."""
    do = lower.do
    first = do.load(array.kind, array.start)
    if out is not None:
        do.store(first, out.start)
    end = do.constant("i", array.size)

    def body(carries: list[Value]) -> list[Value]:
        k, total = carries
        total = join(total, do.load(array.kind, array.start, k))
        if out is not None:
            do.store(total, out.start, k)
        return [do.do("add", "i", k, do.constant("i", 1)), total]

    start = [do.constant("i", 1), first]
    return do.loop(start, lambda carries: do.do("ilt", "b", carries[0], end), body)


def _cumulated(lower: Lowering, equation: core.JaxprEqn, array: Array, name: str) -> list[Array]:
    aval, kind = aval_of(equation.invars[0]), kind_of(aval_of(equation.invars[0]))
    axis, reverse = equation.params["axis"], equation.params["reverse"]

    def join(a: Value, b: Value) -> Value:
        return ELEMENTWISE[name](lower.do, kind, {}, a, b)

    if isinstance(array, InMemory):
        if len(aval.shape) != 1 or reverse:
            raise UnsupportedPrimitiveError(f"{equation.primitive.name} of several axes")
        out = InMemory(lower.do.allocate(array.size), array.shape, kind, True)
        _scan_memory(lower, array, join, out)
        return [out]
    values = np.array(lower.values(array), dtype=np.int64).reshape(aval.shape)
    rows = np.moveaxis(values, axis, 0)
    rows = rows[::-1] if reverse else rows
    for k in range(1, len(rows)):
        for place in np.ndindex(*rows.shape[1:]):
            before, here = rows[(k - 1, *place)], rows[(k, *place)]
            rows[(k, *place)] = join(int(before), int(here))
    return [lower.array(values.ravel().tolist(), tuple(aval.shape))]


def _extreme_place(
    lower: Lowering, equation: core.JaxprEqn, array: Array, compare: str
) -> list[Array]:
    aval, (axis,) = _filled(equation), equation.params["axes"]
    out, do = aval_of(equation.outvars[0]), lower.do
    if isinstance(array, InMemory):
        raise UnsupportedPrimitiveError(f"{equation.primitive.name} of large arrays")
    values = np.moveaxis(np.array(lower.values(array)).reshape(aval.shape), axis, -1)
    found = []
    for row in values.reshape(-1, aval.shape[axis]).tolist():
        best, place = row[0], do.constant(kind_of(out), 0)
        for k, value in enumerate(row[1:], 1):
            better = ELEMENTWISE[compare](do, "b", {}, value, best)
            if kind_of(aval) == "f":
                is_nan = do.do("is_nan_either", "b", value, value)
                better = do.do("or", "b", better, is_nan)
                known = do.do("is_nan_either", "b", best, best)
                better = do.do("and", "b", better, do.do("not", "b", known))
            best = do.do("select", kind_of(aval), better, value, best)
            place = do.do("select", kind_of(out), better, do.constant(kind_of(out), k), place)
        found.append(place)
    return [lower.array(found, tuple(out.shape))]


def _dot_general(
    lower: Lowering, equation: core.JaxprEqn, first: Array, second: Array
) -> list[Array]:
    (left, right), (left_batch, right_batch) = equation.params["dimension_numbers"]
    if isinstance(first, InMemory) or isinstance(second, InMemory):
        raise UnsupportedPrimitiveError("dot_general of large arrays")
    out = aval_of(equation.outvars[0])
    kind = kind_of(out)

    def rows(array: Array, number: int, batch: Sequence[int], along: Sequence[int]) -> list:
        shape = aval_of(equation.invars[number]).shape
        values = np.array(lower.values(array)).reshape(shape)
        rest = [k for k in range(len(shape)) if k not in (*batch, *along)]
        count = int(np.prod([shape[k] for k in batch], dtype=int))
        length = int(np.prod([shape[k] for k in along], dtype=int))
        return values.transpose([*batch, *rest, *along]).reshape(count, -1, length).tolist()

    add, multiply = ELEMENTWISE["add"], ELEMENTWISE["mul"]
    found = []
    left_rows, right_rows = (
        rows(first, 0, left_batch, left),
        rows(second, 1, right_batch, right),
    )
    for lefts, rights in zip(left_rows, right_rows, strict=True):
        for a in lefts:
            for b in rights:
                terms = [multiply(lower.do, kind, {}, x, y) for x, y in zip(a, b, strict=True)]
                total = terms[0]
                for term in terms[1:]:
                    total = add(lower.do, kind, {}, total, term)
                found.append(total)
    return [lower.array(found, tuple(out.shape))]


RULES: dict[str, EquationRule] = {
    "reduce_sum": partial(_reduced, name="add"),
    "reduce_prod": partial(_reduced, name="mul"),
    "reduce_max": partial(_reduced, name="max"),
    "reduce_min": partial(_reduced, name="min"),
    "reduce_or": partial(_reduced, name="or"),
    "reduce_and": partial(_reduced, name="and"),
    "cumsum": partial(_cumulated, name="add"),
    "cumprod": partial(_cumulated, name="mul"),
    "cummax": partial(_cumulated, name="max"),
    "cummin": partial(_cumulated, name="min"),
    "argmax": partial(_extreme_place, compare="gt"),
    "argmin": partial(_extreme_place, compare="lt"),
    "dot_general": _dot_general,
}
"""Rules by the names of primitives."""
