"""The lanes that a store lacks, computed and written to it chunk by chunk."""

from collections.abc import Callable, Mapping, Sequence

from tqdm import tqdm

from ..runtime import Device
from .executors import AbstractSubmitter, run_chunks
from .layout import LaneArrays
from .progress import lane_progress
from .store.store import SweepMemory, SweepStore
from .work import Chunks, Work, joined

Tracer = Callable[[], Mapping[str, str]]
"""Returns digests of the programs that the process that calls it would run."""


def compute_missing(
    work: Work,
    store: SweepMemory | SweepStore,
    trace: Tracer | None,
    executor: AbstractSubmitter | None,
    devices: Sequence[Device] | None,
    progress: bool,
) -> None:
    """Run the lanes that the store lacks, and write their results to it.

    **Arguments:** `trace` as in `Chunks`; the others but `store` as in `sweep`.
    """
    missing = store.missing()
    done = len(work) - sum(map(len, missing.values()))
    with lane_progress(len(work), done, progress) as bar:
        if executor is not None:
            _by_executor(Chunks(work, missing, trace), store, executor, bar)
        elif missing:
            _by_devices(work, missing, store, devices, bar)


def _by_executor(
    chunks: Chunks, store: SweepMemory | SweepStore, executor: AbstractSubmitter, bar: tqdm
) -> None:
    """Hand chunks to an executor, and write each when it comes back."""
    missing = chunks.lanes

    def on_done(chunk: int, results: LaneArrays) -> None:
        store.write(chunk, missing[chunk], results)
        bar.update(len(missing[chunk]))

    run_chunks(chunks, missing, executor, on_done)


def _by_devices(
    work: Work,
    missing: Mapping[int, Sequence[int]],
    store: SweepMemory | SweepStore,
    devices: Sequence[Device] | None,
    bar: tqdm,
) -> None:
    """Run lanes on this process's devices, and write each chunk when its last lane has ended."""
    chunk_of = {lane: chunk for chunk, lanes in missing.items() for lane in lanes}
    collected: dict[int, dict[int, LaneArrays]] = {chunk: {} for chunk in missing}
    done = len(work) - len(chunk_of)

    def on_ended(lane: int, results: LaneArrays) -> None:
        nonlocal done
        done += 1
        chunk = chunk_of[lane]
        collected[chunk][lane] = results
        if len(collected[chunk]) == len(missing[chunk]):
            rows = collected.pop(chunk)
            store.write(chunk, missing[chunk], joined([rows[k] for k in missing[chunk]]))

    def on_progress(lanes: float) -> None:
        bar.update(int(done + lanes) - bar.n)

    work.run(list(chunk_of), on_ended, devices=devices, on_progress=on_progress)
