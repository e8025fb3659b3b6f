"""Primitives that move elements: slices, reshapes, concatenations and their like.

Each rule takes the lowering, the equation and its arguments, and gives the equation's results.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jax.extend import core

from .lowering import (
    LARGEST_TAKEN_APART,
    Array,
    EquationRule,
    InMemory,
    Lowering,
    Packed,
    UnsupportedPrimitiveError,
    aval_of,
    kind_of,
)


def _structure(
    lower: Lowering, equation: core.JaxprEqn, array: Array, move: Callable
) -> list[Array]:
    aval = aval_of(equation.invars[0])
    size = int(np.prod(aval.shape, dtype=int))
    return [lower.moved(equation, array, move(np.arange(size).reshape(aval.shape)))]


def _squeeze(lower: Lowering, equation: core.JaxprEqn, array: Array) -> list[Array]:
    shape = aval_of(equation.outvars[0]).shape
    if isinstance(array, int):
        return [array]
    if isinstance(array, np.ndarray) and array.size == 1 and shape == ():
        return [int(array.ravel()[0])]
    return _structure(lower, equation, array, lambda places: places)


def _reshape(lower: Lowering, equation: core.JaxprEqn, array: Array, *_: Array) -> list[Array]:
    return _structure(lower, equation, array, lambda places: places)


def _slice(lower: Lowering, equation: core.JaxprEqn, array: Array) -> list[Array]:
    parameters = equation.params
    steps = parameters["strides"] or (1,) * len(parameters["start_indices"])
    rows = zip(parameters["start_indices"], parameters["limit_indices"], steps, strict=True)
    at = tuple(slice(*row) for row in rows)
    if isinstance(array, Packed) and aval_of(equation.outvars[0]).shape == (1,):
        element = lower.do.element(array.value, at[0].start)
        return [lower.array([element], (1,))]
    return _structure(lower, equation, array, lambda places: places[at])


def _broadcast_in_dim(
    lower: Lowering, equation: core.JaxprEqn, array: Array, *_: Array
) -> list[Array]:
    shape, dimensions = equation.params["shape"], equation.params["broadcast_dimensions"]
    if isinstance(array, int) and lower.is_packed(tuple(shape)):
        return [Packed(lower.vector(array))]

    def move(places: np.ndarray) -> np.ndarray:
        own = [1] * len(shape)
        for axis, size in zip(dimensions, places.shape, strict=True):
            own[axis] = size
        return np.broadcast_to(places.reshape(own), shape)

    return _structure(lower, equation, array, move)


def _transpose(lower: Lowering, equation: core.JaxprEqn, array: Array) -> list[Array]:
    order = equation.params["permutation"]
    return _structure(lower, equation, array, lambda places: places.transpose(order))


def _rev(lower: Lowering, equation: core.JaxprEqn, array: Array) -> list[Array]:
    axes = equation.params["dimensions"]
    return _structure(lower, equation, array, lambda places: np.flip(places, axes))


def _tile(lower: Lowering, equation: core.JaxprEqn, array: Array) -> list[Array]:
    reps = equation.params["reps"]
    return _structure(lower, equation, array, lambda places: np.tile(places, reps))


def _joined(
    lower: Lowering, equation: core.JaxprEqn, arrays: Sequence[Array], join: Callable
) -> list[Array]:
    """One array of several ones'."""
    sizes = [int(np.prod(aval_of(v).shape, dtype=int)) for v in equation.invars]
    starts = np.cumsum([0, *sizes])
    places = join(
        [
            np.arange(start, start + size).reshape(aval_of(v).shape)
            for start, size, v in zip(starts, sizes, equation.invars, strict=False)
        ]
    )
    shape = tuple(aval_of(equation.outvars[0]).shape)
    if places.size <= LARGEST_TAKEN_APART:
        values = [value for array in arrays for value in lower.values(array)]
        return [lower.array([values[k] for k in places.ravel()], shape)]
    if not np.array_equal(places.ravel(), np.arange(starts[-1])):
        raise UnsupportedPrimitiveError(f"{equation.primitive.name} of large arrays")
    out = InMemory(
        lower.do.allocate(places.size), shape, kind_of(aval_of(equation.outvars[0])), True
    )
    for start, array in zip(starts, arrays, strict=False):
        if isinstance(array, InMemory):
            lower.copied(array, out.start + int(start))
        else:
            for k, value in enumerate(lower.values(array)):
                lower.do.store(value, out.start + int(start) + k)
    return [out]


def _concatenate(lower: Lowering, equation: core.JaxprEqn, *arrays: Array) -> list[Array]:
    axis = equation.params["dimension"]
    return _joined(lower, equation, arrays, lambda places: np.concatenate(places, axis))


def _stack(lower: Lowering, equation: core.JaxprEqn, *arrays: Array) -> list[Array]:
    axis = equation.params.get("axis", equation.params.get("dimension", 0))
    return _joined(lower, equation, arrays, lambda places: np.stack(places, axis))


def _pad(lower: Lowering, equation: core.JaxprEqn, array: Array, padding: Array) -> list[Array]:
    aval, out = aval_of(equation.invars[0]), aval_of(equation.outvars[0])
    size = int(np.prod(aval.shape, dtype=int))
    places = np.full(out.shape, size)
    targets, sources = [], []
    rows = zip(equation.params["padding_config"], aval.shape, out.shape, strict=True)
    for (low, _, inside), length, padded in rows:
        target = low + np.arange(length) * (inside + 1)
        source = np.flatnonzero((target >= 0) & (target < padded))
        targets.append(target[source])
        sources.append(source)
    places[np.ix_(*targets)] = np.arange(size).reshape(aval.shape)[np.ix_(*sources)]
    if places.size > LARGEST_TAKEN_APART:
        raise UnsupportedPrimitiveError("pad of large arrays")
    values = [*lower.values(array), *lower.values(padding)]
    return [lower.array([values[k] for k in places.ravel()], places.shape)]


def _split(lower: Lowering, equation: core.JaxprEqn, array: Array) -> list[Array]:
    sizes, axis = equation.params["sizes"], equation.params["axis"]
    aval = aval_of(equation.invars[0])
    places = np.arange(aval.size).reshape(aval.shape)
    parts = np.split(places, np.cumsum(sizes)[:-1], axis)
    return [lower.at_places(array, part) for part in parts]


def _unstack(lower: Lowering, equation: core.JaxprEqn, array: Array) -> list[Array]:
    aval, axis = aval_of(equation.invars[0]), equation.params.get("axis", 0)
    places = np.arange(aval.size).reshape(aval.shape)
    return [lower.at_places(array, part) for part in np.moveaxis(places, axis, 0)]


def _iota(lower: Lowering, equation: core.JaxprEqn) -> list[Array]:
    aval, axis = aval_of(equation.outvars[0]), equation.params["dimension"]
    own = np.arange(aval.shape[axis]).reshape(
        [-1 if k == axis else 1 for k in range(len(aval.shape))]
    )
    return [lower.constant(np.broadcast_to(own, aval.shape).astype(aval.dtype))]


RULES: dict[str, EquationRule] = {
    "squeeze": _squeeze,
    "reshape": _reshape,
    "expand_dims": _reshape,
    "slice": _slice,
    "broadcast_in_dim": _broadcast_in_dim,
    "transpose": _transpose,
    "rev": _rev,
    "tile": _tile,
    "concatenate": _concatenate,
    "stack": _stack,
    "pad": _pad,
    "split": _split,
    "unstack": _unstack,
    "iota": _iota,
}
"""Rules by the names of primitives."""
