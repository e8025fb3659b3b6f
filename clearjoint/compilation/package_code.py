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
from collections.abc import Iterator

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

    `lock` guards the others. `held` has by module what it held when the import of the package
    ended, `digest` the digest of the source files, `modules` the number of modules that were loaded
    when the files were last compared, and `changed` whether a change was ever found: functions that
    JAX has traced since then may hold replaced code for as long as the process lives.
    """

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.files = _files()
        self.held: dict[str, list[object]] = {}
        self.digest: str | None = None
        self.modules = 0
        self.changed = False


def remember_contents() -> None:
    """Note what the modules of the package and of `LIBRARIES` hold: to be called at the end of the
    import of the package."""
    names = [name for name in sys.modules if name.split(".")[0] == PACKAGE]
    names = [name for name in names if not name.startswith(_OF_THE_PROCESS)]
    _STATE.held = {name: _contents(name) for name in (*names, *LIBRARIES) if name in sys.modules}


def is_remembered(module: str) -> bool:
    """Whether a module was loaded when `remember_contents` was called, so that a change is seen."""
    return module in _STATE.held


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
    return all(_same(held, _contents(name)) for name, held in _STATE.held.items())


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


def _contents(module: str) -> list[object]:
    """Names and values in a module and in its classes, in turn. Modules are left out, since the
    import of a module adds it to the package that it is in."""
    found: list[object] = []
    for name, value in list(vars(sys.modules[module]).items()):
        if not (name.startswith("__") or isinstance(value, types.ModuleType)):
            found += (name, *_inside(value, module))
    return found


def _inside(value: object, module: str) -> Iterator[object]:
    """A value, with what may be replaced in it."""
    yield value
    if isinstance(value, types.FunctionType):
        yield from (value.__code__, value.__defaults__, value.__kwdefaults__)
    elif isinstance(value, dict):
        yield from (part for item in list(value.items()) for part in item)
    elif isinstance(value, list):
        yield from value
    elif isinstance(value, type) and _is_listed_in(module, value):
        for name, inner in list(vars(value).items()):
            if name not in _BOOKKEEPING:
                yield from (name, inner)
                if isinstance(inner, types.FunctionType):
                    yield inner.__code__


def _is_listed_in(module: str, cls: type) -> bool:
    """Whether the attributes of a class are looked at with a module: that in which it is defined,
    or the library whose public class it is."""
    return module != "numpy" and module in (cls.__module__, cls.__module__.split(".")[0])


def _same(before: list[object], now: list[object]) -> bool:
    if len(before) != len(now):
        return False
    pairs = zip(before, now, strict=True)
    return all(a is b or (type(a) is str and a == b) for a, b in pairs)


_STATE = _State()
