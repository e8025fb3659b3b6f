"""Stores that are extended by lanes and variables: only missing results are computed."""

from contextlib import suppress

import numpy as np
import pytest
import xarray as xr

from clearjoint import open_sweep
from clearjoint._sweeps.outputs import Coordinate, Variable
from clearjoint._sweeps.store import metadata
from clearjoint._sweeps.store.program import RUN, Identity, row_digests
from clearjoint._sweeps.store.store import SweepStore
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
from tests.support.slow import slow_but

pytestmark = pytest.mark.filterwarnings("error")
CLEARANCE, RESTITUTION = layout().axes


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "sweep.zarr"
    compute(opened(path, layout()))
    return path


def axes(clearance=CLEARANCE.values, restitution=RESTITUTION.values):
    return {
        "axes": (
            CLEARANCE._replace(values=np.asarray(clearance)),
            RESTITUTION._replace(values=np.asarray(restitution)),
        )
    }


FURTHER = {
    "before": axes(clearance=[5e-5, *CLEARANCE.values]),
    "in both, in any order": axes([2e-3, *CLEARANCE.values[::-1]], [0.9, 0.2, 0.5, 0.1]),
    "twice": axes(restitution=[0.1, 0.5, 0.9, 0.9]),
}


@pytest.mark.parametrize("further", FURTHER.values(), ids=FURTHER)
def test_further_values_leave_the_lanes_there_are(path, further):
    before, positions = open_sweep(path), "by_lane/position/c/*/*/*"
    files = contents(path, positions)
    wanted = layout(**further)
    store = opened(path, wanted)
    missing = sorted(lane for lanes in store.missing().values() for lane in lanes)
    assert len(missing) == wanted.lanes - 12
    assert contents(path, positions) == files
    found = open_sweep(path)
    assert (found["result"] == -1).sum() == len(missing)
    same_lanes(found, before)
    compute(store)
    found = open_sweep(path)
    assert (found["result"] >= 0).all()
    same_lanes(found, before)
    new = by_lane(found).isel(lane=missing)
    assert new["steps"].values.tolist() == [1000 + lane for lane in missing]
    assert opened(path, wanted).missing() == {}
    identical(found, store.dataset())


SAME_LANES = {
    "values in another order": axes(restitution=RESTITUTION.values[::-1]),
    "axes in another order": {"axes": layout().axes[::-1]},
    "an axis of one value": {"axes": (*layout().axes, Coordinate("friction", [0.2]))},
    "zipped": {
        "axes": tuple(axis._replace(values=layout().values()[axis.name]) for axis in layout().axes),
        "zipped": True,
    },
}


@pytest.mark.parametrize("changes", SAME_LANES.values(), ids=SAME_LANES)
def test_the_same_lanes_are_read_along_the_axes_of_the_last_sweep(path, changes):
    before = open_sweep(path)
    wanted = layout(**changes)
    columns = wanted.values()
    lanes = row_digests([columns["clearance"], columns["restitution"]])
    store = SweepStore.open(path, wanted, Identity({RUN: "falls"}, {RUN: lanes}))
    assert store.missing() == {}
    found = open_sweep(path)
    identical(found, store.dataset())
    with xr.open_zarr(path, chunks=None) as grid:
        xr.testing.assert_equal(grid, found)
    assert [axis.name for axis in wanted.axes] == [n for n in found.coords if n in columns]
    if wanted.zipped:
        found = found.set_index(lane=["clearance", "restitution"]).unstack("lane")
    found = found.squeeze(drop=True).sel(before.coords)
    xr.testing.assert_equal(found.transpose(*before.dims), before)
    files = written(path, "**/zarr.json")
    SweepStore.open(path, wanted, Identity({RUN: "falls"}, {RUN: lanes}))
    assert written(path, "**/zarr.json") == files


def same_lanes(found: xr.Dataset, before: xr.Dataset) -> None:
    """The lanes that were there before read as before."""
    here = found.isel(restitution=slice(None))
    if len(set(here["restitution"].values)) < here.sizes["restitution"]:
        here = here.isel(restitution=slice(3))
    xr.testing.assert_equal(here.sel(before.coords), before)


def test_further_lanes_join_a_chunk_that_was_not_full(path):
    behind = layout(**axes(clearance=[*CLEARANCE.values, 2e-3]))
    store = opened(path, behind)
    assert store.missing() == {2: [12, 13, 14]}
    compute(store)
    identical(open_sweep(path), complete(behind))


def test_a_further_axis_takes_the_lanes_that_it_has(tmp_path):
    zipped = {"zipped": True, "chunk": 2}
    path = tmp_path / "sweep.zarr"
    rows = [Coordinate("a", [1.0, 2.0, 3.0]), Coordinate("b", [0.5, 0.5, 0.5])]
    compute(opened(path, layout(axes=tuple(rows), **zipped)))
    grid = layout(axes=(Coordinate("a", [1.0, 2.0, 3.0]), Coordinate("b", [0.5, 1.0])), chunk=2)
    store = opened(path, grid)
    assert store.missing() == {1: [1], 2: [3, 5]}
    compute(store)
    found = open_sweep(path)
    assert found["steps"].sel(b=0.5).values.tolist() == [1000, 1001, 1002]
    assert found["steps"].sel(b=1.0).values.tolist() == [1001, 1003, 1005]


def test_a_further_axis_that_may_have_changed_the_program_is_named(tmp_path):
    path, (a, b) = tmp_path / "sweep.zarr", (Coordinate("a", [1.0, 2.0]), Coordinate("b", [0.0]))
    compute(opened(path, layout(axes=(a,))))
    lanes = {RUN: row_digests([a.values])}
    with pytest.raises(ValueError, match="program of a step: .* because axis b is of a vector"):
        SweepStore.open(path, layout(axes=(a, b)), Identity({RUN: "falls along a vector"}, lanes))


def test_a_lane_that_another_sweep_lacks_has_its_number(path):
    """The lanes of the smallest clearance were added last, in the rows from 12 on."""
    compute(opened(path, layout(**FURTHER["before"])))
    with pytest.raises(ValueError, match="lanes: 3 of 15 .*first lane 0\n"):
        opened(path, layout())


ENERGY = {"variables": {**layout().variables, "energy": Variable(unit="J")}}


def opened_with_energy(path):
    return opened(path, layout(**ENERGY), {RUN: "falls", "energy": "new"})


def with_energy(store, lanes):
    return {**results(store.layout, lanes), "energy": 1.0 * np.asarray(lanes)}


def test_further_variables_are_pending_until_their_lanes_have_run_again(path):
    before = open_sweep(path)
    store = opened_with_energy(path)
    assert [len(lanes) for lanes in store.missing().values()] == [5, 5, 2]
    for chunk in (0, 1):
        lanes = store.missing()[chunk]
        store.write({chunk: (lanes, with_energy(store, lanes))})
    found = by_lane(open_sweep(path))
    assert np.flatnonzero(found["result"] == -1).tolist() == [10, 11]
    assert opened_with_energy(path).missing() == {2: [10, 11]}
    store.write({2: ([10, 11], with_energy(store, [10, 11]))})
    found = open_sweep(path)
    xr.testing.assert_equal(found.drop_vars("energy"), before)
    assert found["energy"].values.ravel().tolist() == list(range(12))
    with pytest.raises(ValueError, match="variable energy: stored .*, now nothing"):
        opened(path, layout())


@pytest.mark.parametrize("steps", slow_but([12, 36], range(0, 40, 3)))
def test_killed_while_it_is_extended_the_store_reads_as_before_or_after(path, steps, monkeypatch):
    before = open_sweep(path)
    left = [steps]

    def move(*files, move=metadata.move):
        if not left[0]:
            raise KeyboardInterrupt
        left[0] -= 1
        move(*files)

    wanted = {**FURTHER["in both, in any order"], **ENERGY}
    with monkeypatch.context() as patched:
        patched.setattr(metadata, "move", move)
        with suppress(KeyboardInterrupt):
            opened(path, layout(**wanted))
    found = open_sweep(path)
    assert list(path.parent.iterdir()) == [path]
    store = opened(path, layout(**wanted))
    # The grid is written last: an extension that is killed there counts as complete.
    identical(found, before if found.sizes == before.sizes else open_sweep(path))
    assert sum(map(len, store.missing().values())) == 20
    assert opened(path, layout(**wanted)).layout.lanes == 20


def test_who_writes_as_before_while_the_store_is_extended_writes_the_same_lanes(tmp_path):
    path = tmp_path / "sweep.zarr"
    old = opened(path, layout())
    new = opened(path, layout(**FURTHER["before"]))
    compute(old, (0, 1, 2))
    compute(new)
    same_lanes(open_sweep(path), complete(layout()))


def test_lanes_of_who_lacks_a_variable_are_pending_with_it(tmp_path):
    """Two processes write to a chunk, of which one has added a variable to the store."""
    path = tmp_path / "sweep.zarr"
    old, new = opened(path, layout()), opened_with_energy(path)
    new.write({0: ([0, 1], with_energy(new, [0, 1]))})
    assert old.missing()[0] == new.missing()[0] == [2, 3, 4]
    old.write({0: ([2, 3, 4], results(old.layout, [2, 3, 4]))})
    assert 0 not in old.missing() and new.missing()[0] == [0, 1, 2, 3, 4]
    new.write({0: (range(5), with_energy(new, range(5)))})
    assert 0 not in new.missing()
    assert open_sweep(path)["energy"].values.ravel()[:5].tolist() == [0, 1, 2, 3, 4]
