"""Results of a sweep in a Zarr store (format 3) on disk, chunk by chunk.

In the folder `by_lane`, each variable is an array whose first dimension is `lane` and whose chunks
are the sweep's, so that writing a chunk touches no file of another. A chunk's piece of `result` is
written last: where it is missing, the lanes read as pending, whatever else a killed process has
left of the chunk. Writing a chunk again is harmless, also by two processes at once, which wait for
each other. Beside the folder are the same results along the axes, for any reader of Zarr
(`.grid`).

Every file has a checksum, which its place is part of. A chunk of which one is damaged, another's or
gone reads as pending too, with a warning that names it, and is computed anew.

A store takes further lanes, behind those it has, and further variables: it knows its lanes by the
numbers that they start from, and variables by the programs that compute them. Nothing else of it
changes after creation.
"""

import errno
import os
import time
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...fields.types import ArrayLike
from ..layout import BY_LANE, PENDING, RESULT, Layout, dataset
from .chunks import DAMAGED, MISSING, chunk_file, locked, opened, opened_group, read
from .differences import differences
from .grid import grid_shows, write_grid
from .identity import Identity, places
from .metadata import ADDED, Contents, contents_of, create, extend, labelled, remove_remains
from .program import RUN

if TYPE_CHECKING:
    import xarray as xr
    import zarr

_NAMED = 5
"""Damaged files that a warning names."""
GRID_PERIOD, GRID_SHARE = 60.0, 0.02
"""Seconds between two writings of the grid while a store is filled, and largest share of the time
that they may take."""


class SweepMemory:
    """Results in memory, with the methods of a `SweepStore`."""

    def __init__(self, layout: Layout):
        self.layout = layout
        self._arrays = layout.pending()

    def missing(self) -> dict[int, list[int]]:
        """By chunk the lanes that are not done."""
        return _missing(self._arrays[RESULT], np.arange(self.layout.lanes), self.layout.chunk)

    def write(self, chunk: int, lanes: Sequence[int], arrays: Mapping[str, ArrayLike]) -> None:
        """Keep results of lanes of a chunk."""
        del chunk
        for name, values in self.layout.checked(len(lanes), arrays).items():
            self._arrays[name][lanes] = values

    def write_grid(self) -> None:
        """Do nothing: in memory there is nothing for other programs."""

    def dataset(self) -> "xr.Dataset":
        """All results with labels; lanes that are not done have the `result` -1, pending."""
        return dataset(self.layout, self._arrays)


class SweepStore:
    """Results in a folder on disk; take `SweepStore.open`."""

    def __init__(self, path: Path, contents: Contents):
        self.path, self._contents = path, contents
        self.layout = contents.layout
        self._folder = path / BY_LANE
        self._place = np.argsort(contents.order)
        self._grid_written, self._grid_seconds = time.monotonic(), 0.0

    @classmethod
    def open(cls, path: str | os.PathLike, layout: Layout, identity: Identity) -> "SweepStore":
        """Open the store at a path, or create it; what it lacks of lanes and variables is added.

        **Raises:** `ValueError` if what is there is no sweep, or one of which lanes, variables or
        settings are none of this.
        """
        path = Path(path)
        remove_remains(path)
        if not path.exists():
            create(path, Contents(layout, identity, np.arange(layout.lanes)))
        contents_of(path)
        with locked(path / BY_LANE):
            stored = contents_of(path)
            wanted = _joined(path, stored, Contents(layout, identity, stored.order))
            lanes, variables = len(stored.order), set(stored.layout.variables)
            if lanes < layout.lanes or variables < set(layout.variables):
                extend(path, wanted)
                write_grid(path, _labelled(path, wanted))
        return cls(path, wanted)

    def missing(self) -> dict[int, list[int]]:
        """By chunk the lanes that are not done.

        **Raises:** `PermissionError` if there are any and the store can't be written to, before
        anybody computes them.
        """
        group = opened_group(self._folder, "r")
        codes = _arrays(self.path, group, self._contents)[RESULT]
        missing = _missing(codes, self._contents.order, self.layout.chunk)
        if missing and not os.access(self._folder, os.W_OK):
            text = "Lanes are missing in this store, which can't be written to"
            raise PermissionError(errno.EACCES, text, str(self._folder))
        return missing

    def write(self, chunk: int, lanes: Sequence[int], arrays: Mapping[str, ArrayLike]) -> None:
        """Put results of lanes of a chunk on disk; when this returns they are done."""
        results = self.layout.checked(len(lanes), arrays)
        with locked(self._folder):
            # Opened anew, since another process may have extended the store.
            group = opened_group(self._folder, "r+")
            added = group.attrs[ADDED]
            assert isinstance(added, list)
            for name in set(map(str, added)) - set(results):
                # Of these lanes, this process has no values of a variable that another one added.
                chunk_file(self._folder, opened(group, name), chunk).unlink(missing_ok=True)
            first, size = chunk * self.layout.chunk, self.layout.chunk
            span = slice(first, min(first + size, opened(group, RESULT).shape[0]))
            rows = self._place[list(lanes)] - first
            if len(lanes) < span.stop - first:
                results = self._merged(group, chunk, span, rows, results)
            else:
                results = {name: values[np.argsort(rows)] for name, values in results.items()}
            for name in sorted(results, key=lambda name: name == RESULT):
                array = opened(group, name)
                array[span] = results[name]
                _flush(chunk_file(self._folder, array, chunk))
        self._write_grid_if_due()

    def _merged(
        self,
        group: "zarr.Group",
        chunk: int,
        span: slice,
        rows: np.ndarray,
        results: Mapping[str, np.ndarray],
    ) -> dict[str, np.ndarray]:
        """The chunk's lanes with results in some rows; the others as they are on disk, or pending
        if something of the chunk is missing there."""
        arrays = {name: opened(group, name) for name in results}
        merged = {
            name: np.full((span.stop - span.start, *v.shape[1:]), self._fill(name), v.dtype)
            for name, v in results.items()
        }
        try:
            if all(chunk_file(self._folder, a, chunk).exists() for a in arrays.values()):
                merged = {name: np.asarray(array[span]) for name, array in arrays.items()}
        except ValueError:  # A checksum does not agree.
            pass
        if (merged[RESULT] == PENDING).all():
            chunk_file(self._folder, arrays[RESULT], chunk).unlink(missing_ok=True)
        for name, values in results.items():
            merged[name][rows] = values
        return merged

    def _fill(self, name: str) -> bool | int | float:
        return self.layout.variables[name].fill

    def write_grid(self) -> None:
        """Write the results along the axes, for other programs, unless they are there."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # `dataset` tells of damage.
            results = _labelled(self.path, contents_of(self.path))
        if not grid_shows(self.path, results):
            with locked(self._folder):
                write_grid(self.path, results)

    def _write_grid_if_due(self) -> None:
        begun = time.monotonic()
        if begun - self._grid_written > max(GRID_PERIOD, self._grid_seconds / GRID_SHARE):
            self.write_grid()
            self._grid_written = time.monotonic()
            self._grid_seconds = self._grid_written - begun

    def dataset(self) -> "xr.Dataset":
        """All results with labels; lanes that are not done have the `result` -1, pending."""
        return _labelled(self.path, self._contents)


def open_sweep(path: str | os.PathLike) -> "xr.Dataset":
    """The results in a sweep's store, along its axes; also while the sweep is running.

    Lanes that are not done have the `result` -1 (pending); their numbers are NaN, -1 in integers.
    So have those of which something on disk is damaged, with a warning that names the files; the
    same call of `sweep` computes them anew. All of it comes into memory.

    ``xarray.open_zarr(path)`` opens the same results piece by piece. While a sweep is running, or
    after it was killed, it may show lanes of the last minute as pending.

    **Raises:** `ValueError` if there is no sweep's store at the path.

    >>> axis = cj.Axis(lambda scene: scene.forces["spring"].stiffness, [100.0, 400.0])
    >>> outputs = {"speed": cj.Peak(cj.quantities.Velocity("ball"), "m/s")}
    >>> _ = cj.sweep(
    ...     scene, state, 0.5, {"stiffness": axis}, outputs, path="ball.zarr", progress=False
    ... )
    >>> np.round(cj.open_sweep("ball.zarr")["speed"].values, 4)
    array([1., 2.])
    """
    path = Path(path)
    return _labelled(path, contents_of(path))


def _joined(path: Path, stored: Contents, wanted: Contents) -> Contents:
    """The wanted contents in the order of those stored, with what these lack behind."""
    here = wanted.identity.lanes[RUN]
    kept = places(stored.identity.lanes[RUN][stored.order], here)
    lines = differences(stored, wanted, kept)
    if lines:
        raise ValueError(
            f"The store {path} belongs to another sweep:\n  "
            + "\n  ".join(lines)
            + "\nPass another path, or delete the store to compute it anew."
        )
    order = np.concatenate([kept, np.setdiff1d(np.arange(len(here)), kept)])
    added = stored.added | (set(wanted.layout.variables) - set(stored.layout.variables))
    return wanted._replace(order=order, added=added)


def _missing(codes: np.ndarray, order: np.ndarray, chunk: int) -> dict[int, list[int]]:
    """By chunk the lanes that are pending, of codes in the order of the store."""
    pending: dict[int, list[int]] = {}
    for place in np.flatnonzero(codes == PENDING):
        pending.setdefault(int(place) // chunk, []).append(int(order[place]))
    return pending


def _labelled(path: Path, contents: Contents) -> "xr.Dataset":
    group = opened_group(path / BY_LANE, "r")
    return labelled(contents, _arrays(path, group, contents))


def _arrays(path: Path, group: "zarr.Group", contents: Contents) -> dict[str, np.ndarray]:
    """The variables of all lanes in the order of the store, and nothing of chunks that are not
    done, or of which something is damaged.

    The codes are read first: a chunk that another process ends meanwhile stays pending.
    """
    layout, damaged, folder = contents.layout, [], path / BY_LANE
    arrays: dict[str, np.ndarray] = {}
    lanes = slice(len(contents.order))  # Another process may have added some.
    codes, faults = read(folder, opened(group, RESULT))
    codes = codes[lanes]
    done = codes != PENDING
    for chunk in [chunk for chunk, fault in faults.items() if fault == DAMAGED]:
        damaged.append(f"{chunk_file(folder, opened(group, RESULT), chunk)} is {DAMAGED}")
    for name in [name for name in layout.variables if name != RESULT]:
        array = opened(group, name)
        values, faults = read(folder, array)
        arrays[name] = values[lanes]
        for chunk, fault in faults.items():
            span = layout.span(chunk)
            if done[span].any() and not (fault == MISSING and name in contents.added):
                damaged.append(f"{chunk_file(folder, array, chunk)} is {fault}")
            codes[span] = PENDING
    for name, values in arrays.items():
        values[codes == PENDING] = layout.variables[name].fill
    if damaged:
        _warn(path, damaged)
    return {RESULT: codes, **arrays}


def _warn(path: Path, damaged: Sequence[str]) -> None:
    more = f", and {len(damaged) - _NAMED} more" if len(damaged) > _NAMED else ""
    warnings.warn(
        f"The store {path} is damaged: {', '.join(damaged[:_NAMED])}{more}. The lanes of these "
        "chunks are pending; sweep with the same arguments to compute them anew.",
        stacklevel=4,
    )


def _flush(path: Path) -> None:
    """Have a file's bytes on disk before going on."""
    with path.open("r+b") as file:
        os.fsync(file.fileno())
