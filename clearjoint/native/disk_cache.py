"""Keep native programs on disk, so that the next process loads them instead of tracing."""

import pickle
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib import metadata
from typing import TypeVar

import equinox as eqx
import jax
from jaxtyping import PyTree

from ..compilation import keeps_programs
from ..compilation.package_code import source_digest
from ..compilation.plain_values import NUMERIC, digest_of
from .machine_code import store_of_code, target

Program = TypeVar("Program")
_PACKAGES = (*NUMERIC, "beartype", "jax", "jaxlib", "jaxtyping", "ml_dtypes", "numpy")
"""Packages whose versions programs depend on."""
_IRRELEVANT = ("cache_dir", "persistent_cache", "compilation_cache", "log", "traceback", "dump")
"""Parts of names of JAX's settings that do not affect programs."""


def load_or_make(
    function: Callable[..., PyTree], arguments: tuple[PyTree, ...], make: Callable[[], Program]
) -> Program:
    """Load the program of a function for such arguments from disk, or make and save it.

    Programs are saved unless that is switched off (see `keep_programs`), and only if the function
    and its arguments consist of classes, functions and numbers of this package: a change of other
    code would not be noticed.
    """
    store = store_of_code() if keeps_programs() else None
    key = None
    if store is not None:
        # A value that cannot be described, for any reason, has no key.
        with suppress(Exception):
            key = program_key(function, arguments)
    if store is None or key is None:
        return make()
    content = store.read(key)
    if content is not None:
        # A file of another version can fail in any way, and is replaced.
        with suppress(Exception):
            return pickle.loads(content)
    program = make()
    with suppress(Exception):
        store.write(key, pickle.dumps(program))
    return program


def program_key(function: Callable[..., PyTree], arguments: tuple[PyTree, ...]) -> str:
    """Return a key that is equal, in all processes, for arguments with the same program.

    Arrays count by their shapes and dtypes.

    **Raises:** `NotPlainError` if function or arguments hold code from outside of the package (see
    `plain_values`), and `ChangedCodeError` if the package's own was changed.
    """
    shapes = jax.tree.map(
        lambda leaf: jax.ShapeDtypeStruct(leaf.shape, leaf.dtype) if eqx.is_array(leaf) else leaf,
        arguments,
    )
    settings = {
        name: repr(value)
        for name, value in sorted(jax.config.values.items())
        if not any(part in name for part in _IRRELEVANT)
    }
    return digest_of([function, shapes, source_digest(), _versions(), settings, target()])


@cache
def _versions() -> tuple[str, ...]:
    return (sys.version, *(f"{name} {_version(name)}" for name in _PACKAGES))


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "none"
