"""Functions that JAX compiles at their first call.

Tracing makes a hundred thousand objects that stay, and Python's collector of garbage walks through
all of them again and again and finds none: a third of the time. So it rests during a call, which
leaves Python alone for the rest of its time anyway.
"""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial, update_wrapper
from typing import Generic, Literal, ParamSpec, TypeVar

import equinox as eqx
import jax
from jaxtyping import PyTree

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
Donated = Literal["all", "all-except-first", "warn", "warn-except-first", "none"]
"""Arguments whose memory the result may take, as of `equinox.filter_jit`."""


class Compiled(Generic[Arguments, Result]):
    """A function as `equinox.filter_jit` compiles it: numbers that are arrays may change, whatever
    else changes compiles anew."""

    __wrapped__: Callable[Arguments, Result]

    def __init__(self, function: Callable[Arguments, Result], donate: Donated = "none"):
        self._compiled = eqx.filter_jit(function, donate=donate)
        update_wrapper(self, function)

    def __call__(self, *arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        """The function's result."""
        with _collector_at_rest():
            return self._compiled(*arguments, **options)

    def program(self, *arguments: Arguments.args, **options: Arguments.kwargs) -> str:
        """The program for such arguments, as XLA has optimised it."""
        return self._compiled.lower(*arguments, **options).compile().compiled.as_text()

    def programs(self) -> int:
        """How many programs have been compiled."""
        return self._compiled._cached._cache_size()


def traced_once(function: Callable[..., Result]) -> Callable[..., Result]:
    """The function of PyTrees, traced at its first call and not again for arguments alike.

    What was traced goes with what is returned here, unlike that of `equinox.filter_jit`, which is
    kept for the next run too, when a global that the function reads may have changed.
    """

    @partial(jax.jit, static_argnums=1)
    def traced(arrays: tuple[PyTree, ...], others: tuple[tuple[PyTree, ...], PyTree]) -> Result:
        leaves, structure = others
        mixed = [a if other is None else other for a, other in zip(arrays, leaves, strict=True)]
        arguments = jax.tree.unflatten(structure, mixed)
        return function(*arguments)

    def call(*arguments: PyTree) -> Result:
        leaves, structure = jax.tree.flatten(arguments)
        arrays = tuple(leaf if eqx.is_array(leaf) else None for leaf in leaves)
        others = tuple(None if eqx.is_array(leaf) else leaf for leaf in leaves)
        return traced(arrays, (others, structure))

    return call


@contextmanager
def _collector_at_rest() -> Iterator[None]:
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
