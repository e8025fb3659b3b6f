"""Files of a store's Zarr arrays, one for each chunk of lanes and each array, with checksums.

A store holds the results of a sweep on disk. A lane is one run of the sweep, and a chunk a group of
lanes that are stored together.

A file ends with a checksum of its content and of its path in the store. So a damaged file, or one
that was moved to the place of another, is detected. Intact files can still be read.

Results are encoded and written here, as Zarr would do it, because Zarr hands each file to several
threads. Under the load of a sweep, that took 4 ms a file, and a chunk has a file for each variable.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from ...compilation.digests import DIGITS, digest

if TYPE_CHECKING:
    import zarr
    from zarr.abc.codec import BytesBytesCodec
    from zarr.abc.store import ByteRequest
    from zarr.core.buffer import Buffer, BufferPrototype
    from zarr.storage import LocalStore

MISSING, DAMAGED = "missing", "damaged"
"""Faults that the file of a chunk may have. A file is damaged if its checksum does not agree."""


class DamagedError(ValueError):
    """Raised for a file whose checksum does not agree. It has a class of its own, so that an error
    that a signal handler raises, such as a time limit, is not taken for damage."""


_LOCK = ".lock"
"""File in a store's folder by which processes lock the folder."""


def opened_group(path: Path, mode: Literal["r", "r+"]) -> "zarr.Group":
    """Open the Zarr group that has a store's arrays.

    **Arguments:** `path`: folder of the group, `by_lane` in the store; `mode`: "r" to read, "r+" to
    read and write.
    """
    import zarr

    files = checked_files()(path, read_only=mode == "r")
    return zarr.open_group(files, mode=mode, zarr_format=3, use_consolidated=True)


@cache
def checked_files() -> "type[LocalStore]":
    """Return a subclass of Zarr's `LocalStore` that writes and checks the checksums of chunks.

    Its method `get` raises `DamagedError` for a chunk that is damaged or belongs to another path.
    The class is made at the first call of this function, because importing zarr takes long.
    """
    from zarr.core.buffer import default_buffer_prototype
    from zarr.storage import LocalStore

    class CheckedFiles(LocalStore):
        async def get(
            self,
            key: str,
            prototype: "BufferPrototype | None" = None,
            byte_range: "ByteRequest | None" = None,
        ) -> "Buffer | None":
            # A part of a file can't be checked, because the checksum is that of the whole content.
            assert byte_range is None
            prototype = prototype or default_buffer_prototype()
            buffer = await super().get(key, prototype)
            if buffer is None or _is_metadata(key):
                return buffer
            return prototype.buffer.from_bytes(_checked(key, buffer.to_bytes()))

        async def set(self, key: str, value: "Buffer") -> None:
            # Files of metadata stay plain JSON; the store's own digest covers them.
            if not _is_metadata(key):
                value = type(value).from_bytes(_with_checksum(key, value.to_bytes()))
            await super().set(key, value)

    return CheckedFiles


def _is_metadata(key: str) -> bool:
    return key.endswith(".json")


def _with_checksum(key: str, content: bytes) -> bytes:
    return content + digest(key, content).encode()


def _checked(key: str, content: bytes) -> bytes:
    """Return a file's content without the checksum at its end.

    **Raises:** `DamagedError` if the checksum does not agree.
    """
    value, checksum = content[:-DIGITS], content[-DIGITS:]
    if checksum != digest(key, value).encode():
        raise DamagedError(f"The checksum of {key} does not agree.")
    return value


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Context in which this process holds the lock of a folder, so that it can change the store.

    Before the context begins, wait until no other process holds the lock. The lock of a process
    that dies is released. If the system has no locks, or the folder can't be written to, the
    context begins at once and without a lock.
    """
    try:
        import fcntl

        file = (folder / _LOCK).open("w")
    except (ImportError, OSError) as error:  # Windows, or a folder that is read only
        require_of_system(error)
        yield
        return
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX)
        except OSError as error:  # a file system without locks
            require_of_system(error)
        yield


def require_of_system(error: Exception) -> None:
    """Raise an `OSError` again that a signal handler has raised, such as the `TimeoutError` of a
    time limit. Errors of the system have a number."""
    if isinstance(error, OSError) and error.errno is None:
        raise error


def opened(group: "zarr.Group", name: str) -> "zarr.Array":
    """Open the array with the given name in a group.

    A chunk that is written to this array gets a file even if all its values are the fill value.
    """
    import zarr

    # By default Zarr writes no file for a chunk of fill values, so a lost file would look like one.
    with zarr.config.set({"array.write_empty_chunks": True}):
        array = group[name]
    assert isinstance(array, zarr.Array)
    return array


def chunk_file(path: Path, array: "zarr.Array", chunk: int) -> Path:
    """Return the path of the file with one chunk of an array.

    **Arguments:** `path`: folder of the group; `chunk`: number of the chunk along the first
    dimension.
    """
    return path / array.path / array.metadata.encode_chunk_key((chunk,) + (0,) * (array.ndim - 1))


def compressors() -> "tuple[BytesBytesCodec, ...]":
    """Return the compressors of arrays of results, which `read_chunk` and `write_chunk` apply. They
    were Zarr's default ones when the first stores were written."""
    from zarr.codecs import ZstdCodec

    return (ZstdCodec(level=0, checksum=False),)


def make_folder(folder: Path) -> None:
    """Make a folder, and those above it, unless they exist."""
    # With `exist_ok`, Python takes any error for that of an existing folder, also a `TimeoutError`
    # of a signal handler.
    with suppress(FileExistsError):
        os.makedirs(folder)


def write_chunk(path: Path, array: "zarr.Array", chunk: int, values: np.ndarray) -> Path:
    """Write one chunk of an array of results, so that a reader finds either the earlier file or the
    new one.

    **Arguments:** `path`: folder of the group; `values`: (n, ...) rows of the chunk; fewer than the
    chunk has if it is the last one.

    **Returns:** the path of the file.

    **Raises:** `OSError`, for example if the disk is full; the earlier file is left then.
    """
    from numcodecs.zstd import Zstd

    file = chunk_file(path, array, chunk)
    # Zarr stores chunks in full size, in little-endian order.
    rows = np.full(array.chunks, array.fill_value, array.dtype.newbyteorder("<"))
    rows[tuple(map(slice, values.shape))] = values
    content = bytes(Zstd(level=0).encode(rows.tobytes()))
    make_folder(file.parent)
    # The lock of the store allows one process at a time to write, so that the name can be the same
    # each time, and the file that a killed process leaves is written over.
    new = file.with_name(f"{file.name}.partial")
    try:
        new.write_bytes(_with_checksum(file.relative_to(path).as_posix(), content))
        new.replace(file)
    except BaseException:
        with suppress(OSError):
            new.unlink()
        raise
    return file


def read_chunk(path: Path, array: "zarr.Array", chunk: int) -> np.ndarray | None:
    """Read one chunk of an array of results.

    **Arguments:** `path`: folder of the group.

    **Returns:** (n, ...), as many rows as the array has in the chunk; ``None`` if the file is
    missing or damaged.
    """
    from numcodecs.zstd import Zstd

    file = chunk_file(path, array, chunk)
    try:
        content = _checked(file.relative_to(path).as_posix(), file.read_bytes())
    except (FileNotFoundError, DamagedError):
        return None
    decoded = np.frombuffer(Zstd().decode(content), array.dtype.newbyteorder("<"))
    rows = decoded.reshape(array.chunks)
    rows_left = array.shape[0] - chunk * array.chunks[0]
    return rows[tuple(map(slice, (min(rows_left, len(rows)), *array.shape[1:])))]


def read(path: Path, array: "zarr.Array") -> tuple[np.ndarray, dict[int, str]]:
    """Read an array of a group as far as its files are intact.

    **Arguments:** `path`: folder of the group; `array`: the opened array.

    **Returns:** the values, and for each faulty file the fault, `MISSING` or `DAMAGED`, by number
    of its chunk. The values of these chunks are the fill value.
    """
    # Zarr returns fill values for a chunk whose file is missing, so missing files are looked for.
    count = -(-array.shape[0] // array.chunks[0])
    faults = {k: MISSING for k in range(count) if not chunk_file(path, array, k).exists()}
    try:
        return np.asarray(array[:]), faults
    except DamagedError:  # Find the damaged chunks one by one.
        values = np.full(array.shape, array.fill_value, array.dtype)
        for chunk in range(count):
            span = slice(chunk * array.chunks[0], (chunk + 1) * array.chunks[0])
            try:
                values[span] = array[span]
            except DamagedError:
                faults[chunk] = DAMAGED
        return values, faults
