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
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from operator import attrgetter, is_

Reader = Callable[[], Iterable[object]]
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
    - `held`: what reads the contents of modules, with the contents when that import ended.
    - `remembered`: names of the package's modules among these.
    - `digest`: that of the source files, once it was asked for.
    - `modules`: number of modules of the package that were loaded when `files` were last compared.
    - `changed`: whether a change was ever found. What JAX has traced since then may hold replaced
      code for as long as the process lives.
    """

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.files = _files()
        self.held: list[tuple[Reader, tuple[object, ...]]] = []
        self.remembered: frozenset[str] = frozenset()
        self.digest: str | None = None
        self.modules = 0
        self.changed = False


def remember_contents() -> None:
    """Note what the modules of the package and of `LIBRARIES` hold: to be called at the end of the
    import of the package."""
    names = [name for name in sys.modules if name.split(".")[0] == PACKAGE]
    own = [name for name in names if not name.startswith(_OF_THE_PROCESS)]
    readers = [
        read for name in (*own, *LIBRARIES) if name in sys.modules for read in _readers(name)
    ]
    _STATE.held = [(read, tuple(read())) for read in readers]
    _STATE.remembered = frozenset(own)


def is_remembered(module: str) -> bool:
    """Whether a module was loaded when `remember_contents` was called, so that a change is seen."""
    return module in _STATE.remembered


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
    if not _STATE.held or not _STATE.files:
        return False
    loaded = sum(name.startswith(PACKAGE) for name in sys.modules)
    if loaded != _STATE.modules:
        # Modules that were imported since then may stem from other files.
        if _STATE.digest is None:
            _STATE.digest = _digest(_STATE.files)
        if _files() != _STATE.files:
            return False
        _STATE.modules = loaded
    return all(_same(values, tuple(read())) for read, values in _STATE.held)


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


def _readers(module: str) -> Iterator[Reader]:
    """What reads the values that a module has under its names, and what may be replaced in them.

    Names that are added later are none of the package's own.
    """
    held = vars(sys.modules[module])
    names = [name for name in held if not name.startswith("__")]
    names = [name for name in names if not isinstance(held[name], types.ModuleType)]
    yield partial(map, held.get, names)
    functions: list[object] = []
    for value in map(held.get, names):
        yield from _items(value)
        if isinstance(value, type) and _is_listed_in(module, value):
            inner = vars(value)
            attributes = sorted(inner.keys() - _BOOKKEEPING)
            yield partial(_attribute_names, inner)
            yield partial(map, inner.get, attributes)
            functions += map(inner.get, attributes)
            for attribute in attributes:
                yield from _items(inner[attribute])
        functions.append(value)
    functions = [value for value in functions if isinstance(value, types.FunctionType)]
    for part in ("__code__", "__defaults__", "__kwdefaults__"):
        yield partial(map, attrgetter(part), functions)


def _items(value: object) -> Iterator[Reader]:
    """What reads the items of a dictionary or a list."""
    if isinstance(value, dict):
        yield partial(list, value.keys())
        yield partial(list, value.values())
    elif isinstance(value, list):
        yield partial(list, value)


def _attribute_names(attributes: Mapping[str, object]) -> list[str]:
    return sorted(attributes.keys() - _BOOKKEEPING)


def _is_listed_in(module: str, cls: type) -> bool:
    """Whether the attributes of a class are looked at with a module: that in which it is defined,
    or the library whose public class it is."""
    return module != "numpy" and module in (cls.__module__, cls.__module__.split(".")[0])


def _same(before: tuple[object, ...], now: tuple[object, ...]) -> bool:
    return len(before) == len(now) and all(map(is_, before, now))


_STATE = _State()
