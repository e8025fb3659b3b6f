"""How far a sweep is."""

import sys
from contextlib import AbstractContextManager

from tqdm import tqdm

from ..simulation.lanes.scheduler import Running
from ..simulation.run.progress_bars import ProgressBar, telling_of_compiling

STORED = "stored"
"""Description of a bar."""


def lane_progress(lanes: int, done: int, show: bool) -> AbstractContextManager[tqdm]:
    """A bar with the lanes stored and the time left, shown after two seconds, or while it compiles.

    Use it as a context; `update(n)` counts further lanes. `done` were there before it began, which
    a line says.
    """
    if show and done:
        rest = f"{lanes - done} are computed" if done < lanes else "none is computed"
        print(f"{done} of {lanes} lanes are in the store; {rest}", file=sys.stderr, flush=True)
    bar = ProgressBar(
        total=lanes,
        initial=done,
        desc=STORED,
        bar_format="{l_bar}{bar}| {n_fmt}/{total_fmt} lanes [{elapsed}, left {left}{postfix}]",
        delay=2.0,
        leave=False,
        disable=not show,
    )
    return telling_of_compiling(bar)


def show_running(bar: tqdm, running: Running) -> None:
    """Show in a bar which times the running lanes have reached, and the time left."""
    assert isinstance(bar, ProgressBar)
    bar.seconds_left = running.seconds_left
    reached = f"{running.earliest:.4g} s to {running.latest:.4g} s"
    bar.set_postfix_str(f"{running.lanes} running lanes have reached {reached}")
