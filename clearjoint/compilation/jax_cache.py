"""What JAX's own compilation cache reads.

An executable that came from there lacks part of what it was made of, so that it can't be written
again; but what was read can.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import jax
from jax._src import compilation_cache


@contextmanager
def recorded_reads() -> Iterator[list[bytes]]:
    """A list of the serialised executables that are read inside."""
    found: list[bytes] = []
    cache = compilation_cache._get_cache(jax.devices()[0].client)
    if cache is None:
        yield found
        return
    read = cache.get

    def get(key: str) -> bytes | None:
        entry = read(key)
        if entry is not None:
            found.append(_executable(entry))
        return entry

    cache.get = get  # pyright: ignore
    try:
        yield found
    finally:
        del cache.get


def _executable(entry: bytes) -> bytes:
    whole = compilation_cache.decompress_executable(entry)
    return compilation_cache.extract_executable_and_time(whole)[0]
