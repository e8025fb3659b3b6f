"""Functions that are compiled to native code on CPUs, and by XLA elsewhere."""

import os
import warnings
from collections.abc import Callable
from functools import update_wrapper
from typing import Generic, ParamSpec, TypeVar, cast

import jax
import jax.numpy as jnp
from jax.lax import dynamic_index_in_dim, dynamic_update_index_in_dim
from jaxtyping import PyTree
from numpy.typing import ArrayLike

from .._compilation.xla import Compiled, is_tracing, traced_once
from .functions import FlatArguments, NativeFunction, flattened
from .lowering import UnsupportedPrimitiveError
from .machine_code import RecentPrograms

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
T = TypeVar("T")
SWITCH = "CLEARJOINT_NATIVE"
"""Environment variable: with the value 0, XLA compiles everything."""
_reported: set[str] = set()
"""Reasons of the warnings that were issued."""


class NativeFallbackWarning(UserWarning):
    """Warning that XLA compiles a program, which takes longer; results are correct."""


class Native(Generic[Arguments, Result]):
    """A function that is compiled when it is first called, on CPUs to native code.

    XLA compiles the function instead

    - on accelerators, or if the environment variable `CLEARJOINT_NATIVE` is 0;
    - inside of JAX's transformations, such as `jax.jit` and `jax.grad`;
    - for calls with keyword arguments;
    - if native code cannot be made, for instance if a primitive has no rule; then also in later
      calls with arguments of the same structure, shapes, dtypes and static leaves.

    Arrays in results of native code are NumPy arrays.

    - `native`: the function in native code.

    **Arguments:** `warns`: whether a `NativeFallbackWarning` is issued if there is no native code.
    """

    __wrapped__: Callable[Arguments, Result]

    def __init__(self, function: Callable[Arguments, Result], warns: bool = True):
        self._compiled, self._warns = Compiled(function), warns
        self.native = NativeFunction(function)
        self._refused: RecentPrograms[bool] = RecentPrograms()
        update_wrapper(self, function)

    def __call__(self, *arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        if options:
            return self._compiled(*arguments, **options)
        return self._result(arguments, self.native.run, lambda result: result)

    def in_parts(self, *arguments: PyTree) -> tuple[FlatArguments, ...]:
        """Return the elements of the result, which must be a tuple, in flattened form, which later
        calls accept as arguments. Native code makes an element's PyTree only if it is needed."""
        return self._result(
            arguments,
            self.native.run_in_parts,
            lambda parts: tuple(map(flattened, cast(tuple[PyTree, ...], parts))),
        )

    def _result(
        self,
        arguments: tuple[PyTree, ...],
        by_native: Callable[[FlatArguments], T],
        of_xla: Callable[[Result], T],
    ) -> T:
        # Within a program that JAX traces, this function becomes a part of that program.
        if not is_tracing() and is_native():
            flat = FlatArguments.of(arguments)
            # Native code takes no tracers. A program that could not be made is not tried again.
            if not flat.traced and self._refused.recent(flat.key) is None:
                try:
                    return by_native(flat)
                except UnsupportedPrimitiveError as error:
                    self._refused.add(flat.key, True)
                    if self._warns:
                        report_fallback(error)
        # XLA takes PyTrees also for arguments that come flattened from `in_parts`.
        trees = [part.tree if isinstance(part, FlatArguments) else part for part in arguments]
        return of_xla(self._compiled(*trees))  # pyright: ignore[reportCallIssue]


def is_native() -> bool:
    """Return whether native code is made: on CPUs, unless `CLEARJOINT_NATIVE` is 0."""
    return os.environ.get(SWITCH, "1") != "0" and jax.default_backend() == "cpu"


def over_rows(function: Callable[..., Result], count: ArrayLike, *rows: PyTree) -> Result:
    """Return the results of a function for the first `count` of n rows, in arrays (n, ...).

    `rows` are PyTrees of arrays (n, ...), of which `function` takes one row each. The results of
    rows from `count` on have no meaning. Native code computes one row after another, because a
    mapped function would be written out once for each row; XLA computes all rows at once.
    """
    if not is_native():
        return jax.vmap(function)(*rows)
    call, first_rows = traced_once(function), jax.tree.map(lambda leaf: leaf[0], rows)
    length = len(jax.tree.leaves(rows)[0])
    # Zeros in the place of all results, each of the shape and dtype that `eval_shape` finds.
    zeros = jax.tree.map(
        lambda of_row: jnp.zeros((length, *of_row.shape), of_row.dtype),
        jax.eval_shape(call, *first_rows),
    )

    def add(k: jax.Array, results: Result) -> Result:
        # Native code has rules for these functions with large arrays, unlike for ``array[k]``.
        row = jax.tree.map(lambda leaf: dynamic_index_in_dim(leaf, k, keepdims=False), rows)
        return jax.tree.map(
            lambda array, of_row: dynamic_update_index_in_dim(array, of_row, k, 0),
            results,
            call(*row),
        )

    return jax.lax.fori_loop(0, count, add, zeros)


def report_fallback(error: UnsupportedPrimitiveError) -> None:
    """Issue a `NativeFallbackWarning`, once for each reason in a process."""
    reason = str(error)
    if reason not in _reported:
        _reported.add(reason)
        warnings.warn(
            f"XLA compiles this program, which takes longer: no native code for {reason}. "
            f"Results are correct. Write it with other functions of jax.numpy, or set {SWITCH}=0.",
            NativeFallbackWarning,
            stacklevel=5,
        )
