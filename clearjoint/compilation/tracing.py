"""Tracing of functions by JAX, and the time for which a program has been compiling.

Python's garbage collector is off while JAX traces. Tracing makes a hundred thousand objects that
stay in use. The collector would visit them repeatedly and free nothing, which would take a third of
the time.

A program counts as being compiled from the first traced line until its call returns. The call
returns once the program has been started; the program itself then runs on the device.
"""

import gc
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache, partial, wraps
from typing import ParamSpec, TypeVar

import equinox as eqx
import jax
from jax.extend.core import ClosedJaxpr, get_opaque_trace_state
from jax.interpreters import partial_eval
from jaxtyping import PyTree

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
_began: dict[int, float] = {}
"""Time at which each thread, by its identifier, began to compile a program, in s of
`time.monotonic`."""
CALLS = {
    "jit": "jaxpr",
    "pjit": "jaxpr",
    "closed_call": "call_jaxpr",
    "core_call": "call_jaxpr",
    "eval_jaxpr": "call_jaxpr",
    "checkpoint": "jaxpr",
    "remat2": "jaxpr",
    "custom_jvp_call": "call_jaxpr",
    "custom_vjp_call": "call_jaxpr",
    "custom_vjp_call_jaxpr": "fun_jaxpr",
}
"""Primitives that only call a jaxpr, each with the name of its parameter that holds this jaxpr."""


def traced_once(function: Callable[..., Result]) -> Callable[..., Result]:
    """Wrap a function of PyTrees so that JAX traces it once for arguments of the same structure.

    A function that is called several times within a program, such as the rates in the stages of a
    step, would otherwise be traced at each call. Leaves that are not arrays must be hashable; the
    function is traced again for other values of them. The jaxpr is discarded with the wrapper.
    `equinox.filter_jit` would keep it for the next run, in which a global variable that the
    function reads may have changed.
    """

    # Only arrays are traced; other leaves are static, so that the function can branch on them.
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
    """Return the jaxpr of a function for given arguments, and the shapes and dtypes of its result.

    The latter are a PyTree with the structure of the result.

    In JAX 0.12 some operations, such as `jax.numpy.searchsorted`, are a single equation until JAX
    lowers the jaxpr. Here they are expanded to the equations of which they consist.
    """
    program, shapes = jax.make_jaxpr(function, return_shape=True)(*arguments)
    if hasattr(partial_eval, "lower_jaxpr2"):  # From JAX 0.11 on.
        program = partial_eval.lower_jaxpr2(program)  # pyright: ignore[reportAttributeAccessIssue]
    return program, shapes


@contextmanager
def collector_at_rest() -> Iterator[None]:
    """Switch off Python's garbage collector within the context, unless it is off already."""
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def is_tracing() -> bool:
    """Return whether JAX is tracing a function in this thread, as inside of `jax.jit`."""
    return get_opaque_trace_state() != _state_without_trace()


@cache
def _state_without_trace() -> object:
    # A new thread traces nothing, even if the caller is being traced.
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(get_opaque_trace_state).result()


def seconds_of_compiling() -> float:
    """Return for how long a program has been traced and compiled, s; zero if no thread is doing so.

    Progress bars show this time. If several threads compile programs, the longest time is returned.
    """
    times = list(_began.values())
    return time.monotonic() - min(times) if times else 0.0


def begins_a_program(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Wrap a function that JAX traces, so that the time of compiling begins when it is called.

    JAX calls the function only to trace it: a call of a program that exists starts no time.
    """

    @wraps(function)
    def traced(*arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        _began.setdefault(threading.get_ident(), time.monotonic())
        return function(*arguments, **options)

    return traced


@contextmanager
def program_is_made_inside() -> Iterator[None]:
    """End the time of compiling, which a wrapper of `begins_a_program` began, with the context.

    If contexts are nested, the time ends with the outermost one.
    """
    thread = threading.get_ident()
    is_inner = thread in _began
    try:
        yield
    finally:
        if not is_inner:
            _began.pop(thread, None)
