"""Functions that run as machine code of this room on CPUs, and by XLA elsewhere."""

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
from .functions import Given, NativeFunction
from .lowering import UnsupportedPrimitiveError

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
SWITCH = "CLEARJOINT_NATIVE"
"""Environment variable: 0 has XLA compile everything."""
_reported: set[str] = set()


class NativeFallbackWarning(UserWarning):
    """A program that XLA compiles, since the scene has a primitive of JAX without a rule in
    `clearjoint.native`. Results are right, compiling takes longer."""


class Native(Generic[Arguments, Result]):
    """A function that is compiled without XLA where it can be: on CPUs, outside of transformations.

    Results then have NumPy's arrays. A function with a primitive that has no rule in `.lowering` is
    compiled by XLA, with one warning if `warns`. `native`: the function in native code.
    """

    __wrapped__: Callable[Arguments, Result]

    def __init__(self, function: Callable[Arguments, Result], warns: bool = True):
        self._compiled, self._warns = Compiled(function), warns
        self.native = NativeFunction(function)
        self._refused: set[Hashable] = set()
        update_wrapper(self, function)

    def __call__(self, *arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        """The function's result."""
        if options or is_tracing() or not is_native():
            return self._compiled(*arguments, **options)
        given = Given.of(arguments)
        traced = any(isinstance(array, Tracer) for array in given.arrays)
        if not traced and given.key not in self._refused:
            try:
                return self.native.run(given)
            except UnsupportedPrimitiveError as error:
                self._refused.add(given.key)
                if self._warns:
                    report_fallback(error)
        return self._compiled(*arguments, **options)

    def program(self, *arguments: Arguments.args, **options: Arguments.kwargs) -> str:
        """The program for such arguments, as XLA optimises it."""
        return self._compiled.program(*arguments, **options)

    def programs(self) -> int:
        """How many programs have been compiled."""
        return self._compiled.programs() + self.native.count()


def is_native() -> bool:
    """Whether programs are compiled by this room: on CPUs, unless `SWITCH` is 0."""
    return os.environ.get(SWITCH, "1") != "0" and jax.default_backend() == "cpu"


def over_rows(function: Callable[..., Result], *rows: PyTree) -> Result:
    """A function of each row of arrays: one row after the other in native code, which else would be
    as long as there are rows; all at once in XLA's."""
    if is_native():
        return jax.lax.map(lambda row: function(*row), rows)
    return jax.vmap(function)(*rows)


def report_fallback(error: UnsupportedPrimitiveError) -> None:
    """Warn once of each reason for which XLA compiles a program."""
    reason = str(error)
    if reason not in _reported:
        _reported.add(reason)
        warnings.warn(
            f"XLA compiles this program, which takes longer: no native code for {reason}. "
            f"Results are right. Write it with other functions of jax.numpy, or set {SWITCH}=0.",
            NativeFallbackWarning,
            stacklevel=4,
        )
