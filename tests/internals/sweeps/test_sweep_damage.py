"""Damaged stores: damaged files are named, their lanes are pending and are computed again."""

import json
import shutil
import warnings
from functools import partial

import numpy as np
import pytest

from clearjoint import open_sweep
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

LANES = {1: [5, 6, 7, 8, 9], 2: [10, 11]}
"""Of a full chunk, and of the last one."""


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
FILES = {"position": "c/{}/0/0", "steps": "c/{}", "touched": "c/{}", "result": "c/{}"}


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


@pytest.mark.parametrize("chunk", LANES)
@pytest.mark.parametrize(("damage", "name"), each_once(FILES))
def test_what_is_damaged_is_named_and_computed_anew(path, name, damage, chunk):
    whole, file, lost = by_lane(complete(layout())), FILES[name].format(chunk), LANES[chunk]
    DAMAGES[damage](path / "by_lane" / name / file)
    fault = "missing" if damage == "deleted" else "damaged"
    message = "" if (name, damage) in UNSEEN else f"{name}/{file} is {fault}"

    found, warned = recorded(lambda: open_sweep(path))
    assert message in warned
    lanes = by_lane(found)
    assert np.flatnonzero(lanes["result"] == -1).tolist() == lost
    assert np.isnan(lanes["position"].isel(lane=lost)).all()
    others = np.delete(np.arange(12), lost)
    for key in whole.data_vars:
        expected = whole[key].isel(lane=others)
        np.testing.assert_array_equal(lanes[key].isel(lane=others), expected)

    store = opened(path, layout())
    missing, warned = recorded(store.missing)
    assert message in warned
    assert missing == {chunk: lost}
    store.write({chunk: (lost, results(layout(), lost))})
    found, warned = recorded(lambda: open_sweep(path))
    assert warned == ""
    identical(found, complete(layout()))


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


def test_much_damage_is_counted(path):
    for file in path.glob("by_lane/*/c/?"):
        if file.is_file() and file.parts[-3] in ("steps", "touched"):
            file.unlink()
    _, warned = recorded(lambda: open_sweep(path))
    assert "c/0 is missing" in warned and "and 1 more" in warned


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
    others = []
    for name in whole["attributes"]:
        left = {key: value for key, value in whole["attributes"].items() if key != name}
        others.append({**whole, "attributes": left})
    others.append({**whole, "consolidated_metadata": {"metadata": {}}})
    others.append(json.loads(file.read_text().replace('"units": "m"', '"units": "n"')))
    for other in others:
        file.write_text(json.dumps(other))
        with pytest.raises(ValueError, match=f"{file} is .*damaged"):
            open_sweep(path)


@pytest.mark.parametrize("name", FILES)
def test_exchanged_chunks_are_computed_again(path, name):
    first, second = (path / "by_lane" / name / FILES[name].format(chunk) for chunk in (0, 1))
    one, other = first.read_bytes(), second.read_bytes()
    first.write_bytes(other)
    second.write_bytes(one)
    found, warned = recorded(lambda: open_sweep(path))
    assert f"{first} is damaged" in warned and f"{second} is damaged" in warned
    assert np.flatnonzero(by_lane(found)["result"] == -1).tolist() == list(range(10))
    recorded(lambda: compute(opened(path, layout())))
    identical(open_sweep(path), complete(layout()))


def test_a_lane_alone_does_not_mend_the_others_of_a_damaged_chunk(path):
    flipped(path / "by_lane" / "position" / FILES["position"].format(1))
    store = opened(path, layout())
    store.write({1: ([5, 6], results(layout(), [5, 6]))})
    assert store.missing() == {1: [7, 8, 9]}
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
    before = contents(path)
    DAMAGES[damage](path / GRID_FILES[name])
    opened(path, layout()).write_grid()
    assert contents(path) == before


def test_an_intact_grid_is_not_written_again(path):
    opened(path, layout()).write_grid()
    before = written(path, "**/c/*")
    opened(path, layout()).write_grid()
    assert written(path, "**/c/*") == before
