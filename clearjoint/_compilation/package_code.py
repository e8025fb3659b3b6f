"""Digest of the package's source files, and a check that this process runs their code.

The digest is part of the key of each saved program, as are the versions of other packages. This
module imports only Python's standard library, so that it can be imported before all others.
"""

import functools
import os
import sys
from collections.abc import Mapping
from itertools import starmap

from .digests import LONG, digest

PACKAGE = __name__.split(".")[0]
"""Name of this package."""
_FOLDER = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
_OF_THE_PROCESS = (f"{PACKAGE}._runtime", f"{PACKAGE}._compilation")
"""Modules, with their submodules, whose variables change while a process runs. Programs do not
depend on these variables."""
_Namespace = Mapping[str, object]
_contents: list[tuple[_Namespace, dict[str, object]]] = []
"""Namespace of each module and class of this package, and its content at the end of the import. The
list is emptied when a change is noticed: even if the change is undone, JAX may reuse programs that
it has traced from the changed code."""


class ChangedCodeError(Exception):
    """Raised if the code of this process differs from the package's source files, or cannot be
    compared with them."""


def remember_contents() -> None:
    """Record the objects in the package's modules and classes, for `source_digest`. It must be
    called at the end of the import of the package."""
    global _contents
    modules: list[_Namespace] = [
        vars(module)
        for name, module in sys.modules.items()
        if name.split(".")[0] == PACKAGE and not name.startswith(_OF_THE_PROCESS)
    ]
    classes = [
        vars(value)
        for names in modules
        for value in names.values()
        if isinstance(value, type) and value.__module__ == names["__name__"]
    ]
    _contents = [(names, dict(names)) for names in (*modules, *classes)]


def source_digest() -> str:
    """Return the digest of the package's source files as they were when its import began.

    **Raises:** `ChangedCodeError` if the files have changed since then, as by an upgrade; if an
    object in a module or class of this package was replaced after the import; or if there are no
    source files or `remember_contents` has not been called. After a change that a call has noticed,
    every later call raises it, even if the change is undone.
    """
    global _contents
    # The files are read before the comparison, which then also covers the files that were read.
    of_files = _digest()
    if _files() != _FILES or not all(starmap(_is_as_before, _contents)):
        _contents = []
    if not (_contents and _FILES):
        raise ChangedCodeError
    return of_files


def _is_as_before(names: _Namespace, before: _Namespace) -> bool:
    """Return whether a namespace has the same objects under the same names as before.

    A module may have further names, such as those of submodules. A class may have further names
    only if they begin with two underscores, of which Python adds some: any other added method might
    override an inherited one.
    """
    # The namespace of a module is a dictionary, that of a class a view of one.
    added = () if isinstance(names, dict) else names.keys() - before.keys()
    return all(names.get(name) is value for name, value in before.items()) and all(
        name.startswith("__") for name in added
    )


def _files() -> dict[str, tuple[int, ...]]:
    """Return size, times of change and inode of each source file by path. If a file is written or
    replaced, one of these numbers changes, and they are compared much faster than the files."""
    paths = (
        os.path.join(folder, name)
        for folder, _, names in os.walk(_FOLDER)
        for name in names
        if name.endswith(".py")
    )
    states = {path: os.stat(path) for path in paths}
    return {p: (s.st_size, s.st_mtime_ns, s.st_ctime_ns, s.st_ino) for p, s in states.items()}


_FILES = _files()


@functools.cache
def _digest() -> str:
    parts: list[str | bytes] = []
    for path in sorted(_FILES):
        with open(path, "rb") as file:
            parts += os.path.relpath(path, _FOLDER), file.read()
    return digest(*parts, digits=LONG)
