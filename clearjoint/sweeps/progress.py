"""How far a sweep is."""

from contextlib import AbstractContextManager

from tqdm import tqdm

from ..simulation.progress_bars import telling_of_compiling


def lane_progress(lanes: int, done: int, show: bool) -> AbstractContextManager[tqdm]:
    """A bar with lanes done, lanes a second and time left, shown after two seconds, or while it
    compiles.

    Use it as a context; `update(n)` counts further lanes. `done` were there before it began.
    """
    bar = tqdm(
        total=lanes,
        initial=done,
        desc="swept",
        unit=" lanes",
        bar_format="{l_bar}{bar}| {n_fmt}/{total_fmt} [{elapsed}<{remaining}, {rate_noinv_fmt}]",
        delay=2.0,
        leave=False,
        disable=not show,
    )
    return telling_of_compiling(bar)
