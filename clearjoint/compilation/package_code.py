"""Digest of the package's source files, and a check that this process runs their code.

The digest is part of the key of each saved program, so that a program is loaded only by processes
with the same code. `source_digest` returns the digest of the files as they were when the import of
the package began. It raises `ChangedCodeError` if the files have changed since then, because the
package was upgraded or edited while the process ran. The files are compared at the first call, and
again at the first call after further modules of the package have been imported. At every call, the
error is also raised if a function, class or constant of the package was replaced after the import.
This module imports only Python's standard library, so that it can be imported before all others.
"""

import hashlib
import os
import sys
import threading
import types
from collections import OrderedDict
from collections.abc import Mapping
from operator import is_

PACKAGE = __name__.split(".")[0]
"""Name of this package."""
_FOLDER = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
LIBRARIES = ("diffrax", "equinox", "lineax", "optimistix", "jax", "jax.lax", "jax.numpy", "numpy")
"""Modules of other packages in which replaced functions are noticed too."""
_OF_THE_PROCESS = (f"{PACKAGE}.runtime", f"{PACKAGE}.compilation")
"""Modules of this package, with their submodules, whose variables change while a process runs.
Programs do not depend on these variables."""


class ChangedCodeError(Exception):
    """Raised if the code of this process differs from the package's source files, or cannot be
    compared with them."""


class _State:
    """Record of the package's code at its import, to which `source_digest` compares later code.

    - `lock`: held while `source_digest` reads and updates this record.
    - `files`: size, times and inode of each source file when the import began; see `_files`.
    - `names`: for each module, the names that it defined when the import ended. Names that are
      added later belong to code of others, and are not compared.
    - `contents`: the objects with these names when the import ended; see `_contents`.
    - `digest`: digest of the source files; ``None`` until it is first computed.
    - `modules`: number of loaded modules of the package when `files` were last compared with the
      disk; the comparison is repeated when this number has changed.
    - `changed`: whether any comparison has found a change. It is never reset: even if the change is
      undone, JAX may have traced programs from the changed code and reuse them.
    """

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.files = _files()
        self.names: dict[str, list[str]] = {}
        self.contents: list[object] = []
        self.digest: str | None = None
        self.modules = 0
        self.changed = False


def remember_contents() -> None:
    """Record the objects in the loaded modules of the package and of `LIBRARIES`, for comparison by
    `source_digest`. Modules in `_OF_THE_PROCESS` are left out.

    It must be called at the end of the import of the package.
    """
    loaded = [name for name in sys.modules if name.split(".")[0] == PACKAGE]
    modules = [name for name in loaded if not name.startswith(_OF_THE_PROCESS)]
    modules += [name for name in LIBRARIES if name in sys.modules]
    _STATE.names = {
        module: [
            name
            for name, value in vars(sys.modules[module]).items()
            if not (name.startswith("__") or isinstance(value, types.ModuleType))
        ]
        for module in modules
    }
    _STATE.contents = _contents(_STATE.names)


def is_remembered(module: str) -> bool:
    """Return whether `source_digest` would notice a change in a module, given by its name."""
    return module in _STATE.names


def source_digest() -> str:
    """Return the digest, as hexadecimal text, of the package's source files when its import began.

    **Raises:** `ChangedCodeError` if the code of this process differs from these files, or if
    `remember_contents` has not been called, so that it cannot be compared. From then on, every call
    raises this error.
    """
    with _STATE.lock:
        if not (_STATE.changed or _is_as_imported()):
            _STATE.changed = True
        if _STATE.changed or _STATE.digest is None:
            raise ChangedCodeError
        return _STATE.digest


def _is_as_imported() -> bool:
    """Return whether the source files, and all objects that `remember_contents` has recorded, are
    the same as at the import of the package; false if it has recorded nothing."""
    if not _STATE.names or not _STATE.files:
        return False
    loaded = sum(name.startswith(PACKAGE) for name in sys.modules)
    if loaded != _STATE.modules:
        # Modules imported since the last comparison may come from changed files. The digest is
        # computed before the comparison, which then also covers the files that it has read.
        if _STATE.digest is None:
            _STATE.digest = _digest(_STATE.files)
        if _files() != _STATE.files:
            return False
        _STATE.modules = loaded
    # Objects are compared by identity, since any replacement of an object counts as a change.
    contents = _contents(_STATE.names)
    return len(contents) == len(_STATE.contents) and all(map(is_, contents, _STATE.contents))


def _files() -> dict[str, tuple[int, ...]]:
    """Return size, times of change and inode of each source file of the package, by path.

    At least one of these numbers changes if the file is written or replaced. To compare them is
    much faster than to read the files.
    """
    states, folders = {}, [_FOLDER]
    while folders:
        with os.scandir(folders.pop()) as entries:
            for entry in entries:
                if entry.is_dir() and entry.name != "__pycache__":
                    folders.append(entry.path)
                elif entry.name.endswith(".py"):
                    s = entry.stat()
                    states[entry.path] = s.st_size, s.st_mtime_ns, s.st_ctime_ns, s.st_ino
    return states


def _digest(paths: dict[str, tuple[int, ...]]) -> str:
    whole = hashlib.blake2b(digest_size=20)
    for path in sorted(paths):
        with open(path, "rb") as file:
            content = file.read()
        whole.update(f"{os.path.relpath(path, _FOLDER)} {len(content)} ".encode() + content)
    return whole.hexdigest()


def _contents(names: Mapping[str, list[str]]) -> list[object]:
    """Return the values of names in modules, and the replaceable parts of these values, as a list.

    Such parts are attributes of classes, items of dictionaries and lists, and code and defaults of
    functions.

    **Arguments:** `names`: the names to look up, by name of the module.
    """
    contents: list[object] = []
    for module, names_of_module in names.items():
        values = list(map(vars(sys.modules[module]).get, names_of_module))
        for value in list(values):
            # A class can be imported into many modules; its attributes are recorded once only.
            if isinstance(value, type) and _is_listed_in(module, value):
                members = vars(value)
                attributes = sorted(name for name in members if _is_code(name, members[name]))
                contents += attributes
                values += map(members.get, attributes)
        contents += values
        for value in values:
            if isinstance(value, types.FunctionType):
                contents += value.__code__, value.__defaults__, value.__kwdefaults__
            elif isinstance(value, dict) and not isinstance(value, OrderedDict):
                # An `OrderedDict` is a cache of results in this package, and changes in any run.
                contents += *value.keys(), *value.values()
            elif isinstance(value, list):
                contents += value
    return contents


def _is_code(name: str, member: object) -> bool:
    """Return whether an attribute of a class may affect results.

    Python and decorators of classes add attributes whose names begin with two underscores, some of
    them after the import. Of these, only functions, methods and properties count. `_abc_impl` is a
    cache of Python's abstract classes.
    """
    if not name.startswith("__"):
        return name != "_abc_impl"
    return callable(member) or isinstance(member, classmethod | staticmethod | property)


def _is_listed_in(module: str, cls: type) -> bool:
    """Return whether the attributes of a class are recorded with a module.

    They are recorded with the module that defines the class, or with the top module of the library
    to which that module belongs. Attributes of NumPy's classes are not recorded.
    """
    return module != "numpy" and module in (cls.__module__, cls.__module__.split(".")[0])


_STATE = _State()
