"""Results that are kept for the same numbers: checking a run anew takes longer than a short run."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import wraps
from typing import ParamSpec, TypeVar

import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import PyTree

KEPT = 256
"""Results of each function that are kept, the latest used."""
Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def cached_by_numbers(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """The function, computed once for arguments of the same classes, static fields and numbers.

    For functions of PyTrees that do nothing beside returning a result that nobody changes, or
    raising an error, which is raised each time. Numbers that JAX traces are never looked up.
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
    """What makes a leaf another one: type, shape and bytes of an array, else the object itself."""
    if isinstance(leaf, np.ndarray | np.generic | jax.Array):
        array = np.asarray(leaf)
        return type(leaf), array.shape, array.dtype, array.tobytes()
    return type(leaf), leaf
