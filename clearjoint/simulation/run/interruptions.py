"""Interruption of runs by Ctrl-C, which keeps what they have computed."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from ..results.solution import FinishedRun


class RunInterrupted(KeyboardInterrupt):
    """A run that was stopped by Ctrl-C (SIGINT).

    `solution` is the `Solution` up to then; the run can be continued from its `time` and `final`.

    ```python
    import clearjoint as cj

    scene, state = cj.mechanisms.double_pendulum()
    try:
        solution = cj.simulate(scene, state, 0.01)
    except cj.RunInterrupted as stopped:
        solution = stopped.solution
    ```
    """

    def __init__(self, solution: FinishedRun):
        super().__init__(f"The run was interrupted at t = {float(solution.time):.9g} s.")
        self.solution = solution


@contextmanager
def interruptions_deferred() -> Iterator[Callable[[], bool]]:
    """Defer the first Ctrl-C; the context returns a function that says whether there was one.

    A second one interrupts at once. Outside the main thread, and where the program has its own
    handler of the signal, nothing changes.
    """
    requested = threading.Event()
    ours = threading.current_thread() is threading.main_thread()
    if not ours or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield requested.is_set
        return

    def note(number: int, frame: FrameType | None) -> None:
        del number, frame
        requested.set()
        signal.signal(signal.SIGINT, signal.default_int_handler)

    signal.signal(signal.SIGINT, note)
    try:
        yield requested.is_set
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
