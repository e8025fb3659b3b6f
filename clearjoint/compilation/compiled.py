"""Functions that XLA compiles at their first call."""

from collections.abc import Callable
from functools import update_wrapper
from typing import Generic, ParamSpec, TypeVar

import equinox as eqx

from .clock import begins_a_program, program_is_made_inside
from .tracing import collector_at_rest, is_tracing

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
OPTIONS: dict[str, str | bool] = {"xla_backend_optimization_level": "1"}
"""XLA's compiler options: LLVM's first level of optimisation takes less time than its third."""


class Compiled(Generic[Arguments, Result]):
    """A function as `equinox.filter_jit` compiles it: numbers that are arrays may change, whatever
    else changes compiles anew. JAX's cache on disk keeps what XLA has compiled.

    Python's collector of garbage rests during a call; see `.tracing`.
    """

    __wrapped__: Callable[Arguments, Result]

    def __init__(self, function: Callable[Arguments, Result]):
        traced = begins_a_program(function)
        # JAX takes options for outermost programs alone.
        self._part = eqx.filter_jit(traced)
        self._outermost = eqx.filter_jit(  # pyright: ignore
            traced, compiler_options=OPTIONS
        )
        update_wrapper(self, function)

    def __call__(self, *arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        """The function's result."""
        with collector_at_rest(), program_is_made_inside():
            compiled = self._part if is_tracing() else self._outermost
            return compiled(*arguments, **options)

    def program(self, *arguments: Arguments.args, **options: Arguments.kwargs) -> str:
        """The program for such arguments, as XLA has optimised it."""
        with program_is_made_inside():
            return self._outermost.lower(*arguments, **options).compile().compiled.as_text()

    def programs(self) -> int:
        """How many programs have been compiled."""
        return self._part._cached._cache_size() + self._outermost._cached._cache_size()
