"""A sweep whose chunks cost nothing: numbers that follow from the lanes alone."""

from pathlib import Path

import numpy as np
import xarray as xr

from clearjoint._sweeps.outputs import Coordinate, Layout, Variable
from clearjoint._sweeps.store.program import RUN, Identity, row_digests
from clearjoint._sweeps.store.store import SweepMemory, SweepStore

COMPONENTS = ("x", "y", "z")
RESULT = Variable(
    dtype="int8",
    attrs={"flag_values": [-1, 0, 1], "flag_meanings": "pending successful max_steps_reached"},
)
SETTINGS = {"rtol": "1e-06", "end_time": "0.5", "solver": "Tsit5", "impacts": "True"}


def layout(**changes) -> Layout:
    """Four clearances times three restitutions in chunks of five: 5, 5 and 2 lanes."""
    parts = {
        "axes": (
            Coordinate("clearance", np.linspace(1e-4, 1e-3, 4), "m"),
            Coordinate("restitution", np.array([0.1, 0.5, 0.9])),
        ),
        "chunk": 5,
        "variables": {
            "position": Variable(("time", "component"), (5, 3), unit="m", description="of arm"),
            "steps": Variable(dtype="int64"),
            "touched": Variable(dtype="bool"),
            "result": RESULT,
        },
        "coordinates": (
            Coordinate("time", np.linspace(0, 0.5, 5), "s"),
            Coordinate("component", COMPONENTS),
        ),
        "settings": SETTINGS,
    }
    return Layout(**{**parts, **changes})


def opened(path: Path, layout: Layout, programs: dict[str, str] | None = None) -> SweepStore:
    """The store of a layout at a path; its lanes are known by their values of the axes."""
    columns = layout.values()
    lanes = row_digests([np.asarray(columns[name], float) for name in sorted(columns)])
    return SweepStore.open(path, layout, Identity(programs or {RUN: "falls"}, {RUN: lanes}))


def results(layout: Layout, lanes) -> dict[str, np.ndarray]:
    """Of some lanes: incompressible positions, some NaN, and codes 0 or 1."""
    lanes = np.asarray(lanes)
    shape = layout.variables["position"].shape
    position = np.stack([np.random.default_rng(lane).random(shape) for lane in lanes])
    position[lanes == 1] = np.nan
    return {
        "position": position,
        "steps": 1000 + lanes,
        "touched": lanes % 2 == 0,
        "result": (lanes % 3 == 0).astype("int8"),
    }


def complete(layout: Layout):
    """The labelled results of a sweep that nothing interrupted."""
    entry_speeds = SweepMemory(layout)
    compute(entry_speeds)
    return entry_speeds.dataset()


def compute(store: SweepMemory | SweepStore, chunks=None) -> None:
    """Write what is missing, or that of some chunks."""
    for chunk, lanes in store.missing().items():
        if chunks is None or chunk in chunks:
            store.write({chunk: (tuple(lanes), results(store.layout, lanes))})


def identical(one: xr.Dataset, other: xr.Dataset) -> None:
    """The same bits, types, names and attributes."""
    xr.testing.assert_identical(one, other)
    for name in other.variables:
        assert one[name].dtype == other[name].dtype
        if one[name].dtype.kind != "U":
            assert one[name].values.tobytes() == other[name].values.tobytes()


def by_lane(found: xr.Dataset) -> xr.Dataset:
    """The results of `layout` along its lanes."""
    return found.stack(lane=("clearance", "restitution"))


def contents(path: Path, pattern: str = "**/*") -> dict[Path, bytes]:
    """The bytes of the files in a folder."""
    return {file: file.read_bytes() for file in path.glob(pattern) if file.is_file()}


def written(path: Path, pattern: str = "**/*") -> dict[Path, int]:
    """When the files and folders in a folder were changed."""
    return {file: file.stat().st_mtime_ns for file in path.glob(pattern)}
