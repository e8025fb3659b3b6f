"""What JAX's own compilation cache reads.

An executable that came from there lacks part of what it was made of, so that it can't be written
again; but what was read can.
"""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import jax
from jax._src import compilation_cache


class _Recording(threading.local):
    """The list of a thread to which what it reads is added, if it has one."""

    found: list[bytes] | None = None


_recording = _Recording()
_lock = threading.Lock()


@contextmanager
def recorded_reads() -> Iterator[list[bytes]]:
    """A list of the serialised executables that this thread reads inside."""
    _observe_cache()
    before, _recording.found = _recording.found, []
    try:
        yield _recording.found
    finally:
        _recording.found = before


def _observe_cache() -> None:
    """Have the cache in use tell each thread's list what is read; that stays so, since other
    threads may be reading."""
    with _lock:
        cache = compilation_cache._get_cache(jax.devices()[0].client)
        if cache is None or "get" in vars(cache):
            return
        read = cache.get

        def get(key: str) -> bytes | None:
            entry = read(key)
            if entry is not None and _recording.found is not None:
                _recording.found.append(_executable(entry))
            return entry

        cache.get = get  # pyright: ignore


def _executable(entry: bytes) -> bytes:
    whole = compilation_cache.decompress_executable(entry)
    return compilation_cache.extract_executable_and_time(whole)[0]
