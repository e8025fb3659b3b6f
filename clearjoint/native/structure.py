"""Lower the primitives that rearrange elements: slices, reshapes, concatenations and others.

Each rule takes the lowering, the equation and its arguments, and returns the equation's results.
A rule applies the NumPy function of the same name to the flat indices of the elements; the result
says which element of the argument stands where.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jax.extend import core

from .lowering import (
    LARGEST_UNROLLED,
    Array,
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

Rearrange = Callable[[np.ndarray], np.ndarray]


def _rearranged(
    lower: Lowering, equation: core.JaxprEqn, array: Array, rearrange: Rearrange
) -> list[Array]:
    return [lower.take(array, rearrange(element_indices(aval_of(equation.invars[0]))))]


def _reshape(lower: Lowering, equation: core.JaxprEqn, array: Array, *_: Array) -> list[Array]:
    shape = tuple(aval_of(equation.outvars[0]).shape)
    if isinstance(array, InMemory):
        return [replace(array, shape=shape)]
    return [lower.array(lower.values(array), shape)]


def _slice(lower: Lowering, equation: core.JaxprEqn, array: Array) -> list[Array]:
    parameters = equation.params
    steps = parameters["strides"] or (1,) * len(parameters["start_indices"])
    rows = zip(parameters["start_indices"], parameters["limit_indices"], steps, strict=True)
    part = tuple(slice(*row) for row in rows)
    if isinstance(array, Packed) and aval_of(equation.outvars[0]).shape == (1,):
        # One element of a vector, without those of all other tangents.
        return [lower.array([lower.ops.element(array.value, part[0].start)], (1,))]
    return _rearranged(lower, equation, array, lambda indices: indices[part])


def _broadcast_in_dim(
    lower: Lowering, equation: core.JaxprEqn, array: Array, *_: Array
) -> list[Array]:
    shape, dimensions = equation.params["shape"], equation.params["broadcast_dimensions"]
    if isinstance(array, int) and lower.is_packed(tuple(shape)):
        return [Packed(lower.vector(array))]

    def rearrange(indices: np.ndarray) -> np.ndarray:
        expanded = [1] * len(shape)
        for axis, size in zip(dimensions, indices.shape, strict=True):
            expanded[axis] = size
        return np.broadcast_to(indices.reshape(expanded), shape)

    return _rearranged(lower, equation, array, rearrange)


def _transpose(lower: Lowering, equation: core.JaxprEqn, array: Array) -> list[Array]:
    order = equation.params["permutation"]
    return _rearranged(lower, equation, array, lambda indices: indices.transpose(order))


def _rev(lower: Lowering, equation: core.JaxprEqn, array: Array) -> list[Array]:
    axes = equation.params["dimensions"]
    return _rearranged(lower, equation, array, lambda indices: np.flip(indices, axes))


def _tile(lower: Lowering, equation: core.JaxprEqn, array: Array) -> list[Array]:
    reps = equation.params["reps"]
    return _rearranged(lower, equation, array, lambda indices: np.tile(indices, reps))


def _joined(
    lower: Lowering, equation: core.JaxprEqn, arrays: Sequence[Array], join: Callable
) -> list[Array]:
    """Join arrays as `join` joins the indices of their elements, counted through all arrays."""
    avals = [aval_of(v) for v in equation.invars]
    starts = np.cumsum([0, *(aval.size for aval in avals)]).tolist()
    rows = zip(avals, starts, strict=False)
    indices = join([element_indices(aval) + start for aval, start in rows])
    out = aval_of(equation.outvars[0])
    if indices.size <= LARGEST_UNROLLED:
        values = [value for array in arrays for value in lower.values(array)]
        return [lower.array([values[k] for k in indices.ravel()], indices.shape)]
    if not is_contiguous(indices.ravel()):
        raise UnsupportedPrimitiveError(f"{equation.primitive.name} of large arrays")
    memory = lower.new_array(tuple(out.shape), kind_of(out))
    for start, array in zip(starts, arrays, strict=False):
        lower.write(array, memory.start + start)
    return [memory]


def _concatenate(lower: Lowering, equation: core.JaxprEqn, *arrays: Array) -> list[Array]:
    axis = equation.params["dimension"]
    return _joined(lower, equation, arrays, lambda indices: np.concatenate(indices, axis))


def _stack(lower: Lowering, equation: core.JaxprEqn, *arrays: Array) -> list[Array]:
    axis = equation.params.get("axis", equation.params.get("dimension", 0))
    return _joined(lower, equation, arrays, lambda indices: np.stack(indices, axis))


def _pad(lower: Lowering, equation: core.JaxprEqn, array: Array, padding: Array) -> list[Array]:
    aval, out = aval_of(equation.invars[0]), aval_of(equation.outvars[0])
    if out.size > LARGEST_UNROLLED:
        raise UnsupportedPrimitiveError("pad of large arrays")
    # The padding is the element after the last one of the array.
    indices = np.full(out.shape, aval.size)
    targets, sources = [], []
    rows = zip(equation.params["padding_config"], aval.shape, out.shape, strict=True)
    for (low, _, between), length, padded in rows:
        target = low + np.arange(length) * (between + 1)
        # Negative padding cuts elements off.
        source = np.flatnonzero((target >= 0) & (target < padded))
        targets.append(target[source])
        sources.append(source)
    indices[np.ix_(*targets)] = element_indices(aval)[np.ix_(*sources)]
    values = [*lower.values(array), *lower.values(padding)]
    return [lower.array([values[k] for k in indices.ravel()], indices.shape)]


def _split(lower: Lowering, equation: core.JaxprEqn, array: Array) -> list[Array]:
    sizes, axis = equation.params["sizes"], equation.params["axis"]
    indices = element_indices(aval_of(equation.invars[0]))
    parts = np.split(indices, np.cumsum(sizes)[:-1], axis)
    return [lower.take(array, part) for part in parts]


def _unstack(lower: Lowering, equation: core.JaxprEqn, array: Array) -> list[Array]:
    indices = element_indices(aval_of(equation.invars[0]))
    parts = np.moveaxis(indices, equation.params.get("axis", 0), 0)
    return [lower.take(array, part) for part in parts]


def _iota(lower: Lowering, equation: core.JaxprEqn) -> list[Array]:
    aval = aval_of(equation.outvars[0])
    numbers = np.indices(aval.shape)[equation.params["dimension"]]
    return [lower.constant(numbers.astype(aval.dtype))]


RULES: dict[str, EquationRule] = {
    "squeeze": _reshape,
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
