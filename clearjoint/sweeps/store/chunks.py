"""The files of a Zarr array, one a chunk of lanes, read so that damage to one is told and costs no
other.

Each file ends with a checksum of its content and of its place in the store, so that files which
have changed places are noticed as well.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from .fingerprint import DIGITS, digest

if TYPE_CHECKING:
    import zarr
    from zarr.storage import LocalStore

MISSING, DAMAGED = "missing", "damaged"
_LOCK = ".lock"


def opened_group(path: Path, mode: Literal["r", "r+"]) -> "zarr.Group":
    """The group of a store's arrays, to be read or written, with the metadata of all at once."""
    import zarr

    files = checked_files()(path, read_only=mode == "r")
    return zarr.open_group(files, mode=mode, zarr_format=3, use_consolidated=True)


@cache
def checked_files() -> "type[LocalStore]":
    """The class of files of which chunks have checksums. Its `get` raises `ValueError` for a chunk
    that is damaged or another one's. Made when it is needed, since importing zarr takes long."""
    from zarr.core.buffer import default_buffer_prototype
    from zarr.storage import LocalStore

    class CheckedFiles(LocalStore):
        async def get(self, key: str, prototype: Any = None, byte_range: Any = None) -> Any:
            assert byte_range is None
            prototype = prototype or default_buffer_prototype()
            found = await super().get(key, prototype)
            if found is None or _is_metadata(key):
                return found
            content = found.to_bytes()
            value, checksum = content[:-DIGITS], content[-DIGITS:]
            if checksum != digest(key, value).encode():
                raise ValueError(f"The checksum of {key} does not agree.")
            return prototype.buffer.from_bytes(value)

        async def set(self, key: str, value: Any) -> None:
            if not _is_metadata(key):
                content = value.to_bytes()
                value = type(value).from_bytes(content + digest(key, content).encode())
            await super().set(key, value)

    return CheckedFiles


def _is_metadata(key: str) -> bool:
    return key.endswith(".json")


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """A context that one process at a time is in, for a folder; a process that dies leaves it.

    Where the system or the folder has no locks, processes do not wait for each other.
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
