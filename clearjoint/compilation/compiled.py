"""Functions that JAX compiles at their first call.

Python's collector of garbage rests during a call, which leaves Python alone for the rest of its
time anyway.
"""

from collections.abc import Callable
from functools import update_wrapper
from typing import Generic, ParamSpec, TypeVar

import equinox as eqx

from .clock import begins_a_program, program_is_made_inside
from .kept_programs import KeptPrograms
from .program import Donated
from .tracing import collector_at_rest

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


class Compiled(Generic[Arguments, Result]):
    """A function as `equinox.filter_jit` compiles it: numbers that are arrays may change, whatever
    else changes compiles anew.

    Where programs are kept (see `keep_programs`), one that another process has compiled is loaded
    from disk, and nothing is traced.
    """

    __wrapped__: Callable[Arguments, Result]

    def __init__(self, function: Callable[Arguments, Result], donate: Donated = "none"):
        self._compiled = eqx.filter_jit(begins_a_program(function), donate=donate)
        self._kept = KeptPrograms(function, donate)
        update_wrapper(self, function)

    def __getstate__(self) -> tuple[object, ...]:
        """What another process would know it by."""
        return self.__wrapped__, self._kept.donate

    def __call__(self, *arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        """The function's result."""
        with collector_at_rest(), program_is_made_inside():
            program = self._kept.program_for(arguments, options)
            if program is not None:
                return program(arguments, options)
            return self._compiled(*arguments, **options)

    def program(self, *arguments: Arguments.args, **options: Arguments.kwargs) -> str:
        """The program for such arguments, as XLA has optimised it."""
        with program_is_made_inside():
            return self._compiled.lower(*arguments, **options).compile().compiled.as_text()

    def programs(self) -> int:
        """How many programs have been compiled, or loaded."""
        return self._compiled._cached._cache_size() + len(self._kept)
