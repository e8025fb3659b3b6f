"""Native programs that are kept on disk for the next process, which then traces nothing."""

import pickle
from collections.abc import Callable
from contextlib import suppress
from typing import TypeVar

from jaxtyping import PyTree

from ..compilation.kept_programs import keeps_programs
from ..compilation.program_key import program_key
from .machine_code import store_of_code, target

Made = TypeVar("Made")


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
            key = program_key(function, (target(), *arguments), {})
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
