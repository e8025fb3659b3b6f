"""Compile functions to native code on CPUs, and by XLA elsewhere."""

import os
import warnings
from collections.abc import Callable, Hashable
from functools import update_wrapper
from typing import Generic, ParamSpec, TypeVar

import jax
from jax.core import Tracer
from jaxtyping import PyTree

from ..compilation import Compiled
from ..compilation.tracing import is_tracing
from .functions import FlatArguments, NativeFunction
from .lowering import UnsupportedPrimitiveError

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
SWITCH = "CLEARJOINT_NATIVE"
"""Environment variable: with the value 0, XLA compiles everything."""
_reported: set[str] = set()


class NativeFallbackWarning(UserWarning):
    """XLA compiles a program, because the scene uses a primitive of JAX without a rule in
    `clearjoint.native`. Results are correct; compiling takes longer."""


class Native(Generic[Arguments, Result]):
    """A function that is compiled to native code on CPUs, outside of JAX's transformations.

    Arrays in results are then NumPy arrays. XLA compiles the function on accelerators, inside of
    transformations, and if the function uses a primitive without a rule.

    - `native`: the function in native code.

    **Arguments:** `function`: function of PyTrees; `warns`: whether a `NativeFallbackWarning` is
    issued if the function uses a primitive without a rule.
    """

    __wrapped__: Callable[Arguments, Result]

    def __init__(self, function: Callable[Arguments, Result], warns: bool = True):
        self._compiled, self._warns = Compiled(function), warns
        self.native = NativeFunction(function)
        self._refused: set[Hashable] = set()
        update_wrapper(self, function)

    def __call__(self, *arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        """Return the function's result."""
        if options or is_tracing() or not is_native():
            return self._compiled(*arguments, **options)
        flat = FlatArguments.of(arguments)
        traced = any(isinstance(array, Tracer) for array in flat.arrays)
        if not traced and flat.key not in self._refused:
            try:
                return self.native.run(flat)
            except UnsupportedPrimitiveError as error:
                self._refused.add(flat.key)
                if self._warns:
                    report_fallback(error)
        return self._compiled(*arguments, **options)

    def programs(self) -> int:
        """Return the number of compiled programs."""
        return self._compiled.programs() + self.native.count()


def is_native() -> bool:
    """Return whether programs are compiled to native code: on CPUs, unless `SWITCH` is 0."""
    return os.environ.get(SWITCH, "1") != "0" and jax.default_backend() == "cpu"


def over_rows(function: Callable[..., Result], *rows: PyTree) -> Result:
    """Apply a function to the k-th rows of all arrays in `rows`, for each k, and stack the results.

    XLA computes all rows at once. Native code computes them in a loop, since it would unroll a
    mapped function to one copy for each row.
    """
    if is_native():
        return jax.lax.map(lambda row: function(*row), rows)
    return jax.vmap(function)(*rows)


def report_fallback(error: UnsupportedPrimitiveError) -> None:
    """Warn that XLA compiles a program, once for each reason."""
    reason = str(error)
    if reason not in _reported:
        _reported.add(reason)
        warnings.warn(
            f"XLA compiles this program, which takes longer: no native code for {reason}. "
            f"Results are correct. Write it with other functions of jax.numpy, or set {SWITCH}=0.",
            NativeFallbackWarning,
            stacklevel=4,
        )
