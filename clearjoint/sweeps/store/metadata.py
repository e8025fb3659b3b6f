"""Metadata and labels of a sweep's Zarr store, which are written before any result.

A row is the position of a lane in the store's arrays. Its number may differ from that of the lane,
because lanes that are added later get rows at the end.
"""

import glob
import json
import shutil
import time
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...fields.checks import require
from ..layout import BY_LANE, LANE, Coordinate, Layout, Variable, dataset
from .chunks import checked_files, chunk_file, opened, opened_group, read
from .fingerprint import digest
from .grid import ROOT, remove_grid, unfinished, write_grid
from .identity import Identity

if TYPE_CHECKING:
    import xarray as xr
    import zarr

_FORMAT, _VERSION = "sweep_format", 3
_DIGEST = "sweep_digest"
"""Name of the attribute with a digest of all metadata."""
ADDED = "sweep_added"
"""Name of the attribute that lists the variables added when some lanes were already done."""
_OWN = (
    "sweep_axes",
    "sweep_shape",
    "sweep_zipped",
    "sweep_chunk",
    "sweep_coordinates",
    "sweep_notes",
    "sweep_programs",
    "sweep_digests",
    "sweep_order",
    ADDED,
    _FORMAT,
)
"""Names of the store's attributes that are not settings of the sweep."""
ABANDONED_AFTER = 3600.0
"""Age, s, above which an incomplete store is removed. Writing one takes about a second."""


class Contents(NamedTuple):
    """Contents of a store without the results.

    - `layout`, `identity`: layout and identity of the sweep.
    - `order`: (lanes,) number of the sweep's lane in each row of the store. Added lanes get rows at
      the end, although their numbers in the sweep may be in between.
    - `added`: names of the variables that were added when some lanes were already done.
    """

    layout: Layout
    identity: Identity
    order: np.ndarray
    added: frozenset[str] = frozenset()


def create(path: Path, contents: Contents) -> None:
    """Make a store without results at a path; do nothing if another process has made the store.

    The store is written under another name and renamed, so that it is complete or absent.
    """
    with _new_store(path, contents) as store:
        pending = {name: v[contents.order] for name, v in contents.layout.pending().items()}
        write_grid(store, labelled(contents, pending))
        try:
            store.rename(path)
        except OSError:
            if not path.exists():
                raise


def extend(path: Path, contents: Contents) -> None:
    """Add lanes, in rows after the existing ones, or variables to the store at a path.

    Existing chunks are not changed. The grid, whose labels are outdated, is removed.

    **Arguments:** `contents`: those of the extended store.
    """
    with _new_store(path, contents) as store:
        files = [file.relative_to(store) for file in store.rglob("*") if file.is_file()]
        # The file `ROOT` lists the arrays and is replaced last: until then the store reads as
        # before, also if this process is killed.
        for file in sorted(files, key=lambda file: file == Path(BY_LANE, ROOT)):
            _move(store / file, path / file)
    remove_grid(path)


def _move(file: Path, to: Path) -> None:
    to.parent.mkdir(parents=True, exist_ok=True)
    file.replace(to)


def remove_abandoned(path: Path) -> None:
    """Remove incomplete stores of killed processes that were making or extending the store at a
    path."""
    for partial in path.parent.glob(f".{glob.escape(path.name)}.*.partial"):
        with suppress(FileNotFoundError):
            if time.time() - partial.stat().st_mtime > ABANDONED_AFTER:
                shutil.rmtree(partial)


def contents_of(path: Path) -> Contents:
    """Read the contents, without the results, of the store at a path.

    **Raises:** `ValueError` if there is no sweep's store, or if its metadata or labels are damaged.
    """
    group, attrs = _opened(path)
    path = path / BY_LANE
    stored = {name: attrs.pop(name) for name in _OWN}
    order = _values(path, group, stored["sweep_order"])
    row_of = np.argsort(order)
    names, digests = stored["sweep_axes"], stored["sweep_digests"]
    further = stored["sweep_coordinates"]
    axes = [_labels(path, group, name) for name in names]
    axes = [axis._replace(values=axis.values[row_of]) for axis in axes]
    if not stored["sweep_zipped"]:
        # The store has each axis's value in every lane, in rows; `Layout` needs each value once.
        axes = [_along(axis, stored["sweep_shape"], dim) for dim, axis in enumerate(axes)]
    labels = {*names, *further, *digests.values(), stored["sweep_order"]}
    notes = {name: attrs.pop(name) for name in stored["sweep_notes"]}
    layout = Layout(
        tuple(axes),
        stored["sweep_chunk"],
        {name: _variable(array) for name, array in group.arrays() if name not in labels},
        tuple(_labels(path, group, name) for name in further),
        attrs,
        stored["sweep_zipped"],
        notes,
    )
    lanes = {name: _values(path, group, array)[row_of] for name, array in digests.items()}
    identity = Identity(stored["sweep_programs"], lanes)
    return Contents(layout, identity, order, frozenset(stored[ADDED]))


def labelled(contents: Contents, arrays: Mapping[str, np.ndarray]) -> "xr.Dataset":
    """Return results in the order of the store's rows, (lanes, ...) by variable, as a dataset."""
    row_of = np.argsort(contents.order)
    return dataset(contents.layout, {name: values[row_of] for name, values in arrays.items()})


def _opened(path: Path) -> "tuple[zarr.Group, dict[str, Any]]":
    """Open a store to read it, and return its group `by_lane` and the attributes of this group.

    The attribute with the digest of the metadata is checked and left out.

    **Raises:** `ValueError` if there is no store at the path, if its format has another version, or
    if its metadata are damaged.
    """
    file = path / BY_LANE / ROOT
    try:
        # Older versions stored the lanes where the grid is now.
        root = json.loads((file if file.exists() else path / ROOT).read_text())
        attrs: dict[str, Any] = root["attributes"]
        version = attrs[_FORMAT]
    except (FileNotFoundError, NotADirectoryError, ValueError, KeyError, TypeError) as error:
        raise ValueError(
            f"Argument `path` must name the store of a sweep, but {path} is not a store, or {file} "
            "is missing or damaged: pass another path, or delete this one."
        ) from error
    require(
        version == _VERSION,
        "path",
        str(path),
        f"a store of format {_VERSION}, not {version} as written by other versions of clearjoint",
        "read it with xarray.open_zarr, and sweep into another path",
    )
    if attrs.pop(_DIGEST, None) != _digest(root):
        raise ValueError(
            f"The store {path} can't be read, because {file} is damaged: restore that file from a "
            "copy, or delete the store to compute it again."
        )
    return opened_group(path / BY_LANE, "r"), attrs


def _digest(root: Mapping[str, Any]) -> str:
    return digest(json.dumps(root, sort_keys=True))


@contextmanager
def _new_store(path: Path, contents: Contents) -> Iterator[Path]:
    """Yield the path of a temporary store in the same folder, which is removed afterwards."""
    store = unfinished(path)
    try:
        _write(store / BY_LANE, contents)
        yield store
    finally:
        shutil.rmtree(store, ignore_errors=True)


def _write(path: Path, contents: Contents) -> None:
    import zarr

    layout, identity, order, _ = contents
    taken = sorted(set(_OWN) & {*layout.settings, *layout.notes})
    require(not taken, "settings", taken, "names that the store does not use", "rename them")
    digests = {name: f"sweep_lanes_{name}".rstrip("_") for name in identity.lanes}
    attributes = {**layout.settings, **layout.notes, **_own_attributes(contents, digests)}
    group = zarr.create_group(checked_files()(path), zarr_format=3, attributes=attributes)
    columns = layout.values()
    along_lanes = [
        *(axis._replace(values=columns[axis.name][order]) for axis in layout.axes),
        *(Coordinate(digests[name], values[order]) for name, values in identity.lanes.items()),
        Coordinate(_order_name(order), order),
    ]
    for coordinate in along_lanes:
        _write_labels(group, coordinate, LANE, layout.chunk)
    for coordinate in layout.coordinates:
        _write_labels(group, coordinate, coordinate.name, len(coordinate.values))
    for name, variable in layout.variables.items():
        _write_variable(group, name, variable, layout)
    with warnings.catch_warnings():
        # Consolidated metadata are a draft in format 3. Without them, opening the store reads a
        # file for every array.
        warnings.filterwarnings("ignore", "Consolidated metadata")
        zarr.consolidate_metadata(group.store)
    root = json.loads((path / ROOT).read_text())
    root["attributes"][_DIGEST] = _digest(root)
    (path / ROOT).write_text(json.dumps(root, indent=2))


def _own_attributes(contents: Contents, digests: dict[str, str]) -> dict[str, Any]:
    """Return the values of the attributes `_OWN` by name.

    `digests`: by key of `Identity.lanes`, the name of the array with these digests.
    """
    layout, order = contents.layout, _order_name(contents.order)
    names = [axis.name for axis in layout.axes]
    values = (
        names,
        list(layout.shape),
        layout.zipped,
        layout.chunk,
        [c.name for c in layout.coordinates],
        list(layout.notes),
        dict(contents.identity.programs),
        digests,
        order,
        sorted(contents.added),
        _VERSION,
    )
    return dict(zip(_OWN, values, strict=True))


def _order_name(order: np.ndarray) -> str:
    # Another order has another name, so that a concurrent reader finds the array of its own order.
    return f"sweep_order_{digest(order.tobytes())}"


def _write_variable(group: "zarr.Group", name: str, variable: Variable, layout: Layout) -> None:
    group.create_array(
        name,
        shape=(layout.lanes, *variable.shape),
        chunks=(layout.chunk, *(max(size, 1) for size in variable.shape)),
        dtype=variable.dtype,
        fill_value=variable.fill,
        dimension_names=(LANE, *variable.dims),
        attributes=variable.attributes,
    )


def _write_labels(group: "zarr.Group", coordinate: Coordinate, dim: str, chunk: int) -> None:
    name, values, _ = coordinate
    dtype: Any = str if values.dtype.kind == "U" else values.dtype
    attributes: dict[str, Any] = coordinate.attributes
    group.create_array(
        name,
        shape=values.shape,
        chunks=(chunk,),
        dtype=dtype,
        dimension_names=(dim,),
        attributes=attributes,
    )
    opened(group, name)[:] = values


def _values(path: Path, group: "zarr.Group", name: str) -> np.ndarray:
    """Read an array of labels.

    **Raises:** `ValueError` for a missing or damaged file.
    """
    array = opened(group, name)
    values, faults = read(path, array)
    for chunk, fault in faults.items():
        raise ValueError(
            f"The store {path} can't be read, because its file {chunk_file(path, array, chunk)} "
            f"is {fault}: restore that file from a copy, or delete the store to compute it again."
        )
    return values


def _labels(path: Path, group: "zarr.Group", name: str) -> Coordinate:
    unit = str(group[name].attrs.get("units", "1"))
    return Coordinate(name, _values(path, group, name), unit)


def _along(axis: Coordinate, shape: list[int], dim: int) -> Coordinate:
    """Return the coordinate of an axis, whose values are given for all lanes, with each value once.

    **Arguments:** `shape`: number of values along each axis; `dim`: number of this axis.
    """
    grid = np.moveaxis(axis.values.reshape(shape), dim, -1)
    return axis._replace(values=grid.reshape(-1, shape[dim])[0])


def _variable(array: "zarr.Array") -> Variable:
    attrs: dict[str, Any] = dict(array.attrs)
    unit, description = attrs.pop("units"), attrs.pop("long_name")
    metadata: Any = array.metadata
    return Variable(
        tuple(metadata.dimension_names[1:]),
        array.shape[1:],
        str(array.dtype),
        unit,
        description,
        attrs,
    )
