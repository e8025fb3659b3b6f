"""The chunks of a sweep, handed to an executor.

Chunks are independent and may be computed more than once. So any executor with the interface of
`concurrent.futures.Executor` will do, and so will a client of Dask's distributed scheduler, which
gives the chunks of a worker that died to another. On one's own cores, in a script with the usual
``if __name__ == "__main__":`` ::

    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(4, mp_context=spawn) as executor: ...

and on a cluster::

    with dask.distributed.Client("tcp://scheduler:8786") as client: ...

What is computed travels by cloudpickle, so that closures and functions from notebooks will do, and
takes along this process's runtime settings (`clearjoint.configure`), which a worker process takes
over.
"""

import inspect
import io
import multiprocessing
import os
import pickle
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Future,
    ThreadPoolExecutor,
    wait,
)
from dataclasses import fields
from functools import cache, lru_cache, partial
from threading import Lock
from typing import Protocol

import cloudpickle
import equinox as eqx

from ..fields.checks import require
from ..runtime import adopt, in_force
from .layout import LaneArrays


def encoded(value: object) -> bytes:
    """A value as bytes that `pickle.loads` decodes, in another process."""
    file = io.BytesIO()
    _Pickler(file).dump(value)
    return file.getvalue()


class _Pickler(cloudpickle.Pickler):
    def reducer_override(self, value: object) -> object:
        """How cloudpickle rebuilds a function or a class; that of a module with its fields."""
        reduced = super().reducer_override(value)
        if reduced is NotImplemented or not isinstance(value, type):
            return reduced
        if not issubclass(value, eqx.Module):
            return reduced
        make, arguments, *state = reduced
        return (_with_fields, (make, arguments, _own_fields(value), _initialises(value)), *state)


def _own_fields(cls: type[eqx.Module]) -> dict[str, bool]:
    """The fields that a class adds to those it inherits, and whether they are static."""
    own = inspect.get_annotations(cls)
    return {f.name: f.metadata.get("static", False) for f in fields(cls) if f.name in own}


def _initialises(cls: type[eqx.Module]) -> bool:
    """Whether a class has an `__init__` of its own, written or made by equinox."""
    return "__init__" in vars(cls)


def _with_fields(
    make: Callable[..., type],
    arguments: tuple[object, ...],
    statics: Mapping[str, bool],
    initialises: bool,
) -> type:
    """The class that cloudpickle makes without attributes, with fields. It gets its attributes
    afterwards, among them an `__init__` where it has one."""
    constructor, name, bases, namespace, *rest = arguments
    assert isinstance(namespace, dict)
    declared = {name: eqx.field(static=static, default=None) for name, static in statics.items()}
    annotations = dict.fromkeys(statics, object)
    placeholder = {"__init__": _placeholder} if initialises else {}
    namespace = {**namespace, **placeholder, "__annotations__": annotations, **declared}
    return make(constructor, name, bases, namespace, *rest)


def _placeholder(self: object) -> None:
    """Stands for an `__init__` until the class has got its attributes."""


ChunkFunction = Callable[[int], LaneArrays]
"""From the number of a chunk to its results."""
RETRIES = 3
"""How often Dask repeats a chunk that raised an error before the sweep fails."""
TICK = 1.0
"""Seconds between two calls of `on_start`."""
QUEUED = 2
"""Chunks handed out for each worker: one that it computes and one that it finds waiting."""


class AbstractSubmitter(Protocol):
    """A `concurrent.futures.Executor` or a `dask.distributed.Client`."""

    def submit(self, function: Callable[..., object], /, *arguments: object) -> Future:
        """Have a function called elsewhere; a future of its result."""
        ...


class ChunkError(RuntimeError):
    """Chunks could not be computed. `chunks` are their numbers, `__cause__` is the first error.

    >>> error = cj.ChunkError("chunk 3 failed", chunks=(3,))
    >>> error.chunks
    (3,)
    """

    def __init__(self, message: str, chunks: tuple[int, ...] = ()):
        super().__init__(message)
        self.chunks = chunks


def run_chunks(
    task: ChunkFunction,
    chunks: Iterable[int],
    executor: AbstractSubmitter,
    on_done: Callable[[int, LaneArrays], None],
    on_start: Callable[[float], None] = lambda seconds: None,
) -> None:
    """Compute `task(chunk)` for every chunk and pass the results to `on_done(chunk, results)`.

    `on_done` is called in this thread, for one chunk at a time, in the order in which they end.
    Few chunks at a time are handed out, and none after an error. An interrupt (Ctrl-C) or an error
    of `on_done` cancels those that have not begun.

    **Arguments:**

    - `task`: computes the results of a chunk from its number. Each process decodes it once.
    - `chunks`: numbers of the chunks.
    - `executor`: a `concurrent.futures.Executor` or a `dask.distributed.Client`.
    - `on_done`: takes the results of a chunk.
    - `on_start`: is called every second until the first chunk has ended, with the seconds since the
      first was handed out.

    **Raises:** `ValueError` if `executor` is neither, or forks its processes. `ChunkError` if a
    chunk raises an error or its worker dies (with Dask: again and again), after the chunks already
    handed out have ended and `on_done` has got their results.
    """
    pool, waiting = _Pool(executor, task), deque(chunks)
    running: dict[Future, int] = {}
    failed: dict[int, BaseException] = {}
    done, begun = 0, time.monotonic()
    try:
        while running or (waiting and not failed):
            room = 0 if failed else pool.room() - len(running)
            for _ in range(min(room, len(waiting))):
                chunk = waiting.popleft()
                running[pool.submit(chunk)] = chunk
            ended = wait(running, None if done else TICK, return_when=FIRST_COMPLETED).done
            if not done and not ended:
                on_start(time.monotonic() - begun)
            for future in ended:
                chunk = running.pop(future)
                error = _error(future)
                if error is None:
                    on_done(chunk, future.result())
                    done += 1
                else:
                    failed[chunk] = error
    finally:
        for future in running:
            future.cancel()
    if failed:
        _fail(failed, done)


class _Pool:
    """An executor or a client of Dask, and the function that it calls."""

    def __init__(self, executor: AbstractSubmitter, task: ChunkFunction):
        _check(executor)
        make = getattr(executor, "get_executor", None)
        self._threads = getattr(executor, "nthreads", None)
        self._executor = executor if make is None else make(pure=False, retries=RETRIES)
        in_process = isinstance(executor, ThreadPoolExecutor)
        self._call = task if in_process else partial(_call, _payload(task))

    def room(self) -> int:
        """Number of chunks that may be handed out at a time. It changes as a cluster's workers come
        and go."""
        if self._threads is not None:
            workers = sum(self._threads().values())
        else:
            workers = getattr(self._executor, "_max_workers", None) or os.cpu_count() or 1
        return QUEUED * max(workers, 1)

    def submit(self, chunk: int) -> Future:
        """Hand out a chunk."""
        try:
            return self._executor.submit(self._call, chunk)
        except BrokenExecutor as error:
            broken = Future()
            broken.set_exception(error)
            return broken


def _check(executor: AbstractSubmitter) -> None:
    require(
        hasattr(executor, "submit"),
        "executor",
        executor,
        "a concurrent.futures.Executor or a dask.distributed.Client",
        "pass for example ProcessPoolExecutor(4, mp_context=multiprocessing.get_context('spawn'))",
    )
    context = getattr(executor, "_mp_context", None)
    require(
        context is None or context.get_start_method() != "fork",
        "executor",
        executor,
        "a pool whose processes are not forked, since JAX's threads do not survive a fork",
        "pass mp_context=multiprocessing.get_context('spawn') to the ProcessPoolExecutor",
    )


def _payload(task: ChunkFunction) -> bytes:
    """The runtime settings and the encoded function; a worker takes over the settings before it
    decodes the function."""
    return pickle.dumps((in_force(), encoded(task)))


_decoding = Lock()


@lru_cache(maxsize=1)
def _decoded(payload: bytes) -> ChunkFunction:
    _end_with_parent()
    values, task = pickle.loads(payload)
    adopt(values)
    return pickle.loads(task)


@cache
def _end_with_parent() -> None:
    """Let this process end when the one that began it has died. One that is killed can't tell its
    workers, which would wait for it without end."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _call(payload: bytes, chunk: int) -> LaneArrays:
    """Compute a chunk in a worker, one thread of which decodes the task for all."""
    with _decoding:
        task = _decoded(payload)
    try:
        return task(chunk)
    except Exception as error:
        if _travels(error):
            raise
        raise RuntimeError(f"{type(error).__name__}: {error}") from error


def _travels(error: Exception) -> bool:
    """Whether an error can be pickled and unpickled. Where it can't, as with classes of a script or
    constructors of several arguments, its arrival would break a pool of processes."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return False
    return True


def _error(future: Future) -> BaseException | None:
    if future.cancelled():
        return CancelledError("the executor cancelled it; has it been shut down?")
    return future.exception()


def _why_it_may_have_died(done: int) -> str:
    """Causes, the likeliest first: a worker that a script starts imports the script anew."""
    if done:
        return "killed, or out of memory"
    return (
        'none was computed: a script must run what it runs behind `if __name__ == "__main__":`, '
        "since each worker process imports it; or it was killed, or out of memory"
    )


def _fail(failed: dict[int, BaseException], done: int) -> None:
    chunks = tuple(sorted(failed))
    cause = next(iter(failed.values()))
    numbers = ", ".join(map(str, chunks))
    if isinstance(cause, BrokenExecutor):
        why = _why_it_may_have_died(done)
        what = f"A worker process died with chunks {numbers} handed out ({why})"
    else:
        what = f"Chunk {numbers} failed" if len(chunks) == 1 else f"Chunks {numbers} failed"
    raise ChunkError(
        f"{what}: {type(cause).__name__}: {cause}\nChunks completed in this call: {done}. A sweep "
        "with a `path` has stored them, and resumes when called again.",
        chunks,
    ) from cause
