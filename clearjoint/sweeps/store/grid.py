"""Grid of a store: a copy of the results along the axes of the sweep, for programs that read Zarr.

The folder `BY_LANE` of a store has the results by lane, so that lanes can be written one by one and
more lanes can be added. The grid has the same results along the axes, for `xarray.open_zarr(path)`.
It is written when a store is made, about once a minute during the sweep, and when the sweep ends.
Since the grid is only a copy, no result is lost if writing it fails.
"""

import shutil
import uuid
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..layout import BY_LANE, RESULT

if TYPE_CHECKING:
    import xarray as xr

ROOT = "zarr.json"
"""File with the metadata of a Zarr group, which lists its arrays."""


@contextmanager
def unfinished(path: Path) -> Iterator[Path]:
    """Yield a new path beside that of a store, for a store or grid that is being written.

    Within the context the caller writes it, and moves it or its files to their place when it is
    complete; the rest is removed afterwards.
    """
    new = path.with_name(f".{path.name}.{uuid.uuid4().hex}.partial")
    try:
        yield new
    finally:
        shutil.rmtree(new, ignore_errors=True)


def move(file: Path, to: Path) -> None:
    """Move a file, also to a folder that does not exist yet."""
    to.parent.mkdir(parents=True, exist_ok=True)
    file.replace(to)


def write_grid(path: Path, results: "xr.Dataset") -> None:
    """Write results as the grid of the store at a path, in place of an earlier grid.

    If the arrays differ in names, shapes or attributes from those of the earlier grid, a program
    that opens the grid in the meantime finds none. Otherwise files are replaced one by one, with
    the result codes last, so that a lane whose code says that it is done has all its numbers.

    **Arguments:** `path`: folder of the store; `results`: results along the axes of the sweep.
    """
    from zarr.codecs import Crc32cCodec, ZstdCodec

    codecs = {"compressors": (ZstdCodec(), Crc32cCodec())}
    with unfinished(path) as new:
        with warnings.catch_warnings():
            # Zarr warns that version 3 of its format doesn't specify texts and consolidated
            # metadata yet.
            warnings.simplefilter("ignore")
            encoding = {str(name): codecs for name in results.variables}
            results.to_zarr(
                new,
                mode="w",
                zarr_format=3,
                consolidated=True,
                encoding=encoding,
                # Zarr would omit the file of an empty chunk, and that of an older grid would stay.
                write_empty_chunks=True,
            )
        # The file `ROOT` lists the arrays. If it changes, it is removed first and written last, so
        # that a reader finds either all arrays or none. Result codes are written after all other
        # arrays, so that no lane counts as done before its numbers exist.
        root, old_root = new / ROOT, path / ROOT
        if not old_root.exists() or root.read_bytes() != old_root.read_bytes():
            remove_grid(path)
        files = [file.relative_to(new) for file in new.rglob("*") if file.is_file()]
        # The key is smallest for other arrays, since `False` is less than `True`, then for result
        # codes, and largest for `ROOT`.
        for file in sorted(files, key=lambda file: (file == Path(ROOT), file.parts[0] == RESULT)):
            move(new / file, path / file)


def remove_grid(path: Path) -> None:
    """Remove the grid from the store at a path; results by lane stay."""
    (path / ROOT).unlink(missing_ok=True)
    for entry in path.iterdir():
        if entry.name != BY_LANE and entry.is_dir():
            shutil.rmtree(entry)


def grid_shows(path: Path, results: "xr.Dataset") -> bool:
    """Return whether the grid at a path has the same variables and result codes as `results`.

    If so, it need not be written again, since the numbers of a lane do not change once it has a
    result code.
    """
    import xarray as xr

    try:
        with xr.open_zarr(path, chunks=None) as grid:
            return set(grid.variables) == set(results.variables) and np.array_equal(
                grid[RESULT].values, results[RESULT].values
            )
    except (OSError, ValueError, KeyError):
        return False
