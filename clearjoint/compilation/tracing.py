"""Tracing: functions traced once, and Python's collector of garbage at rest meanwhile.

Tracing makes a hundred thousand objects that stay, and the collector walks through all of them
again and again and finds none: a third of the time.
"""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import TypeVar

import equinox as eqx
import jax
from jax._src import core
from jax.extend.core import ClosedJaxpr
from jax.interpreters import partial_eval
from jaxtyping import PyTree

Result = TypeVar("Result")


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


def program_of(function: Callable[..., PyTree], *arguments: PyTree) -> tuple[ClosedJaxpr, PyTree]:
    """The program that JAX traces of a function, and the shapes of its result.

    In JAX 0.12 some operations, such as `jax.numpy.searchsorted`, stand as one equation without an
    inner program until JAX lowers it: here as what they consist of.
    """
    program, shapes = jax.make_jaxpr(function, return_shape=True)(*arguments)
    if hasattr(partial_eval, "lower_jaxpr2"):  # From JAX 0.11 on.
        program = partial_eval.lower_jaxpr2(program)
    return program, shapes


@contextmanager
def collector_at_rest() -> Iterator[None]:
    """Inside, no garbage is collected."""
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def is_tracing() -> bool:
    """Whether JAX traces a function in this thread. JAX has no public name for this."""
    return not core.trace_state_clean()
