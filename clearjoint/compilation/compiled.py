"""Functions that JAX compiles at their first call.

Python's collector of garbage rests during a call, which leaves Python alone for the rest of its
time anyway.
"""

from collections.abc import Callable
from functools import update_wrapper
from typing import Generic, ParamSpec, TypeVar

import equinox as eqx

from .clock import begins_a_program, program_is_made_inside
from .effort import Effort, compiler_options
from .kept_programs import KeptPrograms
from .program import Donated
from .tracing import collector_at_rest, is_tracing

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


class Compiled(Generic[Arguments, Result]):
    """A function as `equinox.filter_jit` compiles it: numbers that are arrays may change, whatever
    else changes compiles anew.

    Where programs are kept (see `keep_programs`), one that another process has compiled is loaded
    from disk, and nothing is traced, if function and arguments consist of this package's code alone
    (see `plain_values`). `effort`: "least" for what runs once or twice a run.
    """

    __wrapped__: Callable[Arguments, Result]

    def __init__(
        self,
        function: Callable[Arguments, Result],
        donate: Donated = "none",
        effort: Effort = "full",
    ):
        traced = begins_a_program(function)
        self._part = self._compiled = eqx.filter_jit(traced, donate=donate)
        if options := compiler_options(effort):
            self._compiled = eqx.filter_jit(  # pyright: ignore
                traced, donate=donate, compiler_options=options
            )
        self._kept = KeptPrograms(function, donate, effort)
        update_wrapper(self, function)

    def __call__(self, *arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        """The function's result."""
        with collector_at_rest(), program_is_made_inside():
            found = self._kept.program_for(arguments, options)
            if found is not None:
                program, leaves = found
                return program(leaves)
            if is_tracing():
                # JAX takes options for outermost programs alone.
                return self._part(*arguments, **options)
            return self._compiled(*arguments, **options)

    def program(self, *arguments: Arguments.args, **options: Arguments.kwargs) -> str:
        """The program for such arguments, as XLA has optimised it."""
        with program_is_made_inside():
            return self._compiled.lower(*arguments, **options).compile().compiled.as_text()

    def programs(self) -> int:
        """How many programs have been compiled, or loaded."""
        compiled = {self._part._cached, self._compiled._cached}
        return sum(function._cache_size() for function in compiled) + len(self._kept)
