"""Progress of runs on the error stream, and their interruption by Ctrl-C.

While a program is being compiled, the text of a progress bar says for how long. One thread updates
the texts of all bars once a second, because the main thread waits for JAX.
"""

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Self, TextIO
from weakref import WeakSet

from tqdm import tqdm
from typing_extensions import override

from ..._compilation.xla import seconds_of_compiling
from ..results.solution import Solution

TICK = 1.0
"""Time, s, between two updates of a bar's text, and of compiling before the text mentions it."""
LINE_PERIOD = 30.0
"""Time, s, between lines of progress if the error stream is neither a terminal nor a notebook."""
WATCH = "clearjoint: compiling"
"""Name of the thread that updates the bars."""


class _Watch:
    """Updates the texts of progress bars, by a thread that runs while there are bars.

    - `usual`: the bars, each with its text for the time in which nothing is being compiled.
    - `lock`: held while `usual` or `thread` changes, and while texts are written to open bars.
    """

    def __init__(self) -> None:
        self.usual: dict[tqdm, str] = {}
        self.thread: threading.Thread | None = None
        self.lock = threading.Lock()

    def add(self, bar: tqdm) -> None:
        with self.lock:
            self.usual[bar] = bar.desc
            # The thread of an earlier bar is used again, since starting one takes a third of the
            # time of a short run. After a fork, it exists in the parent process only.
            if self.thread is None or not self.thread.is_alive():
                self.thread = threading.Thread(target=self._update, name=WATCH, daemon=True)
                self.thread.start()

    def remove(self, bar: tqdm) -> None:
        with self.lock:
            del self.usual[bar]

    def _update(self) -> None:
        while True:
            time.sleep(TICK)
            seconds = seconds_of_compiling()
            with self.lock:
                if not self.usual:
                    self.thread = None
                    return
                for bar, usual in self.usual.items():
                    if seconds >= TICK:
                        # With a delay, tqdm would not clear a text that is shown before the delay
                        # is over.
                        bar.delay = 0.0
                        bar.set_description_str(f"compiling, {seconds:.0f} s")
                    elif bar.desc.startswith("compiling"):
                        bar.set_description_str(usual)


_watch = _Watch()


class ProgressBar(tqdm):
    """A bar of tqdm in terminals and notebooks, and a line every `LINE_PERIOD` seconds elsewhere.

    As a context, it has the text "compiling, 12 s" while JAX compiles, and disappears at the end.
    The field ``{left}`` in a `bar_format` shows `seconds_left`, s, which a caller may set.

    **Arguments:** `show`: whether anything is shown; `options`: those of tqdm.
    """

    # The default lock of tqdm is a semaphore of the system, which a killed process leaves behind.
    _lock = threading.RLock()
    # Otherwise tqdm may set attributes of the class at run time, such as a monitor thread, and the
    # class would count as changed code (see `compilation`).
    _instances = WeakSet()
    monitor_interval = 0
    seconds_left: float | None = None
    _latest_line: float | None = None

    def __init__(self, show: bool, **options: object):
        super().__init__(leave=False, disable=not show, **options)  # pyright: ignore

    @override
    def __enter__(self) -> Self:
        if not self.disable:
            _watch.add(self)
        return super().__enter__()

    @override
    def __exit__(self, *error: object) -> None:
        if not self.disable:
            _watch.remove(self)
        super().__exit__(*error)  # pyright: ignore

    @property
    @override
    def format_dict(self) -> dict[str, object]:
        """Values of the fields in `bar_format`: tqdm's, and `left`, such as "02:15" or "?"."""
        fields = super().format_dict
        left = self.seconds_left
        return {**fields, "left": "?" if left is None else self.format_interval(left)}

    @override
    def display(self, msg: str | None = None, pos: int | None = None) -> bool:
        """Show `msg`, or by default the text of the bar, and return whether it was shown. Where
        text cannot be overwritten, as in a log file, nothing is shown within `LINE_PERIOD` seconds
        after the start or the latest line, nor for an empty `msg`, with which tqdm clears a bar."""
        if is_live(sys.stderr):
            return bool(super().display(msg, pos))
        now = time.time()
        latest = self._latest_line or getattr(self, "start_t", now)
        if msg == "" or now - latest < LINE_PERIOD:
            return False
        self._latest_line = now
        print(str(self) if msg is None else msg, file=sys.stderr, flush=True)
        return True


def is_live(stream: TextIO) -> bool:
    """Return whether text on a stream can be overwritten, as in terminals and notebooks."""
    return stream.isatty() or type(stream).__module__.startswith("ipykernel")


def compiling_bar(show: bool) -> ProgressBar:
    """Return a context that shows the time spent compiling, for a call without other progress."""
    return ProgressBar(show, bar_format="{desc}", delay=2.0)


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

    def __init__(self, solution: Solution):
        super().__init__(f"The run was interrupted at t = {float(solution.time):.9g} s.")
        self.solution = solution


@contextmanager
def interruptions_deferred() -> Iterator[Callable[[], bool]]:
    """Note the first Ctrl-C in the block instead of raising an error, so that a run can stop when
    compiled code next returns to Python, and keep its results. The block gets a function that tells
    whether Ctrl-C has been pressed. A further Ctrl-C raises `KeyboardInterrupt`, also only when
    compiled code returns. Outside the main thread, and in a program with its own handler of SIGINT,
    the handling of the signal is not changed, and the function returns ``False``."""
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
