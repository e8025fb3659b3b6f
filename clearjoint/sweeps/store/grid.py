"""The labelled results in a store, as any program finds them that reads Zarr.

The lanes of a store are in the folder `BY_LANE`, where they can be written one by one, and further
ones can join them. Beside it are the same results along the axes, which `xarray.open_zarr(path)`
opens. They are written when a store is made, once a minute or so while it is being filled, and when
a sweep ends; where that fails, nothing is lost.
"""

import shutil
import uuid
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..layout import RESULT

if TYPE_CHECKING:
    import xarray as xr

BY_LANE = Path("by_lane")
"""Folder of the lanes in a store."""
ROOT = "zarr.json"
"""File with the metadata of a group."""


def unfinished(path: Path) -> Path:
    """A new name beside a path, for what is not yet complete."""
    return path.with_name(f".{path.name}.{uuid.uuid4().hex}.partial")


def write_grid(path: Path, results: "xr.Dataset") -> None:
    """Write labelled results into the store at a path, in the place of those there.

    The file that names the arrays goes first and comes last, unless it stays the same: who opens
    the grid meanwhile finds none, but no mixture of two.
    """
    from zarr.codecs import Crc32cCodec, ZstdCodec

    codecs = {"compressors": (ZstdCodec(), Crc32cCodec())}
    new = unfinished(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Texts and consolidated metadata are drafts.
            encoding = {str(name): codecs for name in results.variables}
            results.to_zarr(new, mode="w", zarr_format=3, consolidated=True, encoding=encoding)
        if not _same(new / ROOT, path / ROOT):
            remove_grid(path)
        files = [file.relative_to(new) for file in new.rglob("*") if file.is_file()]
        for file in sorted(files, key=lambda file: file == Path(ROOT)):
            (path / file).parent.mkdir(parents=True, exist_ok=True)
            (new / file).replace(path / file)
    finally:
        shutil.rmtree(new, ignore_errors=True)


def remove_grid(path: Path) -> None:
    """Remove the labelled results from the store at a path."""
    (path / ROOT).unlink(missing_ok=True)
    for entry in path.iterdir():
        if entry.name != BY_LANE.name and entry.is_dir():
            shutil.rmtree(entry)


def grid_shows(path: Path, results: "xr.Dataset") -> bool:
    """Whether the grid in the store at a path has the lanes of these results."""
    import xarray as xr

    try:
        with xr.open_zarr(path, chunks=None) as found:
            return set(found.variables) == set(results.variables) and np.array_equal(
                found[RESULT].values, results[RESULT].values
            )
    except (OSError, ValueError, KeyError):
        return False


def _same(one: Path, other: Path) -> bool:
    return other.exists() and one.read_bytes() == other.read_bytes()
