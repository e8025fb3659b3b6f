"""Time since the program that is being compiled was begun.

A program is being compiled from the first traced line until the call returns; the program itself
runs on the device after that.
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
"""Time at which each thread, by its number, began to compile a program; s of `time.monotonic`."""


def seconds_of_compiling() -> float:
    """Return for how long a program has been traced and compiled in any thread; zero if none is."""
    times = list(_began.values())
    return time.monotonic() - min(times) if times else 0.0


def begins_a_program(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Wrap a function that is called only to be traced, so that its call begins a program."""

    @wraps(function)
    def traced(*arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        _began.setdefault(threading.get_ident(), time.monotonic())
        return function(*arguments, **options)

    return traced


@contextmanager
def program_is_made_inside() -> Iterator[None]:
    """Enclose a call that may compile a program; a program ends with the outermost such call."""
    thread = threading.get_ident()
    is_inner = thread in _began
    try:
        yield
    finally:
        if not is_inner:
            _began.pop(thread, None)
