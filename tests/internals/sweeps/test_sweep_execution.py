"""Chunks on executors: local processes and Dask's workers, some of which die."""

import multiprocessing
import os
import signal
import threading
import time
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import equinox as eqx
import jax
import numpy as np
import psutil
import pytest

import clearjoint as cj
from clearjoint import ChunkError, open_sweep
from clearjoint._native import is_native
from clearjoint._runtime import threads_of_sweeps
from clearjoint._sweeps import computing, executors
from clearjoint._sweeps.computing import lane_progress
from clearjoint._sweeps.executors import QUEUED, RETRIES, run_chunks
from clearjoint._sweeps.outputs import Coordinate
from clearjoint._sweeps.store.store import SweepMemory
from clearjoint.extend import quantity
from tests.internals.support.fake_sweep import complete, identical, layout, opened, results
from tests.support.dask_workers import dask_client
from tests.support.processes import printed, started
from tests.support.slow import slow

SPAWN = multiprocessing.get_context("spawn")
MANY = layout(axes=(Coordinate("clearance", np.linspace(1e-4, 1e-3, 58), "m"),))
"""Twelve chunks of five lanes, the last of three."""


def results_of(chunk: int):
    return results(MANY, range(*MANY.span(chunk).indices(MANY.lanes)))


def write(store, chunk: int, arrays) -> None:
    store.write({chunk: (store.missing()[chunk], arrays)})


@pytest.fixture(scope="module")
def processes():
    with ProcessPoolExecutor(1, mp_context=SPAWN) as executor:
        yield executor


@pytest.fixture(scope="module")
def two_dask_workers(tmp_path_factory):
    with dask_client(tmp_path_factory.mktemp("dask")) as client:
        yield client


@pytest.fixture
def store(tmp_path):
    return opened(tmp_path / "sweep.zarr", MANY)


def swept(task, executor, store) -> None:
    run_chunks(task, store.missing(), executor, partial(write, store))


def identical_to_uninterrupted(store) -> None:
    identical(open_sweep(store.path), complete(store.layout))


class Decoded:
    """Makes a file in a folder whenever it is decoded."""

    def __init__(self, folder: Path):
        self.folder = folder

    def __setstate__(self, state):
        self.__dict__.update(state)
        (self.folder / f"{os.getpid()} {time.monotonic_ns()}").touch()


def test_a_process_computes_a_closure_that_it_decodes_once(processes, store, tmp_path):
    (tmp_path / "decoded").mkdir()
    decoded = Decoded(tmp_path / "decoded")
    swept(lambda chunk: decoded and results_of(chunk), processes, store)
    identical_to_uninterrupted(store)
    pids = [file.name.split()[0] for file in (tmp_path / "decoded").iterdir()]
    assert len(pids) == 1 and pids != [str(os.getpid())]


def settings(chunk):
    """What is in force where it runs, and the process."""
    folder = jax.config.jax_compilation_cache_dir
    words = np.array([str(jax.numpy.zeros(1).dtype), str(is_native()), folder])
    threads = np.array(threads_of_sweeps())
    return {"words": words, "pid": np.array(os.getpid()), "threads": threads}


@pytest.mark.parametrize("kind", ["processes", slow("two_dask_workers")])
def test_workers_get_the_settings_of_this_process(kind, request):
    found = {}
    run_chunks(settings, [0], request.getfixturevalue(kind), found.__setitem__)
    here = ["float64", "True", jax.config.jax_compilation_cache_dir]
    assert found[0]["words"].tolist() == here
    assert found[0]["pid"] != os.getpid()
    assert found[0]["threads"] == 1


def failing(chunk):
    if chunk == 1:
        raise FloatingPointError("lane 7 ran away")
    time.sleep(0.1)
    return results_of(chunk)


@pytest.mark.parametrize("kind", ["processes", "threads"])
def test_error_in_a_chunk_is_named_and_the_others_are_kept(kind, processes, store):
    with ThreadPoolExecutor(2) as threads:
        executor = threads if kind == "threads" else processes
        with pytest.raises(ChunkError, match=r"Chunk 1 failed.*lane 7 ran away") as raised:
            swept(failing, executor, store)
        assert "resumes" in str(raised.value)
        assert isinstance(raised.value.__cause__, FloatingPointError)
        assert raised.value.chunks == (1,)
        missing = store.missing()
        # The one process ends with the failed chunk; of two threads, the other one goes on.
        kept = {0, 2, 3} if kind == "threads" else {0}
        assert kept.isdisjoint(missing) and {1, 11} <= set(missing)
        begun = []
        swept(lambda chunk: begun.append(chunk) or results_of(chunk), threads, store)
    assert sorted(begun) == list(missing)
    identical_to_uninterrupted(store)


def killing_itself(folder: Path):
    """A task whose process dies of chunk 3, the first time."""

    def task(chunk):
        if chunk == 3 and not (folder / "died").exists():
            (folder / "died").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return results_of(chunk)

    return task


def test_broken_pool_is_reported_and_another_one_resumes(store, tmp_path, processes):
    with ProcessPoolExecutor(1, mp_context=SPAWN) as executor:
        with pytest.raises(ChunkError, match="worker process died") as raised:
            swept(killing_itself(tmp_path), executor, store)
        assert isinstance(raised.value.__cause__, BrokenProcessPool)
        assert "resumes" in str(raised.value)
        assert 3 in raised.value.chunks and 3 in store.missing()
        with pytest.raises(ChunkError, match="worker process died"):
            swept(failing, executor, store)
    swept(killing_itself(tmp_path), processes, store)
    identical_to_uninterrupted(store)


UNGUARDED = """
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from clearjoint._sweeps.executors import ChunkError, run_chunks

with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as executor:
    try:
        run_chunks(abs, [0], executor, print)
    except ChunkError as error:
        print(error)
"""


@pytest.mark.slow
def test_script_without_a_main_guard_gets_the_remedy(tmp_path):
    """A worker imports the script, and would begin workers of its own."""
    (tmp_path / "script.py").write_text(UNGUARDED)
    assert 'below `if __name__ == "__main__":`' in printed(tmp_path / "script.py")


FORKED = """
import multiprocessing, sys
import clearjoint
from tests.support.rotor import swept

clearjoint.configure()

def child():
    try:
        swept([1.0, 2.0], path=sys.argv[1])
    except ValueError as error:
        print(error)

process = multiprocessing.get_context("fork").Process(target=child)
process.start()
process.join()
"""


@pytest.mark.slow
def test_a_stored_sweep_in_a_forked_process_is_refused(tmp_path):
    """It would wait forever for threads of its parent."""
    path = tmp_path / "sweep.zarr"
    said = printed(FORKED, path)
    assert "`path` must be None in a process that was forked" in said
    assert "multiprocessing.get_context('spawn')" in said and not path.exists()


KILLED = """
import os, sys, threading, time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
sys.path.insert(0, ".")
from clearjoint._sweeps.executors import run_chunks

def task(chunk):
    print(os.getpid(), flush=True)
    time.sleep(0 if chunk == 0 else 600)

if __name__ == "__main__":
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as executor:
        run_chunks(task, range(4), executor, lambda *done: print("stored", flush=True))
"""


@pytest.mark.slow
def test_workers_of_a_process_that_is_killed_end_too(tmp_path):
    """After the first chunk."""
    (tmp_path / "script.py").write_text(KILLED)
    with started(tmp_path / "script.py") as process:
        lines = [process.stdout.readline().strip() for _ in range(4)]
        process.kill()
        assert process.stdout.read() == ""  # It ends when no process is left that can write.
    pids = [int(line) for line in lines if line != "stored"]
    assert "stored" in lines and len(set(pids)) == 2
    for pid in filter(psutil.pid_exists, pids):
        assert psutil.Process(pid).status() == psutil.STATUS_ZOMBIE


def test_a_pool_says_that_it_starts_and_compiles(caplog, monkeypatch):
    monkeypatch.setattr(executors, "TICK", 0.01)
    monkeypatch.setattr(computing, "LONG_START", 0.05)

    def task(chunk):
        time.sleep(0.2)
        return results_of(chunk)

    memory = SweepMemory(MANY)
    task.lanes = memory.missing()  # as `Chunks` has them
    with ThreadPoolExecutor(2) as threads, lane_progress(MANY.lanes, 0, False) as bar:
        computing._by_executor(task, memory, threads, bar)
    assert [record.getMessage() for record in caplog.records] == [
        "the workers of a sweep have been starting and compiling for 0 s"
    ]
    identical(memory.dataset(), complete(MANY))


class OwnError(Exception):
    """It can be pickled, but not be made anew of its message alone."""

    def __init__(self, message: str, lane: int):
        super().__init__(f"{message} in lane {lane}")


def test_error_that_does_not_travel_is_named_and_breaks_no_pool(processes):
    class LocalError(Exception):
        """No other process finds its class."""

    def two_arguments(chunk):
        raise OwnError("it ran away", chunk)

    def local(chunk):
        raise LocalError(f"it ran away in lane {chunk}")

    for task, name in ((two_arguments, "OwnError"), (local, "LocalError")):
        with pytest.raises(ChunkError, match=f"RuntimeError: {name}: it ran away in lane 7"):
            run_chunks(task, [7], processes, print)


def modules_of_ones_own() -> dict[str, eqx.Module]:
    """Of classes that, as those of a script or a notebook, no other process can import."""

    class Count(eqx.Module):
        weight: Any = 2.0
        kind: ClassVar[str] = "none"
        name: str = eqx.field(static=True, default="count")

        def total(self):
            return self.weight

    class Shifted(Count):
        shift: Any = quantity("m", default=0.5)
        name: Any = "no longer static"

        def total(self):
            return super().total() + self.shift

    class Made(Shifted):
        def __init__(self, weight):
            self.weight, self.shift, self.name = weight, 2 * weight, 0.0

    class MadeAsWell(Made):
        def total(self):
            return Made(1.0).total() + super().total()

    class Law(cj.laws.Hertz):
        factor: Any = quantity("1", default=1.0)

        def elastic_force(self, *arguments):
            return self.factor * super().elastic_force(*arguments)

    return {
        "default replaced": Count(5.0, "tally"),
        "inherited": Shifted(1.0, name=4.0),
        "own start": Made(1.5),
        "inherited start": MadeAsWell(2.5),
        "law": Law(6e10, factor=3.0),
    }


def summary(modules) -> dict[str, np.ndarray]:
    """What JAX finds in them, also after it has taken them apart."""
    found = {}
    for name, module in modules.items():
        leaves, structure = jax.tree.flatten(module)
        again = jax.tree.unflatten(structure, [2.0 * leaf for leaf in leaves])
        paths = [jax.tree_util.keystr(path) for path, _ in jax.tree.leaves_with_path(module)]
        found[name] = np.array([*leaves, *jax.tree.leaves(again)], dtype=float)
        found[f"{name}, paths"] = np.array(paths)
        values = [value for m in (module, again) for value in vars(m).values()]
        found[f"{name}, fields"] = np.array([str(value) for value in values])
        if hasattr(module, "total"):
            found[f"{name}, total"] = np.array([module.total(), again.total()])
    return found


def test_fields_of_classes_of_ones_own_arrive(processes):
    modules, found = modules_of_ones_own(), {}
    run_chunks(lambda chunk: summary(modules), [0], processes, found.__setitem__)
    expected = summary(modules)
    assert set(found[0]) == set(expected)
    for name, values in expected.items():
        np.testing.assert_array_equal(found[0][name], values, err_msg=name)


class Counting(Executor):
    """Threads that know how many tasks they have been given ahead of those that ended."""

    _max_workers = 2

    def __init__(self):
        self._threads, self.ended, self.ahead, self.submitted = ThreadPoolExecutor(2), 0, [], 0

    def submit(self, fn, /, *args, **kwargs) -> Future:
        self.submitted += 1
        self.ahead.append(self.submitted - self.ended)
        return self._threads.submit(fn, *args, **kwargs)


def test_few_chunks_are_handed_out_at_a_time(store):
    executor = Counting()

    def on_done(chunk, arrays):
        executor.ended += 1
        write(store, chunk, arrays)

    run_chunks(lambda chunk: results_of(chunk), store.missing(), executor, on_done)
    assert max(executor.ahead) == QUEUED * 2
    identical_to_uninterrupted(store)


def test_interrupt_cancels_what_waits_and_leaves_what_is_stored(store):
    begun, release = [], threading.Event()

    def task(chunk):
        begun.append(chunk)
        if chunk > 0:
            release.wait(10)
        return results_of(chunk)

    def interrupted(chunk, arrays):
        write(store, chunk, arrays)
        raise KeyboardInterrupt

    with ThreadPoolExecutor(2) as executor:
        with pytest.raises(KeyboardInterrupt):
            run_chunks(task, store.missing(), executor, interrupted)
        release.set()
    assert list(store.missing()) == list(range(1, 12))
    assert {0, 1} <= set(begun) <= {0, 1, 2}


def test_forking_pools_are_refused():
    fork = multiprocessing.get_context("fork")
    with (
        ProcessPoolExecutor(2, mp_context=fork) as executor,
        pytest.raises(ValueError, match=r"mp_context=multiprocessing.get_context\('spawn'\)"),
    ):
        run_chunks(failing, [0], executor, print)


def test_an_executor_that_has_been_shut_down_is_named(store):
    executor = ThreadPoolExecutor(1)

    def on_done(chunk, arrays):
        write(store, chunk, arrays)
        executor.shutdown()

    with pytest.raises(ChunkError, match="after shutdown\nChunks completed in this call: 2"):
        run_chunks(results_of, store.missing(), executor, on_done)


@pytest.mark.slow
def test_dask_repeats_a_chunk_that_failed(two_dask_workers, store, tmp_path):
    def task(chunk):
        attempt = tmp_path / f"{chunk} {time.monotonic_ns()}"
        attempt.touch()
        if chunk == 7 or len(list(tmp_path.glob(f"{chunk} *"))) == 1:
            raise FloatingPointError("lane 7 ran away")
        return results_of(chunk)

    with pytest.raises(ChunkError, match="Chunk 7 failed: FloatingPointError: lane 7"):
        swept(task, two_dask_workers, store)
    assert len(list(tmp_path.glob("7 *"))) == 1 + RETRIES
    assert {7} <= set(store.missing()) <= {7, 8, 9, 10, 11}
