"""Interruption of runs by Ctrl-C, after which the results so far are kept."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from ..results.solution import FinishedRun


class RunInterrupted(KeyboardInterrupt):
    """The error of a run that the user stopped by Ctrl-C (the signal SIGINT).

    Its attribute `solution` is the `Solution` up to the interruption. A further run can start from
    `solution.time` and `solution.final`.

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
    """Return a context manager for a run. The first Ctrl-C in its block raises no error, but is
    noted, so that the run can stop between two segments and keep its results.

    Its value is a function that returns whether Ctrl-C has been pressed. A second
    Ctrl-C raises `KeyboardInterrupt` at once. Outside the main thread, and in a program with its
    own handler of SIGINT, the handling of the signal is not changed, and the function returns
    ``False``.
    """
    requested = threading.Event()
    # Python delivers signals to the main thread only, and the handler of a program is respected.
    ours = threading.current_thread() is threading.main_thread()
    if not ours or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield requested.is_set
        return

    def note(number: int, frame: FrameType | None) -> None:
        del number, frame
        requested.set()
        # From now on, Ctrl-C raises `KeyboardInterrupt` again.
        signal.signal(signal.SIGINT, signal.default_int_handler)

    signal.signal(signal.SIGINT, note)
    try:
        yield requested.is_set
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
