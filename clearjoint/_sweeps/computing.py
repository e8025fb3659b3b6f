"""Computation of the lanes that are missing in a store, with progress bars."""

import logging
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from .._simulation.lanes.scheduler import Running
from .._simulation.run.terminal import ProgressBar
from .executors import AbstractSubmitter, run_chunks
from .outputs import PENDING, RESULT, LaneArrays
from .store.store import SweepMemory, SweepStore
from .work import Chunks, Work, concatenated

if TYPE_CHECKING:
    import xarray as xr

Tracer = Callable[[], Mapping[str, str]]
"""Function that returns digests, by name, of the programs that the calling process would run."""
Store = SweepMemory | SweepStore
LanesOfChunks = Mapping[int, Sequence[int]]
"""The lanes of each chunk, as their numbers, by the index of the chunk."""
_LOG = logging.getLogger(__name__)
LONG_START = 20.0
"""Time without a result, s, after which a warning is logged if no progress bar is shown."""
ROUNDS = 3
"""Largest number of attempts to compute the missing lanes."""
WRITE_SHARE = 0.05
"""Largest share of the sweep's time that writing incomplete chunks may take."""
WRITTEN_TOGETHER = 16
"""Largest number of chunks that are written together. With more, lanes would be pending for longer,
and little time would be saved."""
STORED = "stored"
"""Description of the progress bar of the lanes in the store."""


def compute_missing(
    work: Work,
    store: Store,
    trace: Tracer | None,
    executor: AbstractSubmitter | None,
    threads: int | None,
    progress: bool,
) -> "xr.Dataset":
    """Run the lanes that are missing in a store, and return the results of all lanes.

    Lanes that are still missing after `ROUNDS` attempts are pending. With `trace`, worker processes
    check that they have the same code as this one. Without `executor`, `threads` of this process
    compute the lanes. Errors and warnings are those of `sweep`.
    """
    try:
        # Another process that writes to the same chunks may discard lanes that were written here.
        # So the store is read again, and lanes that are missing are run again.
        for _ in range(ROUNDS):
            missing = store.missing()
            done = len(work) - sum(map(len, missing.values()))
            with lane_progress(len(work), done, progress) as bar:
                if executor is not None:
                    # Called without missing lanes too, since it refuses an unsuitable executor.
                    _by_executor(Chunks(work, missing, trace), store, executor, bar)
                elif missing:
                    _by_threads(work, missing, store, threads, bar)
            results = store.dataset()
            if not (results[RESULT] == PENDING).any():
                break
        return results
    finally:
        # Also after an error or an interrupt, so that other programs find all stored lanes.
        store.write_grid()


def _by_executor(
    chunks: Chunks, store: Store, executor: AbstractSubmitter, bar: ProgressBar
) -> None:
    # Without a progress bar, a slow start is logged once.
    missing, warned = chunks.lanes, False

    # `run_chunks` calls both functions in this thread, so the store and the bar need no lock.
    def on_done(chunk: int, results: LaneArrays) -> None:
        store.write({chunk: (missing[chunk], results)})
        bar.set_description_str(STORED, refresh=False)
        bar.update(len(missing[chunk]))

    def on_start(seconds: float) -> None:
        nonlocal warned
        bar.set_description_str(f"workers start and compile, {seconds:.0f} s")
        if bar.disable and seconds > LONG_START and not warned:
            warned = True
            _LOG.warning(
                "the workers of a sweep have been starting and compiling for %.0f s", seconds
            )

    run_chunks(chunks, missing, executor, on_done, on_start)


def _by_threads(
    work: Work, missing: LanesOfChunks, store: Store, threads: int | None, bar: ProgressBar
) -> None:
    # The writer decides when lanes are written. Lanes that are not written yet are written at the
    # end, also after an error or an interrupt.
    writer = _Writer(missing, store, bar)

    def on_progress(running: Running) -> None:
        writer.write_if_due()
        show_running(bar, running)

    try:
        lanes = [lane for lanes in missing.values() for lane in lanes]
        work.run(lanes, writer.add, threads=threads, on_progress=on_progress)
    finally:
        writer.write()


class _Writer:
    """Collects the results of lanes that have ended, and writes them to the store.

    Complete chunks are written at once. So are lanes of incomplete chunks, while writing them takes
    at most the share `WRITE_SHARE` of the sweep's time. Lanes that end while others are written are
    added in the next call of `add`; `Batch.run` begins no further lanes if writing lasts long.

    **Arguments:** `missing`: the lanes to compute; `bar`: shows how many lanes are written.
    """

    def __init__(self, missing: LanesOfChunks, store: Store, bar: ProgressBar):
        self._store, self._bar = store, bar
        self._chunk_of = {lane: chunk for chunk, lanes in missing.items() for lane in lanes}
        self._unwritten = {chunk: len(lanes) for chunk, lanes in missing.items()}
        self._waiting: dict[int, list[tuple[np.ndarray, LaneArrays]]] = {}
        self._last_write = time.monotonic()
        self._write_seconds = 0.0

    def add(self, lanes: np.ndarray, results: LaneArrays) -> None:
        """Add the numbers, (n,), and results of n lanes that have ended, and write what is due."""
        chunks = np.array([self._chunk_of[lane] for lane in lanes.tolist()])
        for chunk in np.unique(chunks).tolist():
            in_chunk = chunks == chunk
            of_chunk = {name: values[in_chunk] for name, values in results.items()}
            self._waiting.setdefault(chunk, []).append((lanes[in_chunk], of_chunk))
        self.write_if_due()

    def write_if_due(self) -> None:
        """Write complete chunks, and incomplete chunks if this takes at most `WRITE_SHARE`."""
        # The time that the last write of incomplete chunks took is an estimate for the next one.
        since = time.monotonic() - self._last_write
        self.write(incomplete=since * WRITE_SHARE >= self._write_seconds)

    def write(self, incomplete: bool = True) -> None:
        self._write([chunk for chunk in self._waiting if self._is_complete(chunk)])
        if incomplete:
            # Only this is timed: complete chunks are written at once in any case.
            start = time.monotonic()
            self._write(list(self._waiting))
            self._last_write = time.monotonic()
            self._write_seconds = self._last_write - start

    def _is_complete(self, chunk: int) -> bool:
        """Whether all unwritten lanes of a chunk have ended."""
        return sum(len(lanes) for lanes, _ in self._waiting[chunk]) == self._unwritten[chunk]

    def _write(self, chunks: Sequence[int]) -> None:
        for first in range(0, len(chunks), WRITTEN_TOGETHER):
            parts = {}
            for chunk in chunks[first : first + WRITTEN_TOGETHER]:
                lanes, results = concatenated(self._waiting[chunk])
                parts[chunk] = lanes.tolist(), results
            self._store.write(parts)
            # Only now: if an error interrupts the writing, it is repeated at the end of the sweep.
            for chunk, (lanes, _) in parts.items():
                del self._waiting[chunk]
                self._unwritten[chunk] -= len(lanes)
                self._bar.update(len(lanes))


def lane_progress(lanes: int, done: int, show: bool) -> ProgressBar:
    """Return a progress bar of a number of `lanes`, of which the number `done` is stored already,
    and print these numbers. Show nothing unless `show`."""
    if show and done:
        remaining = f"{lanes - done} are computed" if done < lanes else "none is computed"
        text = f"{done} of {lanes} lanes are in the store; {remaining}"
        print(text, file=sys.stderr, flush=True)
    # While lanes run in this process, `show_running` sets the time left, from the progress of lanes
    # that still run. The delay keeps short sweeps from showing a bar.
    form = "{l_bar}{bar}| {n_fmt}/{total_fmt} lanes [{elapsed}, left {left}{postfix}]"
    return ProgressBar(show, total=lanes, initial=done, desc=STORED, bar_format=form, delay=2.0)


def show_running(bar: ProgressBar, running: Running) -> None:
    bar.seconds_left = running.seconds_left
    reached = f"{running.earliest:.4g} s to {running.latest:.4g} s"
    bar.set_postfix_str(f"{running.lanes} running lanes have reached {reached}")
