"""Computation of the chunks of a sweep on an executor.

The function that computes a chunk is sent to workers with the runtime settings of this process
(`clearjoint.configure`), by cloudpickle, which supports closures and functions from notebooks.
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
from concurrent import futures
from concurrent.futures import Future
from dataclasses import fields
from functools import cache, lru_cache, partial
from threading import Lock
from typing import Protocol

import cloudpickle
import equinox as eqx
from typing_extensions import override

from .._fields.checks import require
from .._runtime import adopt, in_force
from .outputs import LaneArrays


class _Pickler(cloudpickle.Pickler):
    """Pickler that also supports equinox modules that are defined in scripts and notebooks."""

    @override
    def reducer_override(self, value: object) -> object:
        # To restore a class from a script or notebook, cloudpickle first makes it without
        # attributes, and sets these afterwards. An equinox module needs its fields when it is made,
        # because its metaclass turns it into a dataclass at that time.
        reduced = super().reducer_override(value)
        # `NotImplemented` stands for objects that are pickled as usual, such as imported classes.
        if reduced is NotImplemented or not isinstance(value, type):
            return reduced
        if not issubclass(value, eqx.Module):
            return reduced
        # `make(*arguments)` makes the class, and `state` has the attributes to set afterwards.
        make, arguments, *state = reduced
        # Inherited fields, which `fields` returns too, come from the base classes.
        annotated = inspect.get_annotations(value)
        statics = {
            f.name: f.metadata.get("static", False) for f in fields(value) if f.name in annotated
        }
        return (_with_fields, (make, arguments, statics, "__init__" in vars(value)), *state)


def _with_fields(
    make: Callable[..., type],
    arguments: tuple[object, ...],
    statics: Mapping[str, bool],
    initialises: bool,
) -> type:
    """Make an equinox class by `make`, a function of cloudpickle, and its `arguments`. The class
    has fields already before cloudpickle sets its attributes. `statics`: by name of the field,
    whether it is static; `initialises`: whether the class defines `__init__`."""
    # The fields defined here are provisional: cloudpickle sets the class's own attributes
    # afterwards. The defaults allow the fields to follow inherited ones that have defaults. With
    # the placeholder, equinox does not generate an `__init__`.
    constructor, name, bases, namespace, *rest = arguments
    assert isinstance(namespace, dict)
    declared = {name: eqx.field(static=static, default=None) for name, static in statics.items()}
    annotations = dict.fromkeys(statics, object)
    placeholder = {"__init__": lambda self: None} if initialises else {}
    namespace = {**namespace, **placeholder, "__annotations__": annotations, **declared}
    return make(constructor, name, bases, namespace, *rest)


ChunkFunction = Callable[[int], LaneArrays]
"""Function of the index of a chunk that returns the results of the chunk's lanes."""
RETRIES = 3
"""Number of times that Dask repeats a chunk that raises an error."""
TICK = 1.0
"""Time between two calls of the argument `on_start` of `run_chunks`, s."""
QUEUED = 2
"""Number of chunks submitted for each worker, which can then begin its next chunk at once."""


class AbstractSubmitter(Protocol):
    """Interface of executors: a `concurrent.futures.Executor` or a `dask.distributed.Client`."""

    def submit(self, function: Callable[..., object], /, *arguments: object) -> Future: ...


class ChunkError(RuntimeError):
    """Error of chunks of a sweep that an executor could not compute. `chunks` are their indices;
    the error's cause is the first error.

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

    `on_done` is called in this thread, for one chunk at a time, in the order in which chunks end.
    Only a few chunks at a time are submitted, and none after an error. Until the first result,
    `on_start` is called every second with the time since the start, s.

    **Raises:** `ValueError` if `executor` has another type, or forks its processes. `ChunkError`,
    after the chunks already submitted have ended, if a chunk raises an error, its worker dies (with
    Dask: repeatedly), or the executor cancels it.
    """
    pool, waiting = _Pool(executor, task), deque(chunks)
    running: dict[Future, int] = {}
    failed: dict[int, BaseException] = {}
    done, started = 0, time.monotonic()
    try:
        while running or (waiting and not failed):
            free = 0 if failed else pool.room() - len(running)
            for _ in range(min(free, len(waiting))):
                chunk = waiting.popleft()
                running[pool.submit(chunk)] = chunk
            # Until the first result, return every `TICK` to call `on_start`.
            timeout = None if done else TICK
            ended = futures.wait(running, timeout, return_when=futures.FIRST_COMPLETED).done
            if not done and not ended:
                on_start(time.monotonic() - started)
            for future in ended:
                chunk = running.pop(future)
                if future.cancelled():
                    text = "the executor cancelled it; has it been shut down?"
                    failed[chunk] = futures.CancelledError(text)
                elif (error := future.exception()) is not None:
                    failed[chunk] = error
                else:
                    on_done(chunk, future.result())
                    done += 1
    finally:
        # Chunks are left here only after an interrupt or an error of `on_done`.
        for future in running:
            future.cancel()
    if failed:
        _fail(failed, done)


class _Pool:
    """An executor or a Dask client, with the function that its workers call for each chunk."""

    def __init__(self, executor: AbstractSubmitter, task: ChunkFunction):
        remedy = "pass ProcessPoolExecutor(4, mp_context=multiprocessing.get_context('spawn'))"
        expected = "a concurrent.futures.Executor or a dask.distributed.Client"
        require(hasattr(executor, "submit"), "executor", executor, expected, remedy)
        # A forked process has copies of the locks that JAX's threads hold, but not the threads, so
        # it would wait forever.
        context = getattr(executor, "_mp_context", None)  # only pools of processes have one
        survives = context is None or context.get_start_method() != "fork"
        expected = "a pool of processes that are not forked, since JAX's threads don't survive that"
        require(survives, "executor", executor, expected, remedy)
        self._threads = getattr(executor, "nthreads", None)  # only Dask's clients have it
        # A Dask client keeps the result of a task and returns it for an equal task, unless the task
        # is declared impure.
        make = getattr(executor, "get_executor", None)
        self._executor = executor if make is None else make(pure=False, retries=RETRIES)
        # Threads call the function itself; processes get its pickled form.
        in_process = isinstance(executor, futures.ThreadPoolExecutor)
        self._call = task if in_process else partial(_call, _payload(task))

    def room(self) -> int:
        """Return how many submitted chunks may be unfinished: `QUEUED` per process or thread."""
        if self._threads is not None:  # of Dask; the number of workers of a cluster may change
            workers = sum(self._threads().values())
        else:
            workers = getattr(self._executor, "_max_workers", None) or os.cpu_count() or 1
        return QUEUED * max(workers, 1)

    def submit(self, chunk: int) -> Future:
        """Return the future of a chunk; it has the error if the executor is broken or shut down."""
        try:
            return self._executor.submit(self._call, chunk)
        except RuntimeError as error:  # also a `BrokenExecutor`
            failed = Future()
            failed.set_exception(error)
            return failed


def _payload(task: ChunkFunction) -> bytes:
    """Return the runtime settings of this process and the pickled function, as bytes."""
    file = io.BytesIO()
    _Pickler(file).dump(task)
    # Encoded separately, because a worker adopts the settings before it decodes the function.
    return pickle.dumps((in_force(), file.getvalue()))


_decoding = Lock()


@lru_cache(maxsize=1)
def _decoded(payload: bytes) -> ChunkFunction:
    """Adopt the runtime settings in the bytes of `_payload`, and return the function."""
    _end_with_parent()
    values, task = pickle.loads(payload)
    adopt(values)
    return pickle.loads(task)


@cache
def _end_with_parent() -> None:
    """Let this process end when its parent process dies: a parent that is killed can't stop its
    workers, which would wait forever."""
    parent = multiprocessing.parent_process()
    if parent is None:  # not started by `multiprocessing`, for example a worker of a Dask cluster
        return

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _call(payload: bytes, chunk: int) -> LaneArrays:
    with _decoding:  # One thread decodes the task, and the others take it from the cache.
        task = _decoded(payload)
    try:
        return task(chunk)
    except Exception as error:
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:
            # An error that can't be unpickled, for example one whose constructor takes several
            # arguments, would break the pool of processes in the parent.
            raise RuntimeError(f"{type(error).__name__}: {error}") from error
        raise


def _fail(failed: dict[int, BaseException], done: int) -> None:
    chunks = tuple(sorted(failed))
    cause = next(iter(failed.values()))
    numbers = ", ".join(map(str, chunks))
    guard = (
        'a script must call the sweep below `if __name__ == "__main__":`, because each worker '
        "process imports the script"
    )
    if isinstance(cause, futures.BrokenExecutor):
        why = "killed, or out of memory"
        # If workers die before the first result, the usual cause is a script without that line.
        if not done:
            why = f"no chunk was computed: {guard}; or the process was {why}"
        problem = f"A worker process died while chunks {numbers} were submitted ({why})"
    elif getattr(multiprocessing.current_process(), "_inheriting", False):
        # This process is a worker that imports the script, and can't start workers of its own.
        problem = f"A worker process called the sweep again: {guard}"
    else:
        problem = f"Chunk {numbers} failed" if len(chunks) == 1 else f"Chunks {numbers} failed"
    raise ChunkError(
        f"{problem}: {type(cause).__name__}: {cause}\nChunks completed in this call: {done}. A "
        "sweep with a `path` has stored them, and resumes when it is called again.",
        chunks,
    ) from cause
