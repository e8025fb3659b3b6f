"""Cache of function results, with the numbers in PyTrees as keys, for the checks before a run."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import wraps
from typing import ParamSpec, TypeVar

import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import PyTree

KEPT = 256
"""Largest number of results of a function; beyond it, the least recently used is removed."""
Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def cached_by_numbers(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Return a function of PyTrees with a cache for its results.

    A result is used again for arguments of the same classes, static fields and numbers. Leaves
    other than arrays must be hashable. The function must have no side effects, and callers must not
    change its results. Neither errors nor results for traced numbers are cached.
    """
    results: OrderedDict[Hashable, Result] = OrderedDict()

    @wraps(function)
    def cached(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        leaves, structure = jax.tree.flatten((args, kwargs))
        # Traced numbers have no values that could be compared.
        if any(isinstance(leaf, Tracer) for leaf in leaves):
            return function(*args, **kwargs)
        key = structure, tuple(map(content, leaves))
        # A result that is used again moves to the end, so that the first one is always the next to
        # be removed. The move is one `pop` and one assignment, since other threads use the cache
        # too and may remove the result at any time.
        try:
            result = results.pop(key)
        except KeyError:
            result = function(*args, **kwargs)
        results[key] = result
        if len(results) > KEPT:
            results.popitem(last=False)
        return result

    return cached


def content(leaf: PyTree) -> Hashable:
    """Return a hashable key for a leaf of a PyTree, which is an array or itself hashable."""
    if isinstance(leaf, np.ndarray | np.generic | jax.Array):
        array = np.asarray(leaf)
        return type(leaf), array.shape, array.dtype, array.tobytes()
    return type(leaf), leaf
