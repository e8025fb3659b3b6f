"""Native programs that are kept on disk for the next process, which then traces nothing."""

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
from ..compilation.plain_values import NUMERIC, described
from .machine_code import store_of_code, target

Made = TypeVar("Made")
_VERSIONED = (*NUMERIC, "beartype", "jax", "jaxlib", "jaxtyping", "ml_dtypes", "numpy")
"""Packages whose versions programs depend on."""
_OF_NO_MATTER = ("cache_dir", "persistent_cache", "compilation_cache", "log", "traceback", "dump")
"""Parts of names of JAX's settings that no program depends on."""


def kept(
    function: Callable[..., PyTree], arguments: tuple[PyTree, ...], make: Callable[[], Made]
) -> Made:
    """What `make` gives, or what another process has kept of it.

    It is kept if programs are (see `keep_programs`), and if function and arguments consist of
    classes, functions and numbers of this package alone: others are always traced.
    """
    store = store_of_code() if keeps_programs() else None
    key = None
    if store is not None:
        # A value that can't be described, for whatever reason, has no key.
        with suppress(Exception):
            key = program_key(function, arguments)
    if store is None or key is None:
        return make()
    content = store.read(key)
    if content is not None:
        # Files of another version can fail in any way; they are written anew.
        with suppress(Exception):
            return pickle.loads(content)
    made = make()
    with suppress(Exception):
        store.write(key, pickle.dumps(made))
    return made


def program_key(function: Callable[..., PyTree], arguments: tuple[PyTree, ...]) -> str:
    """Equal in all processes for arguments for which the same program would be compiled: of arrays
    only shapes and types matter.

    **Raises:** `NotPlainError` if function or arguments hold code from outside of the package
    (see `plain_values`), and `ChangedCodeError` if the package's own was changed.
    """
    alike = jax.tree.map(
        lambda leaf: jax.ShapeDtypeStruct(leaf.shape, leaf.dtype) if eqx.is_array(leaf) else leaf,
        arguments,
    )
    settings = {
        name: repr(value)
        for name, value in sorted(jax.config.values.items())
        if not any(part in name for part in _OF_NO_MATTER)
    }
    return described([function, alike, source_digest(), _versions(), settings, target()])


@cache
def _versions() -> tuple[str, ...]:
    """Versions of Python and of the packages whose code programs come from, loaded or not."""
    return (sys.version, *(f"{name} {_version(name)}" for name in _VERSIONED))


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "none"
