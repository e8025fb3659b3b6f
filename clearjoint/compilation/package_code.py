"""Whether the code of the package in this process is that of its source files, and their digest.

The digest belongs to the files as they were when the import of the package began. It is refused
once the files differ from that (the package was upgraded or edited while the process ran), and once
a function, class or constant was put in the place of one that the package had when its import
ended. This module imports nothing but Python's library, so that it can be the first that is
imported.
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
_FOLDER = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
LIBRARIES = ("diffrax", "equinox", "lineax", "optimistix", "jax", "jax.lax", "jax.numpy", "numpy")
"""Modules of other packages of which replaced functions are noticed too."""
_OF_THE_PROCESS = (f"{PACKAGE}.runtime", f"{PACKAGE}.compilation")
"""Modules whose variables change while a process runs; programs depend on none of them."""

_BOOKKEEPING = frozenset(
    {
        "__abstractclassvars__",
        "__abstractmethods__",
        "__abstractvars__",
        "__annotations__",
        "__annotations_cache__",
        "__dataclass_fields__",
        "__dataclass_params__",
        "__dict__",
        "__doc__",
        "__match_args__",
        "__module__",
        "__orig_bases__",
        "__parameters__",
        "__slotnames__",
        "__slots__",
        "__weakref__",
        "_abc_impl",
    }
)
"""Attributes of classes that compute nothing; Python adds some of them late."""


class ChangedCodeError(Exception):
    """The code of this process is not, or no longer, that of the package's source files."""


class _State:
    """What is known of the package's code in this process.

    - `lock`: guards the others.
    - `files`: what `_files` gave when the import of the package began.
    - `names`: by module what it held when that import ended, names that were added later being
      none of the package's own; `contents`: what `_contents` gave for these.
    - `digest`: that of the source files, once it was asked for.
    - `modules`: number of modules of the package that were loaded when `files` were last compared.
    - `changed`: whether a change was ever found. What JAX has traced since then may hold replaced
      code for as long as the process lives.
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
    """Note what the modules of the package and of `LIBRARIES` hold: to be called at the end of the
    import of the package."""
    own = [name for name in sys.modules if name.split(".")[0] == PACKAGE]
    modules = [name for name in own if not name.startswith(_OF_THE_PROCESS)]
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
    """Whether a module was loaded when `remember_contents` was called, so that a change is seen."""
    return module in _STATE.names


def source_digest() -> str:
    """The digest of the package's source files as they were when its import began.

    **Raises:** `ChangedCodeError` if the code of this process differs from them, or ever did.
    """
    with _STATE.lock:
        if not (_STATE.changed or _is_as_imported()):
            _STATE.changed = True
        if _STATE.changed or _STATE.digest is None:
            raise ChangedCodeError
        return _STATE.digest


def _is_as_imported() -> bool:
    if not _STATE.names or not _STATE.files:
        return False
    loaded = sum(name.startswith(PACKAGE) for name in sys.modules)
    if loaded != _STATE.modules:
        # Modules that were imported since then may stem from other files.
        if _STATE.digest is None:
            _STATE.digest = _digest(_STATE.files)
        if _files() != _STATE.files:
            return False
        _STATE.modules = loaded
    now = _contents(_STATE.names)
    return len(now) == len(_STATE.contents) and all(map(is_, now, _STATE.contents))


def _files() -> dict[str, tuple[int, ...]]:
    """By path of each source file what changes whenever it is written or replaced."""
    found, waiting = {}, [_FOLDER]
    while waiting:
        with os.scandir(waiting.pop()) as entries:
            for entry in entries:
                if entry.is_dir() and entry.name != "__pycache__":
                    waiting.append(entry.path)
                elif entry.name.endswith(".py"):
                    s = entry.stat()
                    found[entry.path] = s.st_size, s.st_mtime_ns, s.st_ctime_ns, s.st_ino
    return found


def _digest(paths: dict[str, tuple[int, ...]]) -> str:
    whole = hashlib.blake2b(digest_size=20)
    for path in sorted(paths):
        with open(path, "rb") as file:
            content = file.read()
        whole.update(f"{os.path.relpath(path, _FOLDER)} {len(content)} ".encode() + content)
    return whole.hexdigest()


def _contents(names: Mapping[str, list[str]]) -> list[object]:
    """What modules have under names, and what may be replaced in that: attributes of classes, items
    of dictionaries and lists, code and defaults of functions."""
    found: list[object] = []
    for module, own in names.items():
        values = list(map(vars(sys.modules[module]).get, own))
        for value in list(values):
            if isinstance(value, type) and _is_listed_in(module, value):
                inner = vars(value)
                attributes = sorted(inner.keys() - _BOOKKEEPING)
                found += attributes
                values += map(inner.get, attributes)
        found += values
        for value in values:
            if isinstance(value, types.FunctionType):
                found += value.__code__, value.__defaults__, value.__kwdefaults__
            elif isinstance(value, dict) and not isinstance(value, OrderedDict):
                # In an `OrderedDict` the package remembers results; it changes in any run.
                found += *value.keys(), *value.values()
            elif isinstance(value, list):
                found += value
    return found


def _is_listed_in(module: str, cls: type) -> bool:
    """Whether the attributes of a class are looked at with a module: that in which it is defined,
    or the library whose public class it is."""
    return module != "numpy" and module in (cls.__module__, cls.__module__.split(".")[0])


_STATE = _State()
