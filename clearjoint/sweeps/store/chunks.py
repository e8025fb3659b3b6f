"""Files of a store's Zarr arrays, one for each chunk of lanes and each array, with checksums.

A store holds the results of a sweep on disk. A lane is one run of the sweep, and a chunk a group of
lanes that are stored together.

A file ends with a checksum of its content and of its path in the store. So a damaged file, or one
that was moved to the place of another, is detected. Intact files can still be read.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from .program import DIGITS, digest

if TYPE_CHECKING:
    import zarr
    from zarr.abc.store import ByteRequest
    from zarr.core.buffer import Buffer, BufferPrototype
    from zarr.storage import LocalStore

MISSING, DAMAGED = "missing", "damaged"
"""Faults that the file of a chunk may have. A file is damaged if its checksum does not agree."""
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

    Its method `get` raises `ValueError` for a chunk that is damaged or belongs to another path. The
    class is made at the first call of this function, because importing zarr takes long.
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
            content = buffer.to_bytes()
            value, checksum = content[:-DIGITS], content[-DIGITS:]
            if checksum != digest(key, value).encode():
                raise ValueError(f"The checksum of {key} does not agree.")
            return prototype.buffer.from_bytes(value)

        async def set(self, key: str, value: "Buffer") -> None:
            # Files of metadata stay plain JSON; the store's own digest covers them.
            if not _is_metadata(key):
                content = value.to_bytes()
                value = type(value).from_bytes(content + digest(key, content).encode())
            await super().set(key, value)

    return CheckedFiles


def _is_metadata(key: str) -> bool:
    return key.endswith(".json")


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
    except (ImportError, OSError):  # Windows, or a folder that is read only
        yield
        return
    with file:
        with suppress(OSError):
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


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
    except ValueError:  # A checksum does not agree: find the damaged chunks one by one.
        values = np.full(array.shape, array.fill_value, array.dtype)
        for chunk in range(count):
            span = slice(chunk * array.chunks[0], (chunk + 1) * array.chunks[0])
            try:
                values[span] = array[span]
            except ValueError:
                faults[chunk] = DAMAGED
        return values, faults
