"""Progress on the error stream: a bar in a terminal, a line every half minute in a log file.

While a program is compiled, the text tells for how long. A thread updates the text once a second,
since the main thread waits for JAX.
"""

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import TextIO
from weakref import WeakSet

from tqdm import tqdm

from ...compilation import seconds_of_compiling

TICK = 1.0
"""Time, s, between two updates; also the time of compiling, s, after which the bar tells of it."""
LINE_PERIOD = 30.0
"""Time, s, between two lines where the error stream is neither a terminal nor a notebook."""
WATCH = "clearjoint: compiling"
"""Name of the thread that updates the bar."""


class ProgressBar(tqdm):
    """A bar of tqdm in terminals and notebooks, and a line every `LINE_PERIOD` seconds elsewhere.

    `seconds_left`: estimated time left, s, which a caller may set; ``None`` if unknown. The field
    ``{left}`` of a `bar_format` shows this time.
    """

    # The default lock of tqdm is a semaphore of the system, which a killed process leaves behind.
    _lock = threading.RLock()
    # Otherwise tqdm adds these and a monitor to the class, which then counts as changed code (see
    # `compilation`).
    _instances = WeakSet()
    monitor_interval = 0
    seconds_left: float | None = None
    _latest_line: float | None = None

    @property
    def format_dict(self) -> dict[str, object]:
        """Return the fields of the text by name; `left` is the time left, such as "02:15"."""
        fields = super().format_dict
        left = self.seconds_left
        return {**fields, "left": "?" if left is None else self.format_interval(left)}

    def display(self, msg: str | None = None, pos: int | None = None) -> bool:
        """Show the text `msg`, or that of the bar; return whether it was shown.

        In a log file, nothing is shown within `LINE_PERIOD` after the latest line.
        """
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


@contextmanager
def telling_of_compiling(bar: tqdm) -> Iterator[tqdm]:
    """Return a context that shows a bar, with the text "compiling, 12 s" during compilation.

    Without a bar to show (`bar.disable`), no thread is started.
    """
    with bar:
        if bar.disable:
            yield bar
            return
        over = threading.Event()
        watch = threading.Thread(target=_tell, args=(bar, over), name=WATCH, daemon=True)
        try:
            watch.start()
            yield bar
        finally:
            over.set()
            watch.join()


def compiling_bar(show: bool) -> AbstractContextManager[tqdm]:
    """Return a context for a call without progress, which shows only the time spent compiling.

    **Arguments:** `show`: whether to show it at all.
    """
    bar = ProgressBar(bar_format="{desc}", delay=2.0, leave=False, disable=not show)
    return telling_of_compiling(bar)


def _tell(bar: tqdm, over: threading.Event) -> None:
    usual, shown = bar.desc, False
    while not over.wait(TICK):
        seconds = seconds_of_compiling()
        if seconds >= TICK:
            bar.delay = 0.0  # Or tqdm would not clear what is shown before its delay is over.
            bar.set_description_str(f"compiling, {seconds:.0f} s")
        elif shown:
            bar.set_description_str(usual)
        shown = seconds >= TICK
