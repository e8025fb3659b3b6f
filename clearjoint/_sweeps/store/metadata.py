"""Metadata and labels of a sweep's Zarr store, which are written before any result."""

import glob
import json
import shutil
import time
import uuid
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..._compilation.digests import digest
from ..._compilation.program_store import system_errors_suppressed
from ..._fields.checks import require
from ..outputs import BY_LANE, LANE, RESULT, Coordinate, Layout, Variable, dataset
from .chunks import chunk_file, compressors, make_folder, opened, opened_group, read, write
from .program import Identity

if TYPE_CHECKING:
    import xarray as xr
    import zarr

ROOT = "zarr.json"
"""File with the metadata of a Zarr group, which lists its arrays."""


@contextmanager
def unfinished(path: Path) -> Iterator[Path]:
    """Yield a new path beside the store's `path`. The caller writes a folder there, then moves it,
    or its files, to the store. At the end, also after an error, the new path is removed."""
    new = path.with_name(f".{path.name}.{uuid.uuid4().hex}.partial")
    try:
        yield new
    except BaseException:
        # Zarr writes several files at the same time. After the error of one, as on a full disk, it
        # still makes others, and their folders, so that what was removed would come back.
        for _ in range(_REMOVALS):
            shutil.rmtree(new, ignore_errors=True)
            time.sleep(_REMOVAL_PERIOD)
        raise
    finally:
        with system_errors_suppressed():
            shutil.rmtree(new)


_REMOVALS, _REMOVAL_PERIOD = 10, 0.05
"""Number of attempts to remove an incomplete store after an error, and time after each, s."""


def move(file: Path, to: Path) -> None:
    """Move a file to the path `to`, in place of an earlier file, and make missing folders."""
    make_folder(to.parent)
    file.replace(to)


def write_dataset(path: Path, results: "xr.Dataset") -> None:
    """Write results to a new folder as a Zarr group."""
    from zarr.codecs import Crc32cCodec, ZstdCodec

    # Other programs read these files too. By Zarr's CRC they recognise a damaged file; they do not
    # know the checksum that `chunks.write_chunk` adds to a file.
    codecs = {"compressors": (ZstdCodec(), Crc32cCodec())}
    with warnings.catch_warnings():
        # Zarr warns that version 3 of its format doesn't specify texts and consolidated metadata
        # yet.
        warnings.simplefilter("ignore")
        results.to_zarr(
            path,
            mode="w",
            zarr_format=3,
            consolidated=True,
            encoding={str(name): codecs for name in results.variables},
            # Zarr would omit the file of an empty chunk, and `write_grid` would keep an old one.
            write_empty_chunks=True,
        )


def write_grid(path: Path, results: "xr.Dataset") -> None:
    """Write results as a store's grid, a copy along the axes, in place of an earlier grid.

    If the arrays differ in names, shapes or attributes from those of the earlier grid, that grid is
    removed first, and programs find none until the new one is complete. Otherwise, files with other
    content are replaced one by one, with the result codes last, so that a lane whose code says that
    it is done has all its numbers.
    """
    with unfinished(path) as new:
        write_dataset(new, results)
        # The file `ROOT` lists the arrays. If it changes, it is removed first and written last, so
        # that a reader finds either all arrays or none.
        if not _same(new / ROOT, path / ROOT):
            remove_grid(path)
        _move_all(new, path)


def _move_all(new: Path, path: Path) -> None:
    """Move the files of the group at `new` to the folder `path`, except those that the folder has
    already with the same content. Result codes are moved after all other arrays, and the file
    `ROOT`, which lists the arrays, last, so that readers find the earlier arrays until then."""
    files = [file.relative_to(new) for file in new.rglob("*") if file.is_file()]
    for file in sorted(files, key=lambda file: (file == Path(ROOT), file.parts[0] == RESULT)):
        if not _same(new / file, path / file):
            move(new / file, path / file)


def _same(file: Path, other: Path) -> bool:
    return other.exists() and file.read_bytes() == other.read_bytes()


def remove_grid(path: Path) -> None:
    (path / ROOT).unlink(missing_ok=True)
    for entry in path.iterdir():
        if entry.name != BY_LANE and entry.is_dir():
            shutil.rmtree(entry)


_OWN = "sweep_"
"""Prefix of attributes that are neither settings nor notes of the sweep."""
_FORMAT, _VERSION = "sweep_format", 3
_DIGEST = "sweep_digest"
"""Name of the attribute with a digest of all other metadata of the group `by_lane`."""
ADDED = "sweep_added"
"""Name of the attribute that lists the variables added after the store was made, which may lack
files of lanes that were done before."""
ABANDONED_AFTER = 3600.0
"""Least age, s, of an incomplete store left by a killed process; writing takes about a second."""


class Contents(NamedTuple):
    """Contents of a store without the results. `order`, (lanes,), has the number of the lane in
    each row; `added` has the names of the variables that were added after the store was made."""

    layout: Layout
    identity: Identity
    order: np.ndarray
    added: frozenset[str] = frozenset()


def create(path: Path, contents: Contents) -> None:
    """Make a store without results at a path, unless another process does so at the same time. It
    is written under another name and then renamed, so that it is either complete or absent."""
    with unfinished(path) as store:
        _write(store / BY_LANE, contents)
        write_grid(store, dataset(contents.layout, contents.layout.pending()))
        try:
            store.rename(path)
        except OSError:
            if not path.exists():
                raise


def extend(path: Path, contents: Contents) -> None:
    """Add lanes or variables to the store at a path, or give it other axes; no result changes.
    Remove the grid, the copy of the results along the axes, which is then outdated."""
    with unfinished(path) as group:
        _write(group, contents)
        _move_all(group, path / BY_LANE)
    remove_grid(path)


def remove_abandoned(path: Path) -> None:
    """Remove folders beside a store that are `unfinished` and older than `ABANDONED_AFTER`."""
    for partial in path.parent.glob(f".{glob.escape(path.name)}.*.partial"):
        with suppress(FileNotFoundError):
            if time.time() - partial.stat().st_mtime > ABANDONED_AFTER:
                shutil.rmtree(partial)


def contents_of(path: Path) -> Contents:
    """Read the contents of the store at a path; errors are those of `open_sweep`."""
    # Attributes are settings and notes of the sweep, and the store's own, which begin with `_OWN`.
    group, attrs = _opened(path)
    stored = {name: attrs.pop(name) for name in list(attrs) if name.startswith(_OWN)}
    notes = {name: attrs.pop(name) for name in stored["sweep_notes"]}
    settings = attrs
    path = path / BY_LANE  # the folder of `group`
    # `order` is the lane in each row, and `row_of` its inverse, the row of each lane.
    order = _values(path, group, stored["sweep_order"])
    row_of = np.argsort(order)
    axis_names, label_names = stored[f"{_OWN}axes"], stored[f"{_OWN}coordinates"]
    digests = stored[f"{_OWN}digests"]  # names of arrays, by the keys of `Identity.lanes`
    axes, zipped = [], stored["sweep_zipped"]
    for dim, name in enumerate(axis_names):
        axis = _labels(path, group, name)
        values = axis.values[row_of]
        if not zipped:
            # The store has the axis's value in every lane; `Layout` needs each value once: those of
            # the lanes that have the first values of all other axes.
            shape = stored["sweep_shape"]
            values = np.moveaxis(values.reshape(shape), dim, -1).reshape(-1, shape[dim])[0]
        axes.append(axis._replace(values=values))
    # All arrays that are not labels are variables.
    labels = {*axis_names, *label_names, *digests.values(), stored["sweep_order"]}
    variables = {name: _variable(array) for name, array in group.arrays() if name not in labels}
    chunk, coordinates = stored["sweep_chunk"], tuple(_labels(path, group, n) for n in label_names)
    layout = Layout(tuple(axes), chunk, variables, coordinates, settings, zipped, notes)
    lanes = {name: _values(path, group, array)[row_of] for name, array in digests.items()}
    identity = Identity(stored["sweep_programs"], lanes)
    # Names of the variables that were added after the store was made.
    return Contents(layout, identity, order, added=frozenset(stored[ADDED]))


def _opened(path: Path) -> "tuple[zarr.Group, dict[str, Any]]":
    """Open a store, and return its group `by_lane` and the attributes of this group."""
    file = path / BY_LANE / ROOT
    try:
        # Older versions had the lanes in `path` itself. Their format is read, and refused below.
        root = json.loads((file if file.exists() else path / ROOT).read_text())
        attrs: dict[str, Any] = root["attributes"]
        version = attrs[_FORMAT]
    except (FileNotFoundError, NotADirectoryError, ValueError, KeyError, TypeError) as error:
        raise ValueError(
            f"Argument `path` must name the store of a sweep, but {path} is not a store, or {file} "
            "is missing or damaged: pass another path, or delete this one."
        ) from error
    other = f"not {version} as written by other versions of clearjoint"
    expected = f"a store of format {_VERSION}, {other}"
    remedy = "read it with xarray.open_zarr, and sweep into another path"
    require(version == _VERSION, "path", str(path), expected, remedy)
    # The digest covers all metadata but itself, so it is taken out of `root` before the comparison.
    if attrs.pop(_DIGEST, None) != _digest(root):
        raise ValueError(
            f"The store {path} can't be read, because {file} is damaged: restore that file from a "
            "copy, or delete the store to compute it again."
        )
    return opened_group(path / BY_LANE), attrs


def _digest(root: Mapping[str, Any]) -> str:
    return digest(json.dumps(root, sort_keys=True))


def _write(path: Path, contents: Contents) -> None:
    """Write the group `by_lane` of a new or extended store, without results."""
    import zarr

    layout, identity, order, added = contents
    # The array of `order`, the lane in each row, has a digest of it in its name. An extended store
    # has another order, under another name, so that a concurrent reader still finds the earlier.
    order_name = f"sweep_order_{digest(order.tobytes())}"
    # The digests of the runs themselves have an empty name.
    digests = {name: f"sweep_lanes_{name}" if name else "sweep_lanes" for name in identity.lanes}
    store_attributes = {
        "sweep_axes": [axis.name for axis in layout.axes],
        "sweep_shape": list(layout.shape),
        "sweep_zipped": layout.zipped,
        "sweep_chunk": layout.chunk,
        "sweep_coordinates": [c.name for c in layout.coordinates],
        "sweep_notes": list(layout.notes),
        "sweep_programs": dict(identity.programs),
        "sweep_digests": digests,
        "sweep_order": order_name,
        ADDED: sorted(added),
        _FORMAT: _VERSION,
    }
    attributes = {**layout.settings, **layout.notes, **store_attributes}
    group = zarr.create_group(path, zarr_format=3, attributes=attributes)
    # Labels along the lanes: values of the axes, digests of the lanes, and the order.
    columns = layout.values()
    along_lanes = [
        *(axis._replace(values=columns[axis.name][order]) for axis in layout.axes),
        *(Coordinate(digests[name], values[order]) for name, values in identity.lanes.items()),
        Coordinate(order_name, order),
    ]
    labels = [(coordinate, LANE, layout.chunk) for coordinate in along_lanes]
    labels += [(c, c.name, max(len(c.values), 1)) for c in layout.coordinates]
    for coordinate, dim, chunk in labels:
        _write_label(path, group, coordinate, dim, chunk)
    for name, variable in layout.variables.items():
        group.create_array(
            name,
            shape=(layout.lanes, *variable.shape),
            # A file has a chunk of lanes, with all other dimensions. A dimension may be empty, but
            # a chunk must not be.
            chunks=(layout.chunk, *(max(size, 1) for size in variable.shape)),
            dtype=variable.dtype,
            fill_value=variable.fill,
            compressors=compressors(),
            dimension_names=(LANE, *variable.dims),
            attributes=variable.attributes,
        )
    with warnings.catch_warnings():
        # Consolidated metadata are a draft in format 3. Without them, opening the store reads a
        # file for every array.
        warnings.filterwarnings("ignore", "Consolidated metadata")
        zarr.consolidate_metadata(group.store)
    # The digest covers all metadata but itself.
    root = json.loads((path / ROOT).read_text())
    root["attributes"][_DIGEST] = _digest(root)
    (path / ROOT).write_text(json.dumps(root, indent=2))


def _write_label(
    path: Path, group: "zarr.Group", coordinate: Coordinate, dim: str, chunk: int
) -> None:
    """Write an array of labels along the dimension `dim`, in chunks of the length `chunk`, to the
    Zarr `group` in the folder `path`."""
    values = coordinate.values
    attributes: dict[str, Any] = dict(coordinate.attributes)
    array = group.create_array(
        coordinate.name,
        shape=values.shape,
        chunks=(chunk,),
        dtype=str if values.dtype.kind == "U" else values.dtype,
        compressors=compressors(),
        dimension_names=(dim,),
        attributes=attributes,
    )
    write(path, array, values)


def _values(path: Path, group: "zarr.Group", name: str) -> np.ndarray:
    """Read an array of labels; raise a `ValueError` if its file is missing or damaged."""
    array = opened(group, name)
    values, faults = read(path, array)
    for chunk, fault in faults.items():
        file = chunk_file(path, array, chunk)
        raise ValueError(
            f"The store {path.parent} can't be read, because its file {file} is {fault}: "
            "restore that file from a copy, or delete the store to compute it again."
        )
    return values


def _labels(path: Path, group: "zarr.Group", name: str) -> Coordinate:
    unit = str(group[name].attrs.get("units", "1"))
    return Coordinate(name, _values(path, group, name), unit)


def _variable(array: "zarr.Array") -> Variable:
    attrs: dict[str, Any] = dict(array.attrs)
    unit, description = attrs.pop("units", ""), attrs.pop("long_name")
    metadata: Any = array.metadata
    dims, shape = tuple(metadata.dimension_names[1:]), array.shape[1:]
    return Variable(dims, shape, str(array.dtype), unit, description, attrs)
