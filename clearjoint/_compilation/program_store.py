"""Files of compiled programs by key, in a folder of bounded size.

The folder is in JAX's compilation cache. Programs are machine code and are read by `pickle`, so
whoever can write to the folder can have code executed by whoever reads from it. The folder is
therefore made accessible to its owner only. It is not used if others may write to it, or may
exchange it because they may write to a folder above it.
"""

import os
import stat
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import jax

from .digests import LONG, digest

MOST_BYTES = 1_000_000_000
"""Largest total size of the files. Beyond this size, the least recently used ones are removed."""
_OTHER_PATH = "give another path to `configure(cache=...)` or in the variable CLEARJOINT_CACHE."
_is_on = False
"""Whether whole native programs are saved."""


def keep_programs(keep: bool = True) -> None:
    """Set whether whole native programs are saved in JAX's compilation cache.

    A whole program is machine code with the layout of its arguments and results, which a later
    process loads without tracing the function. If `keep` is false, only the machine code is saved:
    a later process traces the function again, but need not compile it.
    """
    global _is_on
    _is_on = keep


def keeps_programs() -> bool:
    return _is_on


def cache_in_use() -> Path | None:
    """Return the folder of JAX's compilation cache; ``None`` if it is off or its path is a URL."""
    cache = jax.config.jax_compilation_cache_dir  # pyright: ignore
    if not (cache and jax.config.jax_enable_compilation_cache):  # pyright: ignore
        return None
    return None if "://" in cache else Path(cache)


def prepare_folder(folder: Path) -> str | None:
    """Make a folder that only its owner may enter, unless it exists, and check that it can be used.

    **Returns:** ``None`` if the folder can be used, or a message why not, with the remedy: it
    cannot be made, or other users may write to it or exchange it.

    **Raises:** `ValueError` if the path is that of a file, or leads through a file.
    """
    try:
        for above in reversed(folder.parents):
            if not above.exists():
                above.mkdir(mode=0o755, exist_ok=True)  # also if the umask is more generous
        folder.mkdir(mode=0o700, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise ValueError(
            f"The cache folder {str(folder)!r} is a file, or lies in one: remove the file, or "
            f"{_OTHER_PATH}"
        ) from None
    except OSError as error:
        return f"The cache folder {str(folder)!r} can't be made ({error.strerror}): {_OTHER_PATH}"
    exposed = _exposed(folder)
    if exposed is None:
        return None
    mode = stat.filemode(exposed.stat().st_mode)
    if exposed == folder:
        return (
            f"Other users may write to the cache folder {str(folder)!r} ({mode}), from which "
            "machine code is read: remove it, and it is made again for you alone; or, if nobody "
            f"else has written to it, run `chmod go-w '{folder}'`; or {_OTHER_PATH}"
        )
    return (
        f"Other users may exchange the cache folder {str(folder)!r}, from which machine code is "
        f"read, because they may write to {str(exposed)!r} ({mode}): run `chmod go-w '{exposed}'` "
        f"if it is yours, or {_OTHER_PATH}"
    )


def is_private(folder: Path) -> bool:
    """Return whether only the user of this process and the administrator may write to a folder, or
    exchange it: always ``True`` on systems without POSIX permissions, such as Windows."""
    return _exposed(folder) is None


def _exposed(folder: Path) -> Path | None:
    """Return the folder, or the first one above it, to which others than the user of this process
    and the administrator may write; ``None`` if there is no such folder."""
    if not hasattr(os, "getuid"):
        return None
    if not _is_ours(folder.stat()):
        return folder
    # The folders that lead to it by links count too.
    for above in (*folder.absolute().parents, *folder.resolve().parents):
        status = above.stat()
        # In a folder such as /tmp, with the sticky bit, only owners exchange what is theirs.
        sticky = status.st_mode & stat.S_ISVTX and status.st_uid in (0, os.getuid())
        if not (_is_ours(status) or sticky):
            return above
    return None


def _is_ours(status: os.stat_result) -> bool:
    """Return whether only this user and the administrator may write to what has this status."""
    return status.st_uid in (0, os.getuid()) and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


@contextmanager
def system_errors_suppressed() -> Iterator[None]:
    """Context that suppresses errors of the operating system, but not a `TimeoutError` without an
    error number: a handler of signals raises it to end a run after a limit of time."""
    try:
        yield
    except OSError as error:
        if isinstance(error, TimeoutError) and error.errno is None:
            raise


def _read_private(path: Path) -> bytes | None:
    """Return the content of a file; ``None`` if others may write to it or to its folder. Both are
    opened before their permissions are checked, so that neither can be exchanged in between."""
    if not hasattr(os, "getuid"):
        return path.read_bytes()
    if not is_private(path.parent):
        return None
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        if not _is_ours(os.fstat(folder)):
            return None
        with os.fdopen(os.open(path.name, os.O_RDONLY, dir_fd=folder), "rb") as file:
            return file.read() if _is_ours(os.fstat(file.fileno())) else None
    finally:
        os.close(folder)


class ProgramStore:
    """Folder with a file for each compiled program, at most `most_bytes` bytes in all. A file has a
    checksum of the key and the content, and the compressed content."""

    def __init__(self, folder: Path, most_bytes: int = MOST_BYTES):
        self._folder, self._most_bytes = folder, most_bytes

    def read(self, key: str) -> bytes | None:
        """Return the content that was written under a key; ``None`` if there is none, if it is
        damaged, or if other users may write to it."""
        path = self._path(key)
        stored = content = b""
        with system_errors_suppressed(), suppress(zlib.error):
            stored = _read_private(path) or b""
            content = zlib.decompress(stored[LONG:])
        # Without a file, or with one that cannot be decompressed, the checksums differ too.
        if stored[:LONG] != _checksum(key, content):
            return None
        with system_errors_suppressed():
            # Set the time of the last use, which is not possible in a read-only folder.
            os.utime(path)
        return content

    def write(self, key: str, content: bytes) -> None:
        """Write content under a key, so that other processes read either all of it or nothing; not
        to a folder to which other users may write. Raise an `OSError` if it cannot be written."""
        self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not is_private(self._folder):
            return
        # Level 1 is the fastest one: a program is written once, while its user waits.
        stored = _checksum(key, content) + zlib.compress(content, 1)
        # The file is renamed only when it is complete, so that others never read a part of it.
        handle, name = tempfile.mkstemp(dir=self._folder)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(stored)
            os.replace(name, self._path(key))
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise
        self._remove_oldest()

    def _path(self, key: str) -> Path:
        return self._folder / f"{key}.program"

    def _remove_oldest(self) -> None:
        files = []
        # Another process may remove files at the same time.
        for path in self._folder.iterdir():
            with system_errors_suppressed():
                status = path.stat()
                files.append((status.st_mtime, status.st_size, path))
        total = sum(size for _, size, _ in files)
        for _, size, path in sorted(files):
            if total <= self._most_bytes:
                break
            path.unlink(missing_ok=True)
            total -= size


def _checksum(key: str, content: bytes) -> bytes:
    return digest(key, content, digits=LONG).encode()
