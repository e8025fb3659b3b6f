"""The files of a Zarr array, one a chunk of lanes, read so that damage to one is told and costs no
other."""

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    import zarr
    from zarr.abc.codec import BytesBytesCodec

MISSING, DAMAGED = "missing", "damaged"


def opened_group(path: Path, mode: Literal["r", "r+"]) -> "zarr.Group":
    """The group of a store's arrays, to be read or written, with the metadata of all at once."""
    import zarr

    return zarr.open_group(path, mode=mode, use_consolidated=True)


def checked() -> "tuple[BytesBytesCodec, ...]":
    """How chunks are written: compressed, behind a checksum."""
    from zarr.codecs import Crc32cCodec, ZstdCodec

    return ZstdCodec(), Crc32cCodec()


def opened(group: "zarr.Group", name: str) -> "zarr.Array":
    """An array of a group, which writes a file for every chunk, so that none can be lost unseen."""
    import zarr

    with zarr.config.set({"array.write_empty_chunks": True}):
        array = group[name]
    assert isinstance(array, zarr.Array)
    return array


def chunk_file(path: Path, array: "zarr.Array", chunk: int) -> Path:
    """The file of a chunk of an array in the store at a path."""
    return path / array.path / array.metadata.encode_chunk_key((chunk,) + (0,) * (array.ndim - 1))


def read(path: Path, array: "zarr.Array") -> tuple[np.ndarray, dict[int, str]]:
    """The values of an array in the store at a path, and the chunks of which it has none: that
    their file is missing, or damaged. They are left at the fill value."""
    count = -(-array.shape[0] // array.chunks[0])
    faults = {k: MISSING for k in range(count) if not chunk_file(path, array, k).exists()}
    try:
        return np.asarray(array[:]), faults
    except ValueError:  # A checksum does not agree.
        values = np.full(array.shape, array.fill_value, array.dtype)
        for chunk in range(count):
            span = slice(chunk * array.chunks[0], (chunk + 1) * array.chunks[0])
            try:
                values[span] = array[span]
            except ValueError:
                faults[chunk] = DAMAGED
        return values, faults
