"""Progress bars that say for how long what they wait for has been compiled.

A thread beside the call looks once a second, since the call itself is inside JAX meanwhile.
"""

import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager

from tqdm import tqdm

from ..compilation import seconds_of_compiling

TICK = 1.0
"""Seconds between two looks, and of compiling before it is told."""
WATCH = "clearjoint: compiling"
"""Name of the thread."""


@contextmanager
def telling_of_compiling(bar: tqdm) -> Iterator[tqdm]:
    """The bar, as a context: while a program is compiled its description is "compiling, 12 s".

    Beside a bar that is disabled no thread begins.
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
    """A bar for a call of which nothing is known until it ends: shown while it compiles."""
    return telling_of_compiling(tqdm(bar_format="{desc}", delay=2.0, leave=False, disable=not show))


def _tell(bar: tqdm, over: threading.Event) -> None:
    usual, told = bar.desc, False
    while not over.wait(TICK):
        seconds = seconds_of_compiling()
        if seconds >= TICK:
            bar.delay = 0.0  # Or tqdm would not clear what is shown before its delay is over.
            bar.set_description_str(f"compiling, {seconds:.0f} s")
        elif told:
            bar.set_description_str(usual)
        told = seconds >= TICK
