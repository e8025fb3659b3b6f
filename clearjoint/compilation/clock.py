"""For how long a program has been in the making.

From the first line that is traced until the call returns, a program is being made; its run goes on
behind, on the device.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import ParamSpec, TypeVar

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
_begun: dict[int, float] = {}
"""When the program that a thread makes was begun, s of `time.monotonic`, by thread."""


def seconds_of_compiling() -> float:
    """For how long the program that is being made has been traced and compiled, in any thread; zero
    if none is."""
    begun = list(_begun.values())
    return time.monotonic() - min(begun) if begun else 0.0


def begins_a_program(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """The function, which is called when it is traced and then only."""

    @wraps(function)
    def traced(*arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        _begun.setdefault(threading.get_ident(), time.monotonic())
        return function(*arguments, **options)

    return traced


@contextmanager
def program_is_made_inside() -> Iterator[None]:
    """A call that may make a program, unless it is part of one that is being made."""
    thread = threading.get_ident()
    part = thread in _begun
    try:
        yield
    finally:
        if not part:
            _begun.pop(thread, None)
