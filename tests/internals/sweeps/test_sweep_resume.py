"""Sweeps interrupted, resumed, and handed to worker processes: always the same bits."""

import multiprocessing
import os
import shutil
import signal
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

import clearjoint as cj
from clearjoint._sweeps import computing
from clearjoint._sweeps import sweep as sweeping
from clearjoint._sweeps.computing import lane_progress
from clearjoint._sweeps.store.store import SweepStore
from clearjoint._sweeps.work import Work
from tests.internals.support.fake_sweep import layout
from tests.support.dask_workers import dask_client
from tests.support.processes import started
from tests.support.rotor import END, OUTPUTS, rotor, swept
from tests.support.slow import slow

STIFFNESS = np.linspace(1.0, 100.0, 20)
CHUNK = 3
FEW = {"turnings": OUTPUTS["turnings"]}
"""A class and a lambda of the tests' own, and little to compile in every worker."""
stored = partial(swept, STIFFNESS, chunk=CHUNK)
few_stored = partial(stored, outputs=FEW)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return stored(path=tmp_path_factory.mktemp("whole") / "sweep.zarr")


@pytest.fixture(scope="module")
def few(tmp_path_factory):
    return few_stored(path=tmp_path_factory.mktemp("few") / "sweep.zarr")


@pytest.fixture
def path(tmp_path):
    return tmp_path / "sweep.zarr"


def interrupted(path, chunks: int) -> None:
    """Sweep into a store until so many chunks are written."""

    def write(store, parts, write=SweepStore.write, left=[chunks]):  # noqa: B006
        first = dict(list(parts.items())[: left[0]])
        write(store, first)
        left[0] -= len(first)
        if len(first) < len(parts):
            raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(SweepStore, "write", write)
        stored(path=path)


@pytest.fixture
def computed(monkeypatch):
    """The lanes that each sweep computes."""
    lanes_of_calls = []

    def run(work, lanes, *args, run=Work.run, **options):
        lanes_of_calls.append(list(lanes))
        return run(work, lanes, *args, **options)

    monkeypatch.setattr(Work, "run", run)
    return lanes_of_calls


def test_interrupted_sweep_reads_as_partial_and_resumes_to_the_same_bits(path, whole, computed):
    interrupted(path, 4)
    partial_results = cj.open_sweep(path)
    done = partial_results.result.values == 0
    assert done.sum() == 4 * CHUNK
    assert set(partial_results.result.values[~done]) == {-1}
    for name in whole.data_vars:
        np.testing.assert_array_equal(partial_results[name][done], whole[name][done])
    assert np.isnan(partial_results.final_spin[~done]).all()

    computed.clear()
    xr.testing.assert_identical(stored(path=path), whole)
    assert computed == [np.flatnonzero(~done).tolist()]
    computed.clear()
    xr.testing.assert_identical(stored(path=path), whole)
    assert computed == []
    xr.testing.assert_identical(cj.open_sweep(path), whole)


def test_further_values_are_computed_and_no_others(path, few, computed):
    """Also if another function gives the path."""
    swept(STIFFNESS[2:19], chunk=CHUNK, outputs=FEW, path=path)
    other = cj.Axis(lambda here: here.forces["spring"].stiffness, STIFFNESS)
    options = {"path": path, "chunk": CHUNK, "zipped": True, "threads": 1, "progress": False}
    found = cj.sweep(*rotor(), END, {"stiffness": other}, FEW, **options)
    assert computed == [list(range(17)), [0, 1, 19]]
    for name in few.data_vars:
        np.testing.assert_array_equal(found[name], few[name])
    xr.testing.assert_identical(cj.open_sweep(path), found)


def test_names_of_notes_have_neither_quotes_nor_slashes():
    """Nor have those in netCDF of format 3."""
    noted = layout(notes={"output a/b of 'arm' ": "x"})
    assert list(noted.notes) == ["output a_b of _arm_"]
    alike = layout(notes={"a'b": "1", "a_b": "2", "a/b": "3"})
    assert alike.notes == {"a_b": "1", "a_b (2)": "2", "a_b (3)": "3"}
    assert layout(notes=alike.notes).notes == alike.notes


def test_a_sweep_that_is_interrupted_stores_the_lanes_that_have_ended(path, few, monkeypatch):
    """Ctrl-C between two segments, while a third one runs."""

    def interrupted(bar, running):
        assert running.lanes <= len(STIFFNESS) and running.earliest <= running.latest
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(computing, "show_running", interrupted)
    with pytest.raises(KeyboardInterrupt):
        few_stored(path=path)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    done = cj.open_sweep(path)
    assert (done["result"] == 0).any()
    with xr.open_zarr(path, chunks=None) as plain:
        xr.testing.assert_equal(plain, done)
    monkeypatch.undo()
    xr.testing.assert_identical(few_stored(path=path), few)


def test_lanes_of_chunks_that_are_not_complete_are_stored_too(monkeypatch):
    """At once, unless that would take too large a share of the time. Complete chunks are written
    in any case, all of them together."""
    written = []

    def write(parts):
        written.append({chunk: list(lanes) for chunk, (lanes, _) in parts.items()})
        now[0] += 1.0

    now = [100.0]
    monkeypatch.setattr(computing.time, "monotonic", lambda: now[0])
    with lane_progress(12, 0, False) as bar:
        lanes = {k: range(3 * k, 3 * k + 3) for k in range(4)}
        writer = computing._Writer(lanes, SimpleNamespace(write=write), bar)
        add = lambda *lanes: writer.add(np.array(lanes), {"result": np.zeros(len(lanes))})  # noqa: E731
        add(0, 3, 4, 6)
        assert written == [{0: [0], 1: [3, 4], 2: [6]}]
        add(1, 2, 5, 7)
        assert written[1:] == [{0: [1, 2], 1: [5]}]
        now[0] += 1.0 / computing.WRITE_SHARE
        writer.write_if_due()
        assert written[2:] == [{2: [7]}]


@pytest.mark.parametrize("error", [KeyboardInterrupt, slow(TimeoutError)])
def test_lanes_whose_writing_is_interrupted_are_written_at_the_end(path, few, error):
    """As by a second Ctrl-C, or by a time limit."""
    left = [error]

    def write(store, parts, write=SweepStore.write):
        if left:
            raise left.pop()
        write(store, parts)

    with pytest.MonkeyPatch.context() as patch, pytest.raises(error):
        patch.setattr(SweepStore, "write", write)
        few_stored(path=path)
    assert (cj.open_sweep(path)["result"] == 0).any()
    xr.testing.assert_identical(few_stored(path=path), few)


KILLED_AT_ANY_MOMENT = """
import sys, time
import clearjoint
import tests.conftest
clearjoint.configure()
from tests.internals.sweeps.test_sweep_resume import long_lanes
from clearjoint._sweeps import computing
add = computing._Writer.add
def report(writer, lanes, results):
    for lane in lanes:
        print(lane, time.monotonic(), flush=True)
    add(writer, lanes, results)
computing._Writer.add = report
long_lanes(sys.argv[1])
"""


def long_lanes(path):
    """Eighty lanes, the slowest of which take several seconds, in chunks of eight."""
    return swept(np.geomspace(1.0, 1e4, 80), chunk=8, outputs=FEW, end_time=300.0, path=path)


@pytest.mark.slow
def test_killed_at_any_moment_a_sweep_loses_the_lanes_of_the_last_second(path):
    """Longer on a machine with much else to do."""
    rng = np.random.default_rng()
    for _ in range(10):
        with started(KILLED_AT_ANY_MOMENT, path) as process:
            first = process.stdout.readline()
            time.sleep(rng.uniform(0.0, 4.0))
            process.kill()
            killed = time.monotonic()
            ended = ended_lanes([first, *process.stdout])
        codes = cj.open_sweep(path)["result"].values
        lost = {lane: killed - at for lane, at in ended.items() if codes[lane] != 0}
        assert all(age < 2.0 for age in lost.values()), lost
        if not (codes < 0).any():
            shutil.rmtree(path)
    found = long_lanes(path)
    xr.testing.assert_identical(found, long_lanes(path.with_name("whole.zarr")))


def ended_lanes(lines):
    """When each lane was handed to the writer, in s of the system's clock, by its number."""
    pairs = [line.split() for line in lines if line.endswith("\n")]
    return {int(lane): float(at) for lane, at in pairs}


@pytest.mark.slow
def test_a_process_that_is_interrupted_stores_what_had_ended_and_ends_in_order(path):
    """Not by a segmentation fault, as if a device still computed."""
    with started(KILLED_AT_ANY_MOMENT, path) as process:
        first = process.stdout.readline()
        process.send_signal(signal.SIGINT)
        ended = ended_lanes([first, *process.stdout])
    assert process.returncode == -signal.SIGINT
    codes = cj.open_sweep(path)["result"].values
    assert (codes < 0).any() and set(np.flatnonzero(codes == 0)) == set(ended)


@pytest.mark.slow
def test_executor_of_processes_computes_the_same_bits(few, path):
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=spawn) as executor:
        xr.testing.assert_identical(few_stored(path=path, executor=executor), few)


@pytest.mark.slow
def test_dask_gives_the_chunk_of_a_killed_worker_to_another(few, tmp_path, path, monkeypatch):
    monkeypatch.setattr(sweeping, "Work", dying(tmp_path))
    with dask_client(tmp_path / "dask") as client:
        found = few_stored(path=path, executor=client)
    assert (tmp_path / "died").exists()
    xr.testing.assert_identical(found, few)


def dying(folder: Path) -> type[Work]:
    """Work whose process is killed in the middle of chunk 4, the first time."""

    class Dying(Work):
        def _results(self, ended):
            if 4 * CHUNK + 1 in ended.lanes and not (folder / "died").exists():
                (folder / "died").touch()
                os.kill(os.getpid(), signal.SIGKILL)
            return super()._results(ended)

    return Dying
