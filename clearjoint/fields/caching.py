"""Cache of function results by the numbers in PyTrees, since the checks of a run take longer than a
short run."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import wraps
from typing import ParamSpec, TypeVar

import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import PyTree

KEPT = 256
"""Number of results that are cached for each function; the least recently used one is removed."""
Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def cached_by_numbers(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Wrap a function of PyTrees so that its results are cached by classes, static fields and
    numbers of the arguments.

    The function must have no side effects, and callers must not change its results. Neither errors
    nor results for traced numbers are cached.
    """
    results: OrderedDict[Hashable, Result] = OrderedDict()

    @wraps(function)
    def cached(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        leaves, structure = jax.tree.flatten((args, kwargs))
        if any(isinstance(leaf, Tracer) for leaf in leaves):
            return function(*args, **kwargs)
        key = structure, tuple(map(content, leaves))
        if key not in results:
            results[key] = function(*args, **kwargs)
            if len(results) > KEPT:
                results.popitem(last=False)
        results.move_to_end(key)
        return results[key]

    return cached


def content(leaf: PyTree) -> Hashable:
    """Return a hashable key for a leaf: type, shape, dtype and bytes of an array; type and value of
    any other object."""
    if isinstance(leaf, np.ndarray | np.generic | jax.Array):
        array = np.asarray(leaf)
        return type(leaf), array.shape, array.dtype, array.tobytes()
    return type(leaf), leaf
