"""The lanes that a store lacks, computed and written to it chunk by chunk."""

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from tqdm import tqdm

from ..simulation.lanes.scheduler import Running
from .executors import AbstractSubmitter, run_chunks
from .layout import PENDING, RESULT, LaneArrays
from .progress import STORED, lane_progress, show_running
from .store.store import SweepMemory, SweepStore
from .work import Chunks, Work, concatenated

if TYPE_CHECKING:
    import xarray as xr

Tracer = Callable[[], Mapping[str, str]]
"""Returns digests of the programs that the process that calls it would run."""
_LOG = logging.getLogger(__name__)
LONG_START = 20.0
"""Seconds without a result of any worker that are logged where no progress is shown."""
ROUNDS = 3
"""How often lanes are run that the store lacks."""
WRITE_PERIOD = 10.0
"""Longest time, s, that a lane which has ended waits for its chunk before it is written alone."""
WRITE_SHARE = 0.1
"""Largest share of the time that writing such lanes may take."""


def computed(
    work: Work,
    store: SweepMemory | SweepStore,
    trace: Tracer | None,
    executor: AbstractSubmitter | None,
    threads: int | None,
    progress: bool,
) -> "xr.Dataset":
    """Run the lanes that the store lacks, and write their results to it; its results then.

    Lanes that are still missing afterwards, since another process has written to the same chunks or
    has damaged them, are run again.

    **Arguments:** `trace` as in `Chunks`; the others but `store` as in `sweep`.
    """
    try:
        for _ in range(ROUNDS):
            missing = store.missing()
            done = len(work) - sum(map(len, missing.values()))
            with lane_progress(len(work), done, progress) as bar:
                if executor is not None:
                    _by_executor(Chunks(work, missing, trace), store, executor, bar)
                elif missing:
                    _by_threads(work, missing, store, threads, bar)
            results = store.dataset()
            if not (results[RESULT] == PENDING).any():
                break
        return results
    finally:
        store.write_grid()


def _by_executor(
    chunks: Chunks, store: SweepMemory | SweepStore, executor: AbstractSubmitter, bar: tqdm
) -> None:
    """Hand chunks to an executor, and write each when it comes back."""
    missing = chunks.lanes

    def on_done(chunk: int, results: LaneArrays) -> None:
        store.write(chunk, missing[chunk], results)
        bar.set_description_str(STORED, refresh=False)
        bar.update(len(missing[chunk]))

    def on_start(seconds: float) -> None:
        bar.set_description_str(f"workers start and compile, {seconds:.0f} s")
        if bar.disable and seconds > LONG_START and not said:
            said.append(seconds)
            _LOG.warning(
                "the workers of a sweep have been starting and compiling for %.0f s", seconds
            )

    said: list[float] = []
    run_chunks(chunks, missing, executor, on_done, on_start)


def _by_threads(
    work: Work,
    missing: Mapping[int, Sequence[int]],
    store: SweepMemory | SweepStore,
    threads: int | None,
    bar: tqdm,
) -> None:
    """Run lanes in threads of this process, and write them to the store while others run."""
    writer = _Writer(missing, store, bar)

    def on_progress(running: Running) -> None:
        writer.write_if_due()
        show_running(bar, running)

    try:
        lanes = [lane for lanes in missing.values() for lane in lanes]
        work.run(lanes, writer.add, threads=threads, on_progress=on_progress)
    finally:
        writer.write_all()


class _Writer:
    """Writes each chunk when its last lane has ended; and lanes of chunks that are not complete
    when as many of them wait as a chunk has, or for longer than `WRITE_PERIOD`."""

    def __init__(
        self, missing: Mapping[int, Sequence[int]], store: SweepMemory | SweepStore, bar: tqdm
    ):
        self._store, self._bar = store, bar
        self._chunk_of = {lane: chunk for chunk, lanes in missing.items() for lane in lanes}
        self._unwritten = {chunk: len(lanes) for chunk, lanes in missing.items()}
        self._waiting: dict[int, list[tuple[np.ndarray, LaneArrays]]] = {}
        self._written = time.monotonic()
        self._seconds = 0.0

    def add(self, lanes: np.ndarray, results: LaneArrays) -> None:
        """Take lanes that have ended."""
        chunks = np.array([self._chunk_of[lane] for lane in lanes.tolist()])
        for chunk in np.unique(chunks).tolist():
            own = chunks == chunk
            part = lanes[own], {name: values[own] for name, values in results.items()}
            self._waiting.setdefault(chunk, []).append(part)
            if self._lanes_waiting(chunk) == self._unwritten[chunk]:
                self._write(chunk)
        self.write_if_due()

    def _lanes_waiting(self, chunk: int) -> int:
        return sum(len(lanes) for lanes, _ in self._waiting[chunk])

    def write_if_due(self) -> None:
        """Write the lanes of chunks that are not complete, if they are many or have waited long."""
        since = time.monotonic() - self._written
        many = sum(map(self._lanes_waiting, self._waiting)) >= self._store.layout.chunk
        if since > self._seconds / WRITE_SHARE and (many or since > WRITE_PERIOD):
            self.write_all()

    def write_all(self) -> None:
        """Write all lanes that wait."""
        begun = time.monotonic()
        for chunk in list(self._waiting):
            self._write(chunk)
        self._written = time.monotonic()
        self._seconds = self._written - begun

    def _write(self, chunk: int) -> None:
        lanes, results = concatenated(self._waiting.pop(chunk))
        self._store.write(chunk, lanes.tolist(), results)
        self._unwritten[chunk] -= len(lanes)
        self._bar.update(len(lanes))
