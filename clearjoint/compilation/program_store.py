"""Files of compiled programs, by their keys, in a folder of bounded size.

They hold machine code and are read by `pickle`, so that a folder to which others may write is not
used (see `cache_folder`). The folder lies in that of JAX's compilation cache.
"""

import hashlib
import os
import tempfile
import zlib
from contextlib import suppress
from pathlib import Path

import jax

from .cache_folder import is_private

MOST_BYTES = 1_000_000_000
"""Of all files; beyond that those unused for longest are removed."""
_SUFFIX = ".program"
_DIGEST = 20
_is_on = False


def keep_programs(keep: bool = True) -> None:
    """Whether native programs are kept whole, as long as JAX's compilation cache is in use; their
    machine code alone is kept in any case."""
    global _is_on
    _is_on = keep


def keeps_programs() -> bool:
    """Whether `keep_programs` has switched that on."""
    return _is_on


def cache_in_use() -> Path | None:
    """The folder of JAX's compilation cache, if that is in use."""
    cache = jax.config.jax_compilation_cache_dir  # pyright: ignore
    if not (cache and jax.config.jax_enable_compilation_cache):  # pyright: ignore
        return None
    return None if "://" in cache else Path(cache)


class ProgramStore:
    """A folder of programs."""

    def __init__(self, folder: Path, most_bytes: int = MOST_BYTES):
        self._folder, self._most_bytes = folder, most_bytes

    def read(self, key: str) -> bytes | None:
        """The content under a key, or ``None`` if there is none or it is damaged."""
        path = self._path(key)
        try:
            if not is_private(self._folder):
                return None
            whole = path.read_bytes()
            content = zlib.decompress(whole[_DIGEST:])
        except (OSError, zlib.error):
            return None
        with suppress(OSError):
            # Fails in a folder that may only be read.
            os.utime(path)
        return content if whole[:_DIGEST] == _digest(key, content) else None

    def write(self, key: str, content: bytes) -> None:
        """Put content under a key, whole or not at all.

        **Raises:** `OSError` if it can't be written.
        """
        self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not is_private(self._folder):
            return
        whole = _digest(key, content) + zlib.compress(content, 1)
        handle, name = tempfile.mkstemp(dir=self._folder)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(whole)
            os.replace(name, self._path(key))
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise
        self._bound()

    def _path(self, key: str) -> Path:
        return self._folder / f"{key}{_SUFFIX}"

    def _bound(self) -> None:
        """Remove what has not been used for longest; another process may do so too."""
        found = []
        for path in self._folder.iterdir():
            try:
                status = path.stat()
            except OSError:
                continue
            found.append((status.st_mtime, status.st_size, path))
        left = sum(size for _, size, _ in found)
        for _, size, path in sorted(found):
            if left <= self._most_bytes:
                break
            path.unlink(missing_ok=True)
            left -= size


def _digest(key: str, content: bytes) -> bytes:
    return hashlib.blake2b(content, key=key.encode()[:64], digest_size=_DIGEST).digest()
