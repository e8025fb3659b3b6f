"""Functions that JAX compiles at their first call.

Tracing makes a hundred thousand objects that stay, and Python's collector of garbage walks through
all of them again and again and finds none: a third of the time. So it rests during a call, which
leaves Python alone for the rest of its time anyway.

From the first line that is traced until the call returns, a program is being made; its run goes on
behind, on the device. `seconds_of_compiling` says how long that takes already.
"""

import gc
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial, update_wrapper, wraps
from typing import Generic, Literal, ParamSpec, TypeVar

import equinox as eqx
import jax
from jaxtyping import PyTree

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
Donated = Literal["all", "all-except-first", "warn", "warn-except-first", "none"]
"""Arguments whose memory the result may take, as of `equinox.filter_jit`."""
_begun: dict[int, float] = {}
"""When the program that a thread makes was begun, s of `time.monotonic`, by thread."""


class Compiled(Generic[Arguments, Result]):
    """A function as `equinox.filter_jit` compiles it: numbers that are arrays may change, whatever
    else changes compiles anew."""

    __wrapped__: Callable[Arguments, Result]

    def __init__(self, function: Callable[Arguments, Result], donate: Donated = "none"):
        self._compiled = eqx.filter_jit(_begins_a_program(function), donate=donate)
        update_wrapper(self, function)

    def __call__(self, *arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        """The function's result."""
        with _collector_at_rest(), _program_is_made_inside():
            return self._compiled(*arguments, **options)

    def program(self, *arguments: Arguments.args, **options: Arguments.kwargs) -> str:
        """The program for such arguments, as XLA has optimised it."""
        with _program_is_made_inside():
            return self._compiled.lower(*arguments, **options).compile().compiled.as_text()

    def programs(self) -> int:
        """How many programs have been compiled."""
        return self._compiled._cached._cache_size()


def seconds_of_compiling() -> float:
    """For how long the program that is being made has been traced and compiled, in any thread; zero
    if none is."""
    begun = list(_begun.values())
    return time.monotonic() - min(begun) if begun else 0.0


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


def _begins_a_program(
    function: Callable[Arguments, Result],
) -> Callable[Arguments, Result]:
    """The function, which is called when it is traced and then only."""

    @wraps(function)
    def traced(*arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        _begun.setdefault(threading.get_ident(), time.monotonic())
        return function(*arguments, **options)

    return traced


@contextmanager
def _program_is_made_inside() -> Iterator[None]:
    """A call that may make a program, unless it is part of one that is being made."""
    thread = threading.get_ident()
    part = thread in _begun
    try:
        yield
    finally:
        if not part:
            _begun.pop(thread, None)


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
