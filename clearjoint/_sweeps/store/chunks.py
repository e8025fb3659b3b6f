"""Files of a store's Zarr arrays, one for each chunk of lanes and each array.

A file ends with a checksum of its content and of its path in the store, which reveals a damaged
file, or one that was moved to the place of another. Files have Zarr's format, but are encoded,
written and read here, because Zarr hands each file to several threads: under the load of a sweep,
that took 4 ms a file, and a chunk has a file for each variable.
The argument `path` of functions is the folder of the group that has the array.
"""

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..._compilation.digests import DIGITS, digest
from ..._compilation.program_store import system_errors_suppressed

if TYPE_CHECKING:
    import zarr
    from numcodecs.abc import Codec
    from zarr.abc.codec import BytesBytesCodec

MISSING, DAMAGED = "missing", "damaged"
"""Faults of the file of a chunk. A file is damaged if its checksum is not that of its content."""
_LOCK = ".lock"
"""Name of the file by which processes lock a folder."""


def opened_group(path: Path) -> "zarr.Group":
    import zarr

    return zarr.open_group(path, mode="r", zarr_format=3, use_consolidated=True)


def opened(group: "zarr.Group", name: str) -> "zarr.Array":
    import zarr

    array = group[name]
    assert isinstance(array, zarr.Array)
    return array


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Context in which this process alone may change a store: it holds the lock of the folder,
    which is released if the process dies. If the system has no locks, or the folder can't be
    written to, the context begins at once and without a lock."""
    with ExitStack() as stack:
        # Windows has no such locks, a folder may be read only, and some file systems lack locks.
        with suppress(ImportError), system_errors_suppressed():
            import fcntl

            file = stack.enter_context((folder / _LOCK).open("w"))
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


def chunk_file(path: Path, array: "zarr.Array", chunk: int) -> Path:
    return path / _key(array, chunk)


def _key(array: "zarr.Array", chunk: int) -> str:
    """Return the path of a chunk's file, relative to the folder of the group."""
    indices = (chunk,) + (0,) * (array.ndim - 1)
    return f"{array.path}/{array.metadata.encode_chunk_key(indices)}"


def compressors() -> "tuple[BytesBytesCodec, ...]":
    """Return the compressors that `read_chunk` and `write_chunk` use. They were Zarr's default when
    the first stores were written."""
    from zarr.codecs import ZstdCodec

    return (ZstdCodec(level=0, checksum=False),)


def make_folder(folder: Path) -> None:
    # With `exist_ok`, Python takes any error for that of an existing folder, also a `TimeoutError`
    # of a signal handler.
    with suppress(FileExistsError):
        os.makedirs(folder)


def _codec(array: "zarr.Array") -> "Codec | None":
    """Return the encoder of an array of texts; ``None`` for numbers, whose bytes are stored."""
    from numcodecs.vlen import VLenUTF8

    return None if array.dtype.kind in "biuf" else VLenUTF8()


def _dtype(array: "zarr.Array") -> np.dtype:
    return np.dtype(object) if _codec(array) else array.dtype.newbyteorder("<")


def write_chunk(path: Path, array: "zarr.Array", chunk: int, values: np.ndarray) -> Path:
    """Write the rows `values` of one chunk of an array, and return the path of the file. A reader
    finds either the earlier file or the new one, also after an `OSError`, as on a full disk."""
    from numcodecs.zstd import Zstd

    file, codec = chunk_file(path, array, chunk), _codec(array)
    # Zarr stores chunks in full size.
    rows = np.full(array.chunks, array.fill_value, _dtype(array))
    rows[tuple(map(slice, values.shape))] = values
    content = bytes(Zstd(level=0).encode(codec.encode(rows) if codec else rows.tobytes()))
    make_folder(file.parent)
    # The lock of the store allows one process at a time to write, so that the name can be the same
    # each time, and the file that a killed process leaves is written over.
    new = file.with_name(f"{file.name}.partial")
    try:
        new.write_bytes(content + digest(_key(array, chunk), content).encode())
        new.replace(file)
    except BaseException:
        with suppress(OSError):
            new.unlink()
        raise
    return file


def read_chunk(path: Path, array: "zarr.Array", chunk: int) -> np.ndarray | str:
    """Return the rows of one chunk of an array, or the fault, `MISSING` or `DAMAGED`."""
    from numcodecs.zstd import Zstd

    file, codec = chunk_file(path, array, chunk), _codec(array)
    try:
        stored = file.read_bytes()
    except FileNotFoundError:
        return MISSING
    content, checksum = stored[:-DIGITS], stored[-DIGITS:]
    if checksum != digest(_key(array, chunk), content).encode():
        return DAMAGED
    decoded = bytes(Zstd().decode(content))
    # Texts are encoded before they are compressed. Of numbers, the bytes are compressed.
    entries = codec.decode(decoded) if codec else np.frombuffer(decoded, _dtype(array))
    rows = np.asarray(entries).reshape(array.chunks)
    # A file has the rows of a full chunk, also if the array ends inside the chunk.
    rows_left = array.shape[0] - chunk * array.chunks[0]
    return rows[tuple(map(slice, (min(rows_left, len(rows)), *array.shape[1:])))]


def write(path: Path, array: "zarr.Array", values: np.ndarray) -> None:
    for chunk, first in enumerate(range(0, len(values), array.chunks[0])):
        write_chunk(path, array, chunk, values[first : first + array.chunks[0]])


def read(path: Path, array: "zarr.Array") -> tuple[np.ndarray, dict[int, str]]:
    """Return the values of an array, and the faults of its files by the index of the chunk. The
    values in chunks with a fault are the fill value."""
    values, faults = np.full(array.shape, array.fill_value, _dtype(array)), {}
    for chunk, first in enumerate(range(0, array.shape[0], array.chunks[0])):
        rows = read_chunk(path, array, chunk)
        if isinstance(rows, str):
            faults[chunk] = rows
        else:
            values[first : first + len(rows)] = rows
    return values, faults
