"""Clock of the compilation that is in progress.

A program counts as being compiled from the first traced line until its call returns. The call
returns once the program has been started; the program itself then runs on the device.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import ParamSpec, TypeVar

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
_began: dict[int, float] = {}
"""Time at which each thread, by its identifier, began to compile a program, in s of
`time.monotonic`."""


def seconds_of_compiling() -> float:
    """Return for how long the present program has been traced and compiled, s; zero if there is
    none.

    If several threads compile programs, the longest time is returned.
    """
    times = list(_began.values())
    return time.monotonic() - min(times) if times else 0.0


def begins_a_program(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Wrap a function that Python calls only while JAX traces it, so that its call starts the
    clock."""

    @wraps(function)
    def traced(*arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        _began.setdefault(threading.get_ident(), time.monotonic())
        return function(*arguments, **options)

    return traced


@contextmanager
def program_is_made_inside() -> Iterator[None]:
    """Enclose a call that may compile a program, and stop the clock at its end.

    If such calls are nested, the clock stops at the end of the outermost one.
    """
    thread = threading.get_ident()
    is_inner = thread in _began
    try:
        yield
    finally:
        if not is_inner:
            _began.pop(thread, None)
