"""The store of a sweep: labels, resuming, refusals, and kill -9 at any moment."""

import errno
import fcntl
import os
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import zarr

from clearjoint import open_sweep
from clearjoint._sweeps.outputs import Coordinate
from clearjoint._sweeps.store import chunks, metadata
from clearjoint._sweeps.store import store as store_module
from clearjoint._sweeps.store.metadata import contents_of, create
from clearjoint._sweeps.store.program import RUN, Identity, row_digests
from clearjoint._sweeps.store.store import SweepMemory, SweepStore
from tests.internals.support.fake_sweep import (
    by_lane,
    complete,
    compute,
    contents,
    identical,
    layout,
    opened,
    results,
    written,
)
from tests.support.processes import started

pytestmark = pytest.mark.filterwarnings("error")
MIDDLE = {1: [5, 6, 7, 8, 9]}
"""The second chunk and its lanes."""


@pytest.fixture
def path(tmp_path):
    return tmp_path / "sweep.zarr"


@pytest.fixture
def partial(path):
    """A store of which the second of three chunks is missing."""
    store = opened(path, layout())
    compute(store, (0, 2))
    return store


@pytest.mark.parametrize("changes", [{}, {"zipped": True, "axes": (Coordinate("c", range(7)),)}])
def test_store_gives_back_what_memory_does(path, changes):
    store = opened(path, layout(**changes))
    assert list(store.missing()) == list(range(store.layout.chunks))
    for chunk, lanes in reversed(store.missing().items()):
        store.write({chunk: (lanes, results(store.layout, lanes))})
    assert store.missing() == {}
    identical(store.dataset(), complete(layout(**changes)))
    identical(open_sweep(path), complete(layout(**changes)))


def test_pending_lanes_say_so(partial, path):
    memory = SweepMemory(layout())
    compute(memory, (0, 2))
    assert memory.missing() == partial.missing() == MIDDLE
    found = open_sweep(path)
    identical(found, memory.dataset())
    lanes = by_lane(found)
    assert lanes["result"].values.tolist() == [1, 0, 0, 1, 0, *[-1] * 5, 0, 0]
    assert np.isnan(lanes["position"].isel(lane=slice(5, 10))).all()
    assert (lanes["steps"].isel(lane=slice(5, 10)) == -1).all()
    assert found["result"].attrs["flag_values"] == [-1, 0, 1]
    assert found["result"].attrs["flag_meanings"] == "pending successful max_steps_reached"


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("options", [{}, {"consolidated": False}])
def test_plain_xarray_opens_the_labelled_grid(partial, path, options):
    """Before and after further values have come in between, and while some are pending."""
    partial.write_grid()
    plainly_the_same(path, options)
    axes = (layout().axes[0], Coordinate("restitution", [0.1, 0.3, 0.5, 0.9, 0.95]))
    further = opened(path, layout(axes=axes))
    plainly_the_same(path, options)
    compute(further)
    further.write_grid()
    plainly_the_same(path, options)


def plainly_the_same(path, options):
    with xr.open_zarr(path, chunks=None, **options) as found:
        expected = open_sweep(path)
        assert dict(found.sizes) == dict(expected.sizes)
        xr.testing.assert_equal(found, expected)
        assert found["position"].attrs == expected["position"].attrs
        assert found.attrs == expected.attrs


def test_the_grid_is_written_while_the_store_is_filled(path, monkeypatch):
    monkeypatch.setattr(store_module, "GRID_PERIOD", 0.0)
    monkeypatch.setattr(store_module, "GRID_SHARE", np.inf)
    compute(opened(path, layout()), (0,))
    assert (xr.open_zarr(path, chunks=None)["result"] >= 0).sum() == 5


def test_half_written_chunk_stays_pending(partial, path, monkeypatch):
    """Whatever is on disk of a chunk, without its mark it reads as if nothing were."""
    before = open_sweep(path)

    def killed(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(store_module, "_flush", killed)
        with pytest.raises(KeyboardInterrupt):
            compute(partial)
    assert (path / "by_lane" / "position" / "c" / "1").exists()
    assert opened(path, layout()).missing() == MIDDLE
    identical(open_sweep(path), before)
    compute(partial)
    identical(open_sweep(path), complete(layout()))


def test_writing_a_chunk_again_changes_no_byte(partial, path):
    before = contents(path)
    opened(path, layout()).write({0: (range(5), results(partial.layout, range(5)))})
    assert contents(path) == before


def test_writing_a_chunk_touches_no_file_of_another(partial, path):
    files = [file for file in path.rglob("c/**/*") if file.is_file()]
    before = written(path)
    compute(partial)
    after = written(path)
    assert [file for file in files if after[file] != before[file]] == []


OTHER = np.where(np.arange(4) == 2, 7.5e-4, layout().axes[0].values)
LOST = (
    "lanes: 3 of 12 stored lanes are not among the {} present lanes, because the numbers at their "
    "start differ, first lane 6"
)
DIFFERENT = {
    "setting": ({"settings": {"rtol": "1e-08"}}, ["setting rtol: stored 1e-06, now 1e-08"]),
    "new setting": ({"settings": {"order": "5"}}, ["setting order: stored nothing, now 5"]),
    "values": (
        {"axes": (Coordinate("clearance", OTHER, "m"), layout().axes[1])},
        [
            "axis clearance: 1 of 4 stored values are not among the 4 present values, first 0.0007",
            LOST.format(12),
        ],
    ),
    "count": (
        {"axes": (Coordinate("clearance", OTHER[[0, 1, 3]], "m"), layout().axes[1])},
        [
            "axis clearance: 1 of 4 stored values are not among the 3 present values, first 0.0007",
            LOST.format(9),
        ],
    ),
    "unit": (
        {"axes": (layout().axes[0]._replace(unit="mm"), layout().axes[1])},
        ["unit of axis clearance: stored m, now mm"],
    ),
    "chunk": ({"chunk": 4}, ["lanes in a chunk: stored 5, now 4"]),
    "variable": (
        {"variables": {n: v for n, v in layout().variables.items() if n != "touched"}},
        ["variable touched: stored bool (lane), long_name , units 1, now nothing"],
    ),
    "coordinate": (
        {"coordinates": (Coordinate("time", np.arange(5.0), "s"), layout().coordinates[1])},
        ["coordinate time: 4 of 5 values differ, first number 1: stored 0.125, now 1.0"],
    ),
    "notes": (
        {"settings": {"rtol": "1e-08"}, "notes": {"law": "Hertz", "new": "1"}},
        ["setting rtol: stored 1e-06, now 1e-08", "law: stored linear, now Hertz"],
    ),
}


@pytest.mark.parametrize("changes, message", DIFFERENT.values(), ids=DIFFERENT)
def test_store_of_another_sweep_is_refused(path, changes, message):
    compute(opened(path, layout(notes={"law": "linear"})), (0, 2))
    before = contents(path)
    if "settings" in changes:
        changes = {**changes, "settings": {**layout().settings, **changes["settings"]}}
    with pytest.raises(ValueError) as refused:
        opened(path, layout(**{"notes": {"law": "linear"}, **changes}))
    first, *lines, last = str(refused.value).split("\n")
    assert str(path) in first
    assert [line.strip() for line in lines] == message
    assert "another path" in last and "delete" in last
    assert contents(path) == before


def test_store_of_another_program_is_refused(partial, path):
    with pytest.raises(ValueError, match="program of a step: the code"):
        opened(path, layout(), {RUN: "rises"})
    assert opened(path, layout(), {RUN: "falls", "touched": "new"}).missing() == MIDDLE
    opened(path.with_name("b"), layout(), {RUN: "falls", "touched": "one"})
    with pytest.raises(ValueError, match="variable touched: the code"):
        opened(path.with_name("b"), layout(), {RUN: "falls", "touched": "other"})


def test_store_of_the_same_sweep_is_taken(partial, path):
    """Also with other notes, and axes in another order."""
    noted = opened(path, layout(notes={"law": "of mine"}))
    assert noted.missing() == MIDDLE
    assert noted.dataset().attrs["law"] == "of mine"
    turned = opened(path, layout(axes=layout().axes[::-1]))
    assert turned.missing() == {1: [9, 2, 6, 10, 3]}
    xr.testing.assert_equal(
        turned.dataset().transpose("clearance", ...), noted.dataset().transpose("clearance", ...)
    )


def test_files_without_their_checksums_are_those_that_zarr_reads(path):
    labels = Coordinate("component", ["", "zwölf", "Δ" * 300])
    wanted = layout(coordinates=(layout().coordinates[0], labels))
    compute(opened(path, wanted), (0, 2))
    folder = path / "by_lane"
    arrays = dict(chunks.opened_group(folder).arrays())
    expected = {name: chunks.read(folder, array)[0] for name, array in arrays.items()}
    for file, content in contents(folder, "**/c/**/*").items():
        file.write_bytes(content[: -chunks.DIGITS])
    assert len(expected) == 10 and expected["component"].tolist() == labels.values
    for name, array in zarr.open_group(folder, mode="r").arrays():
        np.testing.assert_array_equal(np.asarray(array), expected[name])


def test_digests_of_saved_times_have_an_array_of_their_own(path):
    digests = {RUN: row_digests([np.arange(12.0)]), "_": row_digests([np.arange(12.0) + 1.0])}
    SweepStore.open(path, layout(), Identity({RUN: "falls"}, digests))
    np.testing.assert_equal(contents_of(path).identity.lanes, digests)


def test_what_is_no_store_is_refused(tmp_path):
    (tmp_path / "letter.txt").write_text("Dear")
    for path in (tmp_path, tmp_path / "letter.txt"):
        with pytest.raises(ValueError, match="must name the store of a sweep"):
            opened(path, layout())
    with pytest.raises(ValueError, match="must name the store of a sweep"):
        open_sweep(tmp_path / "absent")


def test_no_axis_has_the_name_of_the_folder_of_lanes():
    with pytest.raises(ValueError, match="by_lane"):
        layout(axes=(Coordinate("by_lane", [1.0]),))


CREATE_AND_DIE = """
import os, signal, sys, zarr
from pathlib import Path
from tests.internals.support.fake_sweep import layout, opened
zarr.consolidate_metadata = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
opened(Path(sys.argv[1]), layout())
"""


@pytest.mark.slow
def test_what_a_process_killed_during_creation_has_left_goes_and_what_is_being_made_stays(path):
    with started(CREATE_AND_DIE, path) as process:
        assert process.wait() == -signal.SIGKILL
    (left,) = path.parent.iterdir()
    assert left != path
    store = opened(path, layout())
    assert list(store.missing()) == [0, 1, 2]
    assert sorted(path.parent.iterdir()) == [left, path]
    long_ago = time.time() - 2 * metadata.ABANDONED_AFTER
    os.utime(left, (long_ago, long_ago))
    assert opened(path, layout()).missing() == store.missing()
    assert list(path.parent.iterdir()) == [path]


def test_a_store_that_cannot_be_made_leaves_nothing(path, monkeypatch):
    def interrupted(making, contents):
        making.mkdir(parents=True)
        raise KeyboardInterrupt

    monkeypatch.setattr(metadata, "_write", interrupted)
    with pytest.raises(KeyboardInterrupt):
        opened(path, layout())
    assert list(path.parent.iterdir()) == []


def test_what_is_still_written_after_an_error_is_removed_too(path):
    """As by Zarr's threads on a full disk."""

    def late(folder):
        time.sleep(0.2)
        (folder / "c").mkdir(parents=True)

    thread = ThreadPoolExecutor(1)
    with pytest.raises(OSError, match="No space"), metadata.unfinished(path) as folder:
        thread.submit(late, folder)
        raise OSError(errno.ENOSPC, "No space left on device")
    thread.shutdown()
    assert list(path.parent.iterdir()) == []


def test_a_full_disk_leaves_the_earlier_chunk_and_no_part_of_another(path, monkeypatch):
    store = opened(path, layout())
    compute(store, (0,))
    before = contents(path)

    def full(file, content):
        file.touch()
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match="No space"):
        store.write({0: (range(5), results(layout(), range(5)))})
    assert contents(path) == before


def test_the_error_of_a_time_limit_is_not_taken_for_an_existing_folder(tmp_path, monkeypatch):
    mkdir = os.mkdir

    def expired(folder, *options):
        mkdir(folder, *options)
        raise TimeoutError("the time is over")

    monkeypatch.setattr(os, "mkdir", expired)
    with pytest.raises(TimeoutError, match="is over"):
        chunks.make_folder(tmp_path / "a" / "b")


def test_the_error_of_a_time_limit_is_not_taken_for_that_of_a_file_system(path, monkeypatch):
    """A signal handler may raise a `TimeoutError`, which is an `OSError`, while the process waits
    for a lock."""

    def expired(*_):
        raise TimeoutError("the time is over")

    store = opened(path, layout())
    monkeypatch.setattr(fcntl, "flock", expired)
    with pytest.raises(TimeoutError, match="is over"):
        compute(store)


def test_of_two_that_create_a_store_the_first_wins(partial, path):
    """The second finds it there when it has made its own."""
    create(path, contents_of(path))
    assert partial.missing() == MIDDLE
    assert list(path.parent.iterdir()) == [path]


def test_two_that_write_to_the_same_chunks_lose_no_lane(path):
    """Each every second lane, and a reader never sees a lane go that was there."""
    wanted = layout(axes=(Coordinate("clearance", np.linspace(1e-4, 1e-3, 25), "m"),))

    def write(first):
        store = opened(path, wanted)
        for lane in range(first, wanted.lanes, 2):
            store.write({lane // wanted.chunk: ([lane], results(wanted, [lane]))})

    opened(path, wanted)
    seen = np.zeros(wanted.lanes, bool)
    with ThreadPoolExecutor(2) as threads:
        writing = [threads.submit(write, first) for first in range(2)]
        while not all(writer.done() for writer in writing):
            done = open_sweep(path)["result"].values >= 0
            assert done[seen].all()
            seen = done
    assert [writer.exception() for writer in writing] == [None, None]
    identical(open_sweep(path), complete(wanted))


def test_a_chunk_that_is_written_again_never_reads_as_pending(path, monkeypatch):
    """As when another process has computed the same lanes."""
    store = opened(path, layout())
    compute(store)
    flush, seen = store_module._flush, []

    def looked(file):
        flush(file)
        seen.append(open_sweep(path)["result"].values)

    monkeypatch.setattr(store_module, "_flush", looked)
    for lanes in (range(5, 10), [6, 8]):
        store.write({1: (list(lanes), results(layout(), list(lanes)))})
    assert len(seen) == 8 and all((codes >= 0).all() for codes in seen)


def test_a_store_that_is_read_only_is_read(partial, path, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setattr(os, "access", lambda *_: False)
        with pytest.raises(PermissionError, match="Lanes are missing .*by_lane"):
            partial.missing()
    compute(partial)
    partial.write_grid()
    monkeypatch.setattr(chunks, "_LOCK", "absent/lock")
    before = written(path)
    store = opened(path, layout())
    store.write_grid()
    assert store.missing() == {}
    assert written(path) == before


def test_a_store_that_is_read_only_keeps_an_outdated_grid(path, monkeypatch):
    compute(opened(path, layout()))
    codes = path / "result" / "c" / "0" / "0"
    outdated = codes.read_bytes()
    store = opened(path, layout())
    with monkeypatch.context() as patched:
        patched.setattr(os, "access", lambda *_: False)
        store.write_grid()
    assert codes.read_bytes() == outdated
    store.write_grid()
    assert codes.read_bytes() != outdated
