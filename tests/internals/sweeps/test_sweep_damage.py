"""Damaged stores: damaged files are named, their lanes are pending and are computed again."""

import json
import shutil
import warnings
from functools import partial

import numpy as np
import pytest

from clearjoint import open_sweep
from tests.internals.support.fake_sweep import complete, compute, layout, opened, results
from tests.internals.sweeps.test_sweep_store import identical

CHUNK, LANES = 1, [5, 6, 7, 8, 9]


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "sweep.zarr"
    compute(opened(path, layout()))
    return path


def flipped(file):
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 4
    file.write_bytes(content)


DAMAGES = {
    "deleted": lambda file: file.unlink(),
    "flipped": flipped,
    "truncated": lambda file: file.write_bytes(file.read_bytes()[:-3]),
    "short": lambda file: file.write_bytes(b"\x01"),
    "empty": lambda file: file.write_bytes(b""),
    "garbage": lambda file: file.write_bytes(bytes(range(200))),
}
FILES = {
    "position": "c/1/0/0",
    "steps": "c/1",
    "touched": "c/1",
    "result": "c/1",
}


UNSEEN = [("result", "deleted")]
"""As of a chunk that was never done."""


def each_once(names):
    """Pairs of a damage and a file: in the fast tests each damage and each file once."""
    names = list(names)
    return [
        pytest.param(damage, name, marks=() if i % len(names) == j else pytest.mark.slow)
        for i, damage in enumerate(DAMAGES)
        for j, name in enumerate(names)
    ]


@pytest.mark.parametrize(("damage", "name"), each_once(FILES))
def test_what_is_damaged_is_named_and_computed_anew(path, name, damage):
    whole = complete(layout())
    DAMAGES[damage](path / "by_lane" / name / FILES[name])
    fault = "missing" if damage == "deleted" else "damaged"
    messages = [] if (name, damage) in UNSEEN else [f"{name}/{FILES[name]} is {fault}"]

    found, warned = recorded(lambda: open_sweep(path))
    assert [text for text in messages if text not in warned] == []
    lanes = found.stack(lane=("clearance", "restitution"))
    assert np.flatnonzero(lanes["result"] == -1).tolist() == LANES
    assert np.isnan(lanes["position"].isel(lane=LANES)).all()
    others = np.delete(np.arange(12), LANES)
    for key in whole.data_vars:
        expected = whole[key].stack(lane=("clearance", "restitution")).isel(lane=others)
        np.testing.assert_array_equal(lanes[key].isel(lane=others), expected)

    store = opened(path, layout())
    missing, warned = recorded(store.missing)
    assert [text for text in messages if text not in warned] == []
    assert missing == {CHUNK: LANES}
    store.write({CHUNK: (LANES, results(layout(), LANES))})
    found, warned = recorded(lambda: open_sweep(path))
    assert warned == ""
    identical(found, whole)


def recorded(function):
    """What a function returns, and warns of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = function()
    return found, " ".join(str(warning.message) for warning in caught)


def test_the_warning_of_damage_refers_to_the_line_of_the_call(path):
    (path / "by_lane" / "steps" / "c" / "1").unlink()
    store = opened(path, layout())
    for read in (partial(open_sweep, path), store.missing, store.dataset):
        with pytest.warns(UserWarning, match="is missing") as caught:
            read()
        assert caught[0].filename == __file__


def test_the_last_chunk_which_is_not_full_is_computed_anew(path):
    flipped(path / "by_lane" / "position" / "c" / "2" / "0" / "0")
    store = opened(path, layout())
    missing, warned = recorded(store.missing)
    assert missing == {2: [10, 11]} and "position/c/2/0/0 is damaged" in warned
    store.write({2: ([10, 11], results(layout(), [10, 11]))})
    identical(recorded(lambda: open_sweep(path))[0], complete(layout()))


def test_much_damage_is_counted(path):
    for file in path.glob("by_lane/*/c/?"):
        if file.is_file() and file.parts[-3] in ("steps", "touched"):
            file.unlink()
    assert "c/0 is missing" in recorded(lambda: open_sweep(path))[1]
    assert "and 1 more" in recorded(lambda: open_sweep(path))[1]


@pytest.mark.parametrize("name", ["clearance", "component", "sweep_lanes"])
@pytest.mark.parametrize("damage", ["deleted", "flipped"])
def test_damaged_labels_are_named(path, name, damage):
    file = path / "by_lane" / name / "c" / "0"
    DAMAGES[damage](file)
    for read in (open_sweep, lambda path: opened(path, layout())):
        with pytest.raises(ValueError, match=f"The store {path} can.t .* {file} is .*: restore"):
            read(path)


@pytest.mark.parametrize("content", [b"", b"{", b"{}", b"[]"])
def test_damaged_metadata_are_named(path, content):
    file = path / "by_lane" / "zarr.json"
    file.write_bytes(content)
    for read in (open_sweep, lambda path: opened(path, layout())):
        with pytest.raises(
            ValueError, match=f"{path} is not a store, or {file} is missing or damaged"
        ):
            read(path)


def test_each_damaged_attribute_is_noticed(path):
    file = path / "by_lane" / "zarr.json"
    whole = json.loads(file.read_text())
    others = [{**whole, "attributes": without(whole["attributes"], k)} for k in whole["attributes"]]
    others.append({**whole, "consolidated_metadata": {"metadata": {}}})
    others.append(json.loads(file.read_text().replace('"units": "m"', '"units": "n"')))
    for other in others:
        file.write_text(json.dumps(other))
        with pytest.raises(ValueError, match=f"{file} is .*damaged"):
            open_sweep(path)


def without(entries, name):
    return {key: value for key, value in entries.items() if key != name}


@pytest.mark.parametrize("name", FILES)
def test_exchanged_chunks_are_computed_again(path, name):
    first = path / "by_lane" / name / FILES[name]
    second = path / "by_lane" / name / FILES[name].replace("1", "0", 1)
    one, other = first.read_bytes(), second.read_bytes()
    first.write_bytes(other)
    second.write_bytes(one)
    found, warned = recorded(lambda: open_sweep(path))
    assert f"{first} is damaged" in warned and f"{second} is damaged" in warned
    lanes = found.stack(lane=("clearance", "restitution"))
    assert np.flatnonzero(lanes["result"] == -1).tolist() == list(range(10))
    recorded(lambda: compute(opened(path, layout())))
    identical(open_sweep(path), complete(layout()))


def test_a_lane_alone_does_not_mend_the_others_of_a_damaged_chunk(path):
    flipped(path / "by_lane" / "position" / FILES["position"])
    store = opened(path, layout())
    store.write({CHUNK: (LANES[:2], results(layout(), LANES[:2]))})
    assert store.missing() == {CHUNK: LANES[2:]}
    compute(store)
    identical(open_sweep(path), complete(layout()))


def test_stores_of_other_formats_are_refused(path):
    root = json.loads((path / "by_lane" / "zarr.json").read_text())
    root["attributes"]["sweep_format"] = 2
    shutil.rmtree(path / "by_lane")
    (path / "zarr.json").write_text(json.dumps(root))
    with pytest.raises(ValueError, match="format 3, not 2 .*xarray.open_zarr"):
        open_sweep(path)


GRID_FILES = {
    "position": "position/c/0/0/0/0",
    "codes": "result/c/0/0",
    "axis": "clearance/c/0",
    "metadata": "zarr.json",
    "metadata of an array": "steps/zarr.json",
}


@pytest.mark.parametrize(("damage", "name"), each_once(GRID_FILES))
def test_a_damaged_grid_is_written_again(path, name, damage):
    """By the next sweep with the same arguments, although no lane is missing."""
    opened(path, layout()).write_grid()
    files = {file: file.read_bytes() for file in path.rglob("*") if file.is_file()}
    (file,) = path.glob(GRID_FILES[name])
    DAMAGES[damage](file)
    opened(path, layout()).write_grid()
    assert {file: file.read_bytes() for file in path.rglob("*") if file.is_file()} == files


def test_an_intact_grid_is_not_written_again(path):
    opened(path, layout()).write_grid()
    files = {file: file.stat().st_mtime_ns for file in path.rglob("*/c/*") if file.is_file()}
    opened(path, layout()).write_grid()
    assert all(file.stat().st_mtime_ns == time for file, time in files.items())
