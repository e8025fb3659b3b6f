"""How far a sweep is."""

from tqdm import tqdm


def lane_progress(lanes: int, done: int, show: bool) -> tqdm:
    """A bar with lanes done, lanes a second and time left, shown after two seconds.

    Use it as a context; `update(n)` counts further lanes. `done` were there before it began.
    """
    return tqdm(
        total=lanes,
        initial=done,
        desc="swept",
        unit=" lanes",
        bar_format="{l_bar}{bar}| {n_fmt}/{total_fmt} [{elapsed}<{remaining}, {rate_noinv_fmt}]",
        delay=2.0,
        leave=False,
        disable=not show,
    )
