"""Results of a sweep in a Zarr store (format 3) on disk, chunk by chunk.

Each variable is an array whose first dimension is `lane` and whose chunks are the sweep's, so that
writing a chunk touches no file of another. A chunk's piece of `result` is written last, to a
temporary file that takes its final name when all bytes are on disk: where it is missing, the lanes
read as pending, whatever else a killed process has left of the chunk. Writing a chunk again is
harmless, also by two processes at once. Nothing of the metadata changes after creation, which
happens under another name.
"""

import glob
import os
import shutil
import time
import uuid
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
import zarr

from .differences import differences
from .layout import PENDING, RESULT, Layout, dataset
from .metadata import read_layout, write_layout

ABANDONED_AFTER = 3600.0
"""Age, s, from which on nobody works at what is not yet under its name: that takes a second."""


class SweepMemory:
    """Results in memory, with the methods of a `SweepStore`."""

    def __init__(self, layout: Layout):
        self.layout = layout
        self._arrays = layout.pending()

    def missing(self) -> list[int]:
        """Numbers of the chunks that are not done."""
        return _missing(self.layout, self._arrays[RESULT])

    def write(self, chunk: int, arrays: Mapping[str, Any]) -> None:
        """Keep a chunk's results."""
        for name, values in self.layout.checked(chunk, arrays).items():
            self._arrays[name][self.layout.span(chunk)] = values

    def dataset(self) -> xr.Dataset:
        """All results with labels; lanes that are not done have the `result` -1, pending."""
        return dataset(self.layout, self._arrays)


class SweepStore:
    """Results in a folder on disk; take `SweepStore.open`."""

    def __init__(self, path: Path, layout: Layout):
        self.path, self.layout = path, layout
        self._group = zarr.open_group(path, mode="r+", use_consolidated=True)

    @classmethod
    def open(cls, path: str | os.PathLike, layout: Layout) -> "SweepStore":
        """Open the store at a path, or create it.

        **Raises:** `ValueError` if what is there is no sweep, or one whose axes, variables or
        settings are others.
        """
        path = Path(path)
        _remove_remains(path)
        if not path.exists():
            _create(path, layout)
        found = differences(read_layout(path), layout)
        if found:
            raise ValueError(
                f"The store {path} belongs to another sweep:\n  "
                + "\n  ".join(found)
                + "\nPass another path, or delete the store to compute it anew."
            )
        return cls(path, layout)

    def missing(self) -> list[int]:
        """Numbers of the chunks that are not done."""
        return _missing(self.layout, _values(self._group, RESULT))

    def write(self, chunk: int, arrays: Mapping[str, Any]) -> None:
        """Put a chunk's results on disk; when this returns the chunk is done."""
        results = self.layout.checked(chunk, arrays)
        span = self.layout.span(chunk)
        for name, values in results.items():
            if name != RESULT:
                self._array(name)[span] = values
                _flush(self._file(name, chunk))
        codes = np.full(self.layout.chunk, PENDING, results[RESULT].dtype.newbyteorder("<"))
        codes[: span.stop - span.start] = results[RESULT]
        _replace(self._file(RESULT, chunk), codes.tobytes())

    def dataset(self) -> xr.Dataset:
        """All results with labels; lanes that are not done have the `result` -1, pending."""
        return dataset(self.layout, _arrays(self._group, self.layout))

    def _array(self, name: str) -> zarr.Array:
        array = self._group[name]
        assert isinstance(array, zarr.Array)
        return array

    def _file(self, name: str, chunk: int) -> Path:
        array = self._array(name)
        key = array.metadata.encode_chunk_key((chunk,) + (0,) * (array.ndim - 1))
        return self.path / name / key


def open_sweep(path: str | os.PathLike) -> xr.Dataset:
    """The results in a sweep's store, along its axes; also while the sweep is running.

    Lanes that are not done have the `result` -1 (pending); their numbers are NaN, -1 in integers.
    All of it comes into memory: what is larger opens lane by lane with `xarray.open_zarr(path)`.

    **Raises:** `ValueError` if there is no sweep's store at the path.
    """
    layout = read_layout(Path(path))
    group = zarr.open_group(path, mode="r", use_consolidated=True)
    return dataset(layout, _arrays(group, layout))


def _missing(layout: Layout, codes: np.ndarray) -> list[int]:
    """Chunks of which a lane is pending."""
    return np.unique(np.flatnonzero(codes == PENDING) // layout.chunk).tolist()


def _arrays(group: zarr.Group, layout: Layout) -> dict[str, np.ndarray]:
    """The variables of all lanes, and nothing of chunks that are not done.

    The codes are read first: a chunk that another process ends meanwhile stays pending.
    """
    codes = _values(group, RESULT)
    arrays = {RESULT: codes}
    for name, variable in layout.variables.items():
        if name != RESULT:
            arrays[name] = _values(group, name)
            arrays[name][codes == PENDING] = variable.fill
    return arrays


def _values(group: zarr.Group, name: str) -> np.ndarray:
    array: Any = group[name]
    return array[:]


def _create(path: Path, layout: Layout) -> None:
    """Make the store under another name, so that it is there as a whole or not at all."""
    making = path.with_name(f".{path.name}.{uuid.uuid4().hex}.partial")
    try:
        write_layout(making, layout)
        making.rename(path)
    except OSError:
        if not path.exists():  # Else another process was first.
            raise
    finally:
        shutil.rmtree(making, ignore_errors=True)


def _remove_remains(path: Path) -> None:
    """Remove what processes that were killed while they made or wrote this store have left."""
    made = path.parent.glob(f".{glob.escape(path.name)}.*.partial")
    for left in (*made, *(path / RESULT).rglob("*.partial")):
        with suppress(FileNotFoundError):
            if time.time() - left.stat().st_mtime > ABANDONED_AFTER:
                shutil.rmtree(left) if left.is_dir() else left.unlink()


def _flush(path: Path) -> None:
    """Have a file's bytes on disk before going on. Zarr makes none for a chunk of fill values."""
    if path.exists():
        with path.open("r+b") as file:
            os.fsync(file.fileno())


def _replace(path: Path, content: bytes) -> None:
    """Write a file that is there with all its content or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    writing = path.with_name(f"{path.name}.{uuid.uuid4().hex}.partial")
    try:
        with writing.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        writing.replace(path)
    finally:
        writing.unlink(missing_ok=True)
